"""LAS and LAZ: every point format and field there and back, with laspy as the witness."""

from __future__ import annotations

import io
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel
from surfel.core.errors import FileFormatError, InputError
from surfel.io import las
from surfel.io.content import Content, Frame, Head
from surfel.io.las_crs import Record, crs_of, in_degrees, records_of, refuse_degrees
from surfel.io.las_lattice import lattice_of
from surfel.io.las_layout import COLORS, fields_of
from surfel.io.options import Options
from surfel.io.source import Source

laspy = pytest.importorskip("laspy")

UTM = 'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",UNIT["degree",0.0174532925199433]],UNIT["metre",1]]'
DEGREES = 'GEOGCS["WGS 84",DATUM["WGS_1984"],UNIT["degree",0.0174532925199433]]'


def source_of(data: bytes, name: str = "a.las") -> Source:
    return Source(name, io.BytesIO(data), len(data))


def columns_for(number: int, count: int, seed: int = 0) -> tuple[dict, np.ndarray | None]:
    """Random values over the whole range of every field of a point format."""
    rng = np.random.default_rng(seed)
    attributes = {}
    for field in fields_of(number):
        kind = np.dtype(field.dtype)
        if field.name in COLORS:
            continue
        if kind.kind == "f":
            attributes[field.name] = (rng.normal(size=count) * 1e6).astype(kind)
        else:
            least = 0 if kind.kind == "u" else int(np.iinfo(kind).min)
            attributes[field.name] = rng.integers(least, field.largest, count, kind, endpoint=True)
    colored = any(field.name == "red" for field in fields_of(number))
    return attributes, rng.integers(0, 65536, (count, 3), np.uint16) if colored else None


def content_for(number: int, count: int, seed: int = 0) -> Content:
    rng = np.random.default_rng(seed + 1)
    attributes, colors = columns_for(number, count, seed)
    points = rng.integers(-(10**6), 10**6, (count, 3)) * 0.001 + np.array([512_345.0, 5_412_345.0, 400.0])
    frame = Frame((0.001,) * 3, (512_345.0, 5_412_345.0, 400.0), UTM, {"las": {"format": number, "version": 4}})
    return Content(points, colors=colors, attributes=attributes, frame=frame)


def saved(content: Content, suffix: str = ".las") -> bytes:
    stream = io.BytesIO()
    assert las.save(stream, content, suffix=suffix) == []
    return stream.getvalue()


def assert_same(a: Content, b: Content) -> None:
    np.testing.assert_array_equal(a.points, b.points)
    assert (a.colors is None) == (b.colors is None) and (a.normals is None) == (b.normals is None)
    if a.colors is not None:
        np.testing.assert_array_equal(a.colors, b.colors)
    assert set(a.attributes) == set(b.attributes)
    for name, values in a.attributes.items():
        assert values.dtype == b.attributes[name].dtype, name
        np.testing.assert_array_equal(values, b.attributes[name], err_msg=name)


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("number", range(11))
def test_every_point_format_there_and_back(number, suffix):
    content = content_for(number, 700, number)
    if number >= 9 and suffix == ".laz":
        content.attributes["scanner_channel"][:] = 2  # see the test below
    data = saved(content, suffix)
    again = las.load(source_of(data))
    assert_same(content, again)
    assert again.frame.crs == UTM
    witness = laspy.read(io.BytesIO(data))
    assert witness.header.point_format.id == number
    np.testing.assert_array_equal(witness.xyz, content.points)
    for name, values in content.attributes.items():
        np.testing.assert_array_equal(np.asarray(witness[name]), values, err_msg=name)
    if content.colors is not None:
        np.testing.assert_array_equal(np.stack([witness.red, witness.green, witness.blue], axis=1), content.colors)
    counts = np.bincount(np.maximum(content.attributes["return_number"], 1), minlength=16)[1:]
    np.testing.assert_array_equal(np.asarray(witness.header.number_of_points_by_return), counts)
    assert saved(again, suffix) == data  # written again, not a byte changes


@pytest.mark.parametrize("number", range(11))
def test_records_of_random_bytes(number):
    """Every bit of a record goes where laspy takes it from."""
    header = laspy.LasHeader(point_format=number, version="1.4")
    raw = np.random.default_rng(number).integers(0, 256, (400, header.point_format.size), np.uint8)
    array = raw.view(header.point_format.dtype())[:, 0].copy()
    points = laspy.ScaleAwarePointRecord(array, header.point_format, header.scales, header.offsets)
    record = laspy.LasData(header, points)
    stream = io.BytesIO()
    record.write(stream)
    content = las.load(source_of(stream.getvalue()))
    names = set(header.point_format.dimension_names)
    assert set(content.attributes) == names - {"X", "Y", "Z", *COLORS}
    for name, values in content.attributes.items():
        np.testing.assert_array_equal(values, np.asarray(record[name]), err_msg=name)
    np.testing.assert_array_equal(content.points, record.xyz)
    again = las.load(source_of(saved(content)))
    assert_same(content, again)


def test_waveforms_of_several_channels_are_not_compressed():
    """lazrs 0.8.2 gives other packets back, and says nothing."""
    content = content_for(9, 100)
    assert_same(las.load(source_of(saved(content))), content)
    with pytest.raises(InputError, match="channels"):
        las.save(io.BytesIO(), content, suffix=".laz")


@pytest.mark.parametrize("version", ["1.2", "1.3", "1.4"])
@pytest.mark.parametrize("number", range(11))
def test_files_that_laspy_writes(number, version):
    try:
        header = laspy.LasHeader(point_format=number, version=version)
    except laspy.errors.LaspyException:
        pytest.skip("no such pair")
    header.scales, header.offsets = [0.01, 0.001, 0.25], [1000.0, -5.0, 0.0]
    header.add_extra_dim(laspy.ExtraBytesParams("height above ground", "int32", scales=[0.001], offsets=[5.0]))
    header.add_extra_dim(laspy.ExtraBytesParams("pair", "2f4"))
    header.add_extra_dim(laspy.ExtraBytesParams("tag", "uint8"))
    record = laspy.LasData(header)
    rng = np.random.default_rng(3)
    record.xyz = rng.random((50, 3)) * 100
    attributes, _ = columns_for(number, 50)
    attributes.pop("scanner_channel", None)  # several of them, with waveforms, are beyond lazrs: see the test above
    for name, values in attributes.items():
        record[name] = values
    record["height above ground"] = rng.integers(-1000, 1000, 50) * 0.001 + 5.0
    record["pair"] = rng.random((50, 2)).astype("f4")
    record["tag"] = rng.integers(0, 255, 50).astype("u1")
    for compressed in (False, True):
        stream = io.BytesIO()
        record.write(stream, do_compress=compressed)
        content = las.load(source_of(stream.getvalue()))
        np.testing.assert_array_equal(content.points, record.xyz)
        for name, values in attributes.items():
            np.testing.assert_array_equal(content.attributes[name], values, err_msg=name)
        height = np.asarray(record["height above ground"])
        np.testing.assert_allclose(content.attributes["height_above_ground"], height, rtol=1e-15)
        np.testing.assert_array_equal(content.attributes["pair"], record["pair"])
        np.testing.assert_array_equal(content.attributes["tag"], record["tag"])
        again = las.load(source_of(saved(content, ".laz" if compressed else ".las")))
        assert_same(content, again)
        assert again.frame.extra["las"]["extras"]["height_above_ground"].scale == 0.001  # stored as whole numbers


KNOWN = {field.name for number in range(11) for field in fields_of(number)}
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=40).filter(
    lambda name: name.strip() and name not in KNOWN
)
TYPES = st.sampled_from(["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8", "?"])


@settings(max_examples=60)
@given(st.dictionaries(NAMES, st.tuples(TYPES, st.integers(1, 5)), max_size=4), st.integers(1, 9), st.booleans(),
       st.booleans(), st.sampled_from([".las", ".laz"]))  # fmt: skip
def test_any_attribute_there_and_back(kinds, count, normals, radii, suffix):
    rng = np.random.default_rng(count)
    attributes = {}
    for name, (kind, width) in kinds.items():
        raw = rng.integers(0, 256, (count, width * np.dtype(kind).itemsize), np.uint8)
        raw = raw & 1 if kind == "?" else raw
        values = np.ascontiguousarray(raw).view(kind).reshape(count, width)
        attributes[name] = values[:, 0].copy() if width == 1 else values
    content = Content(
        rng.integers(0, 1000, (count, 3)) * 0.25, normals=rng.random((count, 3)) if normals else None,
        radii=rng.random(count) if radii else None, attributes=attributes,
    )  # fmt: skip
    stream = io.BytesIO()
    lost = las.save(stream, content, suffix=suffix)
    again = las.load(source_of(stream.getvalue()))
    np.testing.assert_array_equal(again.points, content.points)
    if normals:
        np.testing.assert_array_equal(again.normals, content.normals)
    if radii and "radius" not in attributes:
        np.testing.assert_array_equal(again.radii, content.radii)
    standard = {field.name for field in fields_of(0)}
    new = [values for name, values in again.attributes.items() if name not in standard or name in attributes]
    wide = [k for k, w in kinds.values() if w > 3 and k not in ("u1", "?")]
    assert lost == [] or any(name in standard | {"radius"} for name in attributes)
    if not wide and not radii and not normals:
        assert len(new) == len(attributes)
        for values, (_, (kind, width)) in zip(new, kinds.items(), strict=True):
            assert values.dtype == ("u1" if kind == "?" else kind)
            assert values.shape[1:] == ((width,) if width > 1 else ())
    stored = b"".join(np.ascontiguousarray(v, v.dtype).tobytes() for v in new)
    for name, values in attributes.items():
        if values.ndim == 1 or values.shape[1] <= 3:
            assert values.tobytes() in stored, name


@settings(max_examples=100)
@given(st.integers(0, 10), st.lists(st.tuples(*[st.integers(-(2**31) + 1, 2**31 - 1)] * 3), min_size=1, max_size=6),
       st.sampled_from([1.0, 0.1, 0.01, 0.001, 0.00025, 1e-7, 1 / 3]), st.floats(-1e7, 1e7))  # fmt: skip
def test_the_last_stored_digit(number, stored, scale, offset):
    """Whatever a file can store comes back bit for bit, through a cloud too."""
    attributes, colors = columns_for(number, len(stored))
    points = np.array(stored) * scale + offset
    frame = Frame((scale,) * 3, (offset,) * 3, "", {"las": {"format": number}})
    again = las.load(source_of(saved(Content(points, colors=colors, attributes=attributes, frame=frame))))
    np.testing.assert_array_equal(again.points, points)
    assert again.frame.scale == (scale,) * 3 and again.frame.offset == (offset,) * 3


def test_utm_through_the_doors(tmp_path):
    rng = np.random.default_rng(0)
    points = np.stack([rng.integers(0, 10**6, 500) / 1000 + e for e in (399_999.0, 5_400_000.0, 100.0)], axis=1)
    surfel.write(tmp_path / "a.laz", surfel.Surfels(points))
    first = surfel.read(tmp_path / "a.laz")
    np.testing.assert_allclose(first.points, points, rtol=0, atol=2e-9)  # two bits of a double at 5 million
    assert first.provenance["frame"].scale == (0.001,) * 3  # found, not given
    surfel.write(tmp_path / "b.las", first[::2])
    np.testing.assert_array_equal(surfel.read(tmp_path / "b.las").points, first.points[::2])


@pytest.mark.parametrize("factor", [1e-9, 1e-3, 1.0, 1e6, 1e12, 1e300])
def test_a_lattice_for_any_size(factor):
    points = np.random.default_rng(0).random((100, 3)) * factor
    scale, offset = lattice_of(points, None)
    stored = np.rint((points - offset) / scale)
    assert np.abs(stored).max() < 2**31
    assert np.abs(stored * scale + offset - points).max() <= factor * 1e-8
    assert lattice_of(np.array([[1.25, 1000.5, -3.0]] * 2), None)[0].tolist() == [0.01, 0.1, 1.0]
    assert lattice_of(np.zeros((0, 3)), None)[0].tolist() == [0.001] * 3


def test_moved_points_leave_the_lattice_of_their_file():
    frame = Frame((0.01,) * 3, (0.0,) * 3)
    points = np.array([[1.234567, 2.0, 3.0], [1.0, 2.0, 3.0]])
    again = las.load(source_of(saved(Content(points, frame=frame))))
    np.testing.assert_allclose(again.points, points, atol=1e-12)


def test_values_beyond_their_field_become_extra_bytes():
    attributes = {"intensity": np.array([70000.0, 1.5]), "classification": np.array([3, 200], np.int64)}
    stream = io.BytesIO()
    lost = las.save(stream, Content(np.eye(3)[:2], attributes=attributes), suffix=".las")
    again = las.load(source_of(stream.getvalue()))
    assert again.attributes["intensity_value"].tolist() == [70000.0, 1.5] and "'intensity_value'" in lost[0]
    assert again.attributes["classification"].tolist() == [3, 200]
    assert again.frame.extra["las"]["format"] == 6


def test_colors_in_other_types():
    for colors, expected in [
        (np.array([[0, 128, 255]], np.uint8), [0, 128 * 257, 65535]),
        (np.array([[0.0, 0.5, 1.0]]), [0, 32768, 65535]),
        (np.array([[7, 65535, 256]], np.uint16), [7, 65535, 256]),
    ]:
        stream = io.BytesIO()
        las.save(stream, Content(np.zeros((1, 3)), colors=colors), suffix=".las")
        assert las.load(source_of(stream.getvalue())).colors.tolist() == [expected]


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_runs_and_choices_against_brute_force(suffix):
    content = content_for(7, 5000, 5)
    data = saved(content, suffix)
    box = np.array([np.quantile(content.points, 0.2, axis=0), np.quantile(content.points, 0.9, axis=0)])
    options = Options(box, 3, frozenset({1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144, 233}))
    rows = np.arange(0, 5000, 3)
    points, classes = content.points[rows], content.attributes["classification"][rows]
    inside = ((points >= box[0]) & (points <= box[1])).all(axis=1)
    rows = rows[inside & np.isin(classes, sorted(options.classes))]
    assert len(rows) > 10
    got = las.load(source_of(data), options)
    np.testing.assert_array_equal(got.points, content.points[rows])
    np.testing.assert_array_equal(got.attributes["gps_time"], content.attributes["gps_time"][rows])
    runs = list(las.chunks(source_of(data), 700, options))
    np.testing.assert_array_equal(np.concatenate([run.points for run in runs]), content.points[rows])
    sizes = [len(run.points) for run in las.chunks(source_of(data), 700, Options())]
    assert max(sizes) == 700 and sum(sizes) == 5000
    none = las.load(source_of(data), Options(np.full((2, 3), -1e9)))
    assert len(none.points) == 0 and set(none.attributes) == set(content.attributes)
    with pytest.raises(InputError, match="every="):
        las.load(source_of(data), Options(level=1))


def test_a_streamed_copy_is_the_same(tmp_path):
    content = content_for(3, 3000)
    (tmp_path / "a.las").write_bytes(saved(content))
    surfel.convert(tmp_path / "a.las", tmp_path / "b.laz")
    assert_same(las.load(source_of((tmp_path / "b.laz").read_bytes())), content)
    stream = io.BytesIO()
    head = Head(points=3000, bounds=np.stack([content.points.min(axis=0), content.points.max(axis=0)]))
    writer = las.writer(stream, content.rows(slice(0, 10)), head, suffix=".laz")
    for first in range(0, 3000, 1234):
        writer.add(content.rows(slice(first, first + 1234)))
    writer.close()
    assert writer.lost == []
    many = las.writer(io.BytesIO(), content, Head(points=1 << 33, bounds=head.bounds), suffix=".las")
    assert many._version == 4  # earlier versions count in 32 bits
    assert_same(las.load(source_of(stream.getvalue())), content)
    odd = Content(np.eye(3), attributes={"intensity": np.ones(3)})  # doubles: later ones may not fit 16 bits
    assert las.writer(io.BytesIO(), odd, head, suffix=".las") is None


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_no_points(suffix):
    for number in (0, 3, 8):
        data = saved(content_for(number, 0), suffix)
        assert len(las.load(source_of(data)).points) == 0 and len(list(las.chunks(source_of(data), 9))) == 1


def test_the_head_says_what_a_whole_reading_finds():
    content = content_for(8, 300)
    content.attributes["height"] = np.arange(300.0)
    for suffix in (".las", ".laz"):
        data = saved(content, suffix)
        head, whole = las.head(source_of(data)), las.load(source_of(data))
        assert head.points == 300 and head.colors and not head.normals and head.frame.crs == UTM
        assert head.attributes == list(whole.attributes)
        np.testing.assert_array_equal(head.bounds, [whole.points.min(axis=0), whole.points.max(axis=0)])
        assert head.facts["version"] == "1.4" and head.facts["point_format"] == 8


def test_info_of_ten_gigabytes_without_reading_them(tmp_path):
    """A sparse file: neither memory nor heavy libraries are needed for what its header tells."""
    path = tmp_path / "large.las"
    data = bytearray(saved(content_for(3, 0)))
    count = (10**10 - len(data)) // 34
    struct.pack_into("<Q", data, 247, count)
    struct.pack_into("<6d", data, 179, *[1e3, -1e3] * 3)
    with open(path, "wb") as stream:
        stream.write(data)
        try:
            stream.truncate(len(data) + 34 * count)
        except OSError:
            pytest.skip("no sparse files here")
    if path.stat().st_blocks * 512 > 10**6:
        pytest.skip("no sparse files here")
    program = f"""
import resource, sys
from surfel.io import las
from surfel.io.source import open_source
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
with open_source({str(path)!r}) as source:
    print(las.head(source).points)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
print([name for name in ("numba", "scipy", "laspy", "lazrs") if name in sys.modules])
"""
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert int(answer[0]) == count
    assert int(answer[1]) < 20_000  # kilobytes
    assert answer[2] == "[]"


def test_coordinate_systems():
    keys = {1024: 1, 1025: 1, 1026: 'NAD83 / "BC" Albers', 3072: 32767, 3080: 45.5, 4096: 5703}
    text = "GEOTIFF " + " ".join(
        f"{k}={v}" if not isinstance(v, str) else f'{k}="' + v.replace('"', "\\x22") + '"' for k, v in keys.items()
    )
    assert crs_of(records_of(text)) == text
    for crs in (UTM, DEGREES, "EPSG:25832", "EPSG:4326", ""):
        assert crs_of(records_of(crs)) == crs
    assert crs_of([Record("LASF_Projection", 34735, "", b"\1\0\1\0\0\0\xff\xff")]) == ""  # more keys than bytes
    degrees = [
        DEGREES, "EPSG:4326", 'COMPD_CS["x",' + DEGREES + ',VERT_CS["height"]]', "GEOTIFF 1024=2 2048=4326 2054=9102",
        'GEODCRS["WGS 84",CS[ellipsoidal,2],ANGLEUNIT["degree",0.017]]', 'GEOGCRS["a PROJCS[ in a name"]',
    ]  # fmt: skip
    meters = [
        UTM, "EPSG:25832", "", "GEOTIFF 1024=1 3072=32617", 'GEOCCS["unnamed",UNIT["metre",1]]', "nonsense",
        'COMPD_CS["x",' + UTM + "]", 'GEODCRS["WGS 84",CS[Cartesian,3],LENGTHUNIT["metre",1]]', "EPSG:4978",
        'PROJCRS["x",BASEGEOGCRS["y"],CS[Cartesian,2]]',
    ]  # fmt: skip
    assert [in_degrees(crs) for crs in degrees] == [True] * len(degrees)
    assert [in_degrees(crs) for crs in meters] == [False] * len(meters)
    with pytest.raises(InputError, match="reprojection"):
        refuse_degrees(DEGREES)
    refuse_degrees(UTM)


LIES = {
    "more points than there are": (247, "<Q", 10**15),
    "fewer points than there are": (247, "<Q", 7),
    "two counts": (107, "<I", 5),
    "a longer record": (105, "<H", 200),
    "a shorter record": (105, "<H", 20),
    "another point format": (104, "<B", 11),
    "a later version": (25, "<B", 9),
    "points beyond the end": (96, "<I", 10**9),
    "points within the header": (96, "<I", 10),
    "too many records": (100, "<I", 10**9),
    "a short header": (94, "<H", 100),
    "no scale": (131, "<d", 0.0),
    "a scale that is no number": (131, "<d", float("nan")),
    "another offset": (155, "<d", -1e6),
    "an infinite offset": (155, "<d", float("inf")),
    "a box turned over": (179, "<d", -1e9),
    "extended records beyond the end": (235, "<QI", 10**12, 3),
    "extended records without end": (235, "<QI", 400, 2**32 - 1),
    "a record into the points": (375 + 20, "<H", 60000),
}


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("lie", LIES)
def test_lying_headers(lie, suffix):
    data = bytearray(saved(content_for(6, 200), suffix))
    at, form, *values = LIES[lie]
    struct.pack_into(form, data, at, *values)
    with pytest.raises(FileFormatError) as caught:
        las.load(source_of(bytes(data)))
    assert caught.value.place and caught.value.cure


def test_points_out_of_the_box_are_said():
    data = bytearray(saved(content_for(6, 200)))
    struct.pack_into("<d", data, 179, struct.unpack_from("<d", data, 179)[0] - 0.5)
    assert any("outside of the box" in note for note in las.load(source_of(bytes(data))).notes)
    packed = bytearray(saved(content_for(6, 200), ".laz"))
    struct.pack_into("<d", packed, 179, struct.unpack_from("<d", packed, 179)[0] - 0.5)
    with pytest.raises(FileFormatError, match="box"):
        las.load(source_of(bytes(packed)))
    struct.pack_into("<6d", packed, 179, *[0.0] * 6)  # not filled in: nothing to compare with
    assert len(las.load(source_of(bytes(packed))).points) == 200


def test_a_failing_disk_is_no_damaged_file():
    class Full(io.BytesIO):
        def write(self, data):
            if self.tell() + len(data) > 3000:
                raise OSError(28, "No space left on device")
            return super().write(data)

    for suffix in (".las", ".laz"):
        with pytest.raises(OSError, match="No space"):
            las.save(Full(), content_for(6, 100_000), suffix=suffix)
