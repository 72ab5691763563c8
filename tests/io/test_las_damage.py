"""Damaged LAS, LAZ and COPC: cut, with flipped bytes, lying inside. Our own error with place and cure, or a result."""

from __future__ import annotations

import io
import random
import struct
import tracemalloc

import numpy as np
import pytest

from surfel.core.errors import FileFormatError, InputError
from surfel.io import las
from surfel.io.content import Content, Frame
from surfel.io.las_header import read_header
from surfel.io.las_laz import packed
from surfel.io.options import Options
from surfel.io.source import Source

FILES = [
    "bad/append-bug.laz", "bad/bad-geotiff-keys.las", "bad/bad-pointcount.laz", "bad/gps-time-nan.las",
    "bad/unregistered_extra_bytes.las", "lidar/Topography.laz", "lidar/autzen_trim.laz", "lidar/bcts_1.laz",
    "lidar/bcts_2.laz", "lidar/laspy/plane.laz", "lidar/laspy/simple.copc.laz", "lidar/laspy/simple.las",
    "lidar/laspy/simple1_4.las", "lidar/lone-star.copc.laz", "plants/pc_tree.las", "plants/pine.laz",
]  # fmt: skip
LARGE = 300_000
COPC = ["lidar/laspy/simple.copc.laz", pytest.param("lidar/lone-star.copc.laz", marks=pytest.mark.slow)]


def source_of(data: bytes, name: str = "a.laz") -> Source:
    return Source(name, io.BytesIO(data), len(data))


def attempt(data: bytes, options: Options | None = None) -> Content | None:
    """Read all of it, whole and in runs; return the content, or None if it was refused as it should be."""
    try:
        content = las.load(source_of(data), options)
        for _ in las.chunks(source_of(data), 5000, options):
            pass
        las.head(source_of(data))
        return content
    except FileFormatError as error:
        assert error.path == "a.laz" and error.place and error.cure
        return None


def small(data_folder, name: str) -> bytes:
    """The file, or if it is large its first points written again (a COPC file: as it is)."""
    data = (data_folder / name).read_bytes()
    if len(data) <= LARGE or "copc" in name:
        return data
    content = las.load(source_of(data)).rows(slice(0, 20_000))
    stream = io.BytesIO()
    las.save(stream, content, suffix="." + name.rsplit(".", 1)[1])
    return stream.getvalue()


@pytest.mark.data
@pytest.mark.parametrize("name", [*FILES[:-3], FILES[-2], FILES[-1], pytest.param(FILES[-3], marks=pytest.mark.slow)])
def test_cut_at_20_places_and_20_flipped_bytes(data_folder, name):
    data = small(data_folder, name)
    whole = attempt(data)
    assert whole is not None
    rng = random.Random(name)
    for length in [*(rng.randrange(1, len(data)) for _ in range(19)), len(data) - 1]:
        if length != len(data) - 1 or not name.endswith("simple1_4.las"):
            assert attempt(data[:length]) is None, length
    garbled = 0
    for _ in range(20):
        damaged = bytearray(data)
        damaged[rng.randrange(len(data))] ^= rng.randrange(1, 256)
        content = attempt(bytes(damaged))
        if content is not None and not np.array_equal(content.points, whole.points):
            garbled += 1
    if name.endswith(".laz"):
        assert garbled <= 1  # the compressed coordinates are hardly ever garbled unnoticed


@pytest.mark.data
def test_the_bad_files_are_answered_or_refused(data_folder):
    for name, count in [("append-bug.laz", 37805), ("bad-geotiff-keys.las", 10), ("bad-pointcount.laz", 1065),
                        ("gps-time-nan.las", 1), ("unregistered_extra_bytes.las", 4)]:  # fmt: skip
        with open(data_folder / "bad" / name, "rb") as stream:
            data = stream.read()
        assert len(las.load(source_of(data)).points) == count
    with pytest.raises(FileFormatError, match="3 records, 2"):
        las.load(source_of((data_folder / "bad/bad_vlr_count.las").read_bytes()))


def made(number: int, count: int, seed: int = 0) -> bytes:
    """A LAZ file of several chunks' worth of plausible points."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.integers(-30, 31, (count, 3)), axis=0) * 0.01
    attributes = {"intensity": rng.integers(0, 999, count).astype(np.uint16), "gps_time": np.arange(count) * 1e-5}
    attributes["classification"] = rng.integers(1, 7, count).astype(np.uint8)
    attributes["return_number"] = np.ones(count, np.uint8)
    frame = Frame((0.01,) * 3, (0.0,) * 3, "", {"las": {"format": number}})
    stream = io.BytesIO()
    las.save(stream, Content(points, attributes=attributes, frame=frame), suffix=".laz")
    return stream.getvalue()


@pytest.mark.parametrize("number", [1, 6])
def test_a_flipped_bit_anywhere_in_compressed_points(number):
    data = made(number, 60_000)
    whole = las.load(source_of(data))
    how = packed(source_of(data), read_header(source_of(data)))
    assert len(how.chunks) == 2
    rng = random.Random(number)
    garbled = 0
    for _ in range(25):
        chunk = rng.choice(how.chunks)
        damaged = bytearray(data)
        damaged[rng.randrange(chunk.at, chunk.at + chunk.size)] ^= 1 << rng.randrange(8)
        try:
            content = las.load(source_of(bytes(damaged)))
        except FileFormatError as error:
            assert f"points {chunk.first} to" in error.place  # the error lies in the damaged chunk
            continue
        garbled += not np.array_equal(content.points, whole.points)
    assert garbled <= 1


def test_lying_tables_of_chunks():
    data = made(6, 60_000)
    header = read_header(source_of(data))
    table = struct.unpack_from("<q", data, header.start)[0]
    vlr = data.index(b"laszip encoded") + 52
    lies = [
        (header.start, "<q", -1), (header.start, "<q", 2**40), (header.start, "<q", header.start), (table, "<I", 7),
        (table + 4, "<I", 2**31), (table + 4, "<I", 1), (table + 8, "<I", 0xFFFFFFFF), (vlr, "<H", 9),
        (vlr + 2, "<H", 9), (vlr + 12, "<I", 0), (vlr + 12, "<I", 2**31), (vlr + 12, "<I", 7),
        (vlr + 12, "<I", 0xFFFFFFFF), (vlr + 32, "<H", 0), (vlr + 32, "<H", 9999), (vlr + 34, "<H", 6),
        (vlr + 36, "<H", 31), (vlr + 38, "<H", 9), (header.start + 8 + 30, "<I", 49_999),
        (header.start + 8 + 34, "<I", 2**32 - 1), (header.start + 8 + 38, "<I", 0),
    ]  # fmt: skip
    for at, form, value in lies:
        damaged = bytearray(data)
        struct.pack_into(form, damaged, at, value)
        tracemalloc.start()
        assert attempt(bytes(damaged)) is None, (at, value)
        assert tracemalloc.get_traced_memory()[1] < 64e6 + 4 * 60_000 * 60
        tracemalloc.stop()


def test_a_count_beyond_what_few_bytes_can_hold():
    """One chunk that claims two milliards of points: read piece by piece, it ends where its bytes end."""
    data = bytearray(made(1, 1000))
    header = read_header(source_of(bytes(data)))
    vlr = data.index(b"laszip encoded") + 52
    struct.pack_into("<I", data, vlr + 12, 2**31)
    if header.version == 4:
        struct.pack_into("<Q", data, 247, 2**31 - 1)
    struct.pack_into("<I", data, 107, 2**31 - 1)
    tracemalloc.start()
    assert attempt(bytes(data)) is None
    assert tracemalloc.get_traced_memory()[1] < 150e6
    tracemalloc.stop()


def test_one_large_chunk_piece_by_piece(monkeypatch):
    from surfel.io import las_laz

    for number in (1, 6):
        data = made(number, 60_000)
        whole = las.load(source_of(data))
        monkeypatch.setattr(las_laz, "_BATCH", 1000)
        monkeypatch.setattr(las_laz, "_PIECE", 7777)
        again = las.load(source_of(data))
        monkeypatch.undo()
        np.testing.assert_array_equal(again.points, whole.points)
        np.testing.assert_array_equal(again.attributes["gps_time"], whole.attributes["gps_time"])


def test_a_panic_becomes_an_error(monkeypatch):
    import lazrs

    PanicException = type("PanicException", (BaseException,), {})

    def panics(*arguments):
        raise PanicException("mid > len")

    data = made(1, 10)
    monkeypatch.setattr(lazrs, "decompress_points_with_chunk_table", panics)
    assert attempt(data) is None
    for error in (KeyboardInterrupt, MemoryError):

        def fails(*arguments, error=error):
            raise error

        monkeypatch.setattr(lazrs, "decompress_points_with_chunk_table", fails)
        with pytest.raises(error):
            las.load(source_of(data))


@pytest.mark.data
@pytest.mark.parametrize("name", COPC)
def test_copc_against_brute_force(data_folder, name):
    data = (data_folder / name).read_bytes()
    whole = las.load(source_of(data))
    tree = las.head(source_of(data)).facts["copc"]
    rng = np.random.default_rng(0)
    low, high = whole.points.min(axis=0), whole.points.max(axis=0)
    for share, every in ((0.1, 1), (0.5, 7)):
        corner = low + rng.random(3) * (high - low) * (1 - share)
        box = np.stack([corner, corner + (high - low) * share])
        keep = ((whole.points >= box[0]) & (whole.points <= box[1])).all(axis=1)
        keep &= np.arange(len(keep)) % every == 0
        got = las.load(source_of(data), Options(box, every))
        np.testing.assert_array_equal(got.points, whole.points[keep])
        np.testing.assert_array_equal(got.attributes["gps_time"], whole.attributes["gps_time"][keep])
    counts = [len(las.load(source_of(data), Options(level=level)).points) for level in (0, 1, 2, 9)]
    assert 0 < counts[0] <= counts[1] and sorted(counts) == counts and counts[-1] == len(whole.points)
    for level in range(3):
        spacing = tree["spacing"] / 2**level
        assert len(las.load(source_of(data), Options(resolution=spacing)).points) == counts[level]
        assert len(las.load(source_of(data), Options(resolution=spacing * 1.01)).points) == counts[level]
    assert len(las.load(source_of(data), Options(resolution=1e9)).points) == counts[0]
    runs = las.chunks(source_of(data), 1000, Options(level=0))
    assert sum(len(run.points) for run in runs) == counts[0]


@pytest.mark.data
@pytest.mark.parametrize("name", COPC)
def test_copc_levels_as_laspy_reads_them(data_folder, name):
    laspy = pytest.importorskip("laspy")
    path = data_folder / name
    data = path.read_bytes()
    with laspy.CopcReader.open(str(path)) as reader:
        for level in range(3):
            found = reader.query(level=range(level + 1))
            theirs = np.stack([found.x, found.y, found.z], axis=1)
            ours = las.load(source_of(data), Options(level=level)).points
            np.testing.assert_array_equal(ours[np.lexsort(ours.T)], theirs[np.lexsort(theirs.T)])


@pytest.mark.data
def test_lying_trees(data_folder):
    data = (data_folder / "lidar/laspy/simple.copc.laz").read_bytes()
    info = data.index(b"copc\0") + 52
    page, size = struct.unpack_from("<QQ", data, info + 40)
    lies = [
        (info, "<d", float("nan")), (info + 24, "<d", 0.0), (info + 32, "<d", -1.0), (info + 40, "<Q", 2**60),
        (info + 48, "<Q", 31), (info + 48, "<Q", 2**60), (page, "<i", -1), (page, "<i", 77), (page + 4, "<i", 9),
        (page + 16, "<Q", 2**50), (page + 16, "<Q", 600), (page + 24, "<i", -5), (page + 28, "<i", -2),
        (page + 28, "<i", 5),
    ]  # fmt: skip
    for at, form, value in lies:
        damaged = bytearray(data)
        struct.pack_into(form, damaged, at, value)
        assert attempt(bytes(damaged), Options(level=3)) is None, (at, value)
    loop = bytearray(data)
    struct.pack_into("<Qii", loop, page + 16, page, size, -1)  # a page that names itself
    assert attempt(bytes(loop), Options(level=3)) is None
    rng = random.Random(1)
    for _ in range(40):
        damaged = bytearray(data)
        damaged[rng.randrange(info, info + 160) if rng.random() < 0.3 else rng.randrange(page, page + size)] ^= 1 << (
            rng.randrange(8)
        )
        attempt(bytes(damaged), Options(np.array([[0, 0, 0], [1e7, 1e7, 1e4]]), level=2))


def test_levels_need_a_tree():
    with pytest.raises(InputError, match="COPC"):
        las.load(source_of(made(6, 10)), Options(resolution=1.0))
