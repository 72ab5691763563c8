"""E57: files of another library, bits of any width, poses, invalid points, damage of every kind."""

from __future__ import annotations

import io
import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import surfel
from surfel.core.errors import FileFormatError
from surfel.io import e57
from surfel.io.content import Content, Frame
from surfel.io.e57_bits import checksums, unpacked
from surfel.io.e57_pages import paged
from surfel.io.source import Source

FILES = ["e57/testWithNormals.e57", "e57/translationWithoutRotation.e57"]
SPACE = "http://www.astm.org/COMMIT/E57/2010-e57-v1.0"


def source_of(data: bytes) -> Source:
    return Source("a.e57", io.BytesIO(data), len(data))


def attempt(data: bytes) -> Content | None:
    try:
        return e57.load(source_of(data))
    except FileFormatError as error:
        assert error.path == "a.e57" and error.place and error.cure
        return None


def saved(content: Content) -> bytes:
    stream = io.BytesIO()
    e57.save(stream, content)
    return stream.getvalue()


def packed_bits(values: list[int], bits: int) -> bytes:
    """The slow way: one large whole number."""
    whole = sum(value << (i * bits) for i, value in enumerate(values))
    return whole.to_bytes((len(values) * bits + 7) // 8, "little")


def file_of(fields: list[tuple[str, list[int], int]], count: int, pose: str = "", step: int = 7) -> bytes:
    """A file made by hand: fields are XML, raw numbers and their bits; packets cut the streams anywhere."""
    streams = [packed_bits(values, bits) for _, values, bits in fields]
    packets = b""
    for first in range(0, max(map(len, streams)), step):
        parts = [stream[first : first + step] for stream in streams]
        body = struct.pack(f"<H{len(parts)}H", len(parts), *map(len, parts)) + b"".join(parts)
        size = -(-(4 + len(body)) // 4) * 4
        packets += struct.pack("<BBH", 1, 0, size - 1) + body.ljust(size - 4, b"\0")
    packets += struct.pack("<BBHHB9x", 0, 0, 15, 0, 0)  # an index of nothing
    section = struct.pack("<B7x3Q", 1, 32 + len(packets), 80, 80) + packets
    xml = (
        f'<?xml version="1.0"?><e57Root type="Structure" xmlns="{SPACE}"><data3D type="Vector"><vectorChild '
        f'type="Structure"><name type="String">one</name>{pose}<points type="CompressedVector" fileOffset="48" '
        f'recordCount="{count}"><prototype type="Structure">{"".join(f for f, _, _ in fields)}</prototype></points>'
        "</vectorChild></data3D></e57Root>"
    ).encode()
    return assembled(section, xml)


def assembled(section: bytes, xml: bytes) -> bytes:
    at = 48 + len(section)
    size = -(-(at + len(xml)) // 1020) * 1024
    head = struct.pack("<8s2I4Q", b"ASTM-E57", 1, 0, size, at // 1020 * 1024 + at % 1020, len(xml), 1024)
    return paged(head + section + xml)


def scaled(name: str, low: int, high: int) -> str:
    return f'<{name} type="ScaledInteger" minimum="{low}" maximum="{high}" scale="0.001" offset="100"/>'


def test_the_checksum_is_that_of_the_standard():
    assert checksums(np.frombuffer(b"12345678" * 4, np.uint8).reshape(4, 8))[0] == 0x6087809A
    assert checksums(np.zeros((1, 32), np.uint8))[0] == 0x8A9136AA  # RFC 3720, B.4


@given(st.integers(1, 64), st.integers(0, 20), st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=40))
def test_bits_of_any_width(bits, skip, values):
    values = [value & ((1 << bits) - 1) for value in values]
    whole = sum(v << (skip + i * bits) for i, v in enumerate(values))
    data = np.frombuffer(whole.to_bytes((skip + len(values) * bits + 7) // 8, "little"), np.uint8)
    assert unpacked(data, skip, len(values), bits).tolist() == values


@settings(max_examples=40)
@given(st.integers(1, 40), st.integers(0, 2**31 - 1), st.integers(1, 40), st.integers(1, 30))
def test_scaled_whole_numbers_across_packets(bits, seed, count, step):
    rng = np.random.default_rng(seed)
    low = -int(rng.integers(0, 2**20))
    high = low + (1 << bits) - 1
    raw = rng.integers(0, 1 << bits, (3, count)).tolist()
    data = file_of([(scaled(f"cartesian{a}", low, high), raw[i], bits) for i, a in enumerate("XYZ")], count, "", step)
    expected = (np.array(raw).T + low) * 0.001 + 100.0
    np.testing.assert_array_equal(attempt(data).points, expected)
    for size in (1, 3):
        runs = list(e57.chunks(source_of(data), size))
        assert max(len(run.points) for run in runs) <= size
        np.testing.assert_array_equal(np.concatenate([run.points for run in runs]), expected)


def test_spherical_coordinates_invalid_points_and_a_pose():
    def double(name: str, values: list[float]) -> tuple[str, list[int], int]:
        raw = [int(x) for x in np.array(values).view(np.uint64)]
        return f'<{name} type="Float"/>', raw, 64

    fields = [
        double("sphericalRange", [2.0, 3.0, 4.0]),
        double("sphericalAzimuth", [0.0, np.pi / 2, 1.0]),
        double("sphericalElevation", [0.0, 0.0, np.pi / 2]),
        ('<sphericalInvalidState type="Integer" minimum="0" maximum="2"/>', [0, 2, 0], 2),
        ('<constant type="Integer" minimum="5" maximum="5"/>', [0, 0, 0], 0),
        ('<rowIndex type="Integer" minimum="-3" maximum="4"/>', [0, 1, 7], 3),
    ]
    half = np.sqrt(0.5)
    pose = (
        f'<pose type="Structure"><rotation type="Structure"><w type="Float">{half}</w><z type="Float">{half}</z>'
        '</rotation><translation type="Structure"><x type="Float">10</x></translation></pose>'
    )
    content = attempt(file_of(fields, 3, pose))
    np.testing.assert_allclose(content.points, [[10, 2, 0], [10, 0, 4]], atol=1e-12)
    assert content.notes == ["1 points of 'one' that the scanner marked as invalid were dropped"]
    assert content.attributes["constant"].tolist() == [5, 5] and content.attributes["row_index"].tolist() == [-3, 4]
    assert content.frame.extra["e57"]["scans"][0]["translation"] == [10.0, 0.0, 0.0]


@pytest.mark.data
def test_real_files(data_folder):
    normal, moved = (e57.load(source_of((data_folder / name).read_bytes())) for name in FILES)
    assert normal.points.tolist() == [[1, 0, 0], [2, 0, 0]] and normal.normals.argmax(axis=1).tolist() == [2, 1]
    assert moved.points.tolist() == [[4, 5, 6], [5, 5, 6], [4, 6, 6], [5, 6, 6]]


def test_files_of_another_library_both_ways(tmp_path):
    pye57 = pytest.importorskip("pye57")
    rng = np.random.default_rng(0)
    count = 3000
    path = str(tmp_path / "theirs.e57")
    file = pye57.E57(path, mode="w")
    for i in range(2):
        fields = {f"cartesian{axis}": rng.normal(size=count) for axis in "XYZ"}
        fields |= {f"color{name}": rng.integers(0, 256, count).astype("u1") for name in ("Red", "Green", "Blue")}
        fields |= {"intensity": rng.random(count).astype("f4")}
        fields |= {name: rng.integers(0, 999, count) for name in ("rowIndex", "columnIndex")}
        fields["cartesianInvalidState"] = (rng.random(count) < 0.1).astype("i1")
        turn = rng.normal(size=4)
        file.write_scan_raw(fields, name=f"s{i}", rotation=turn / np.linalg.norm(turn), translation=1e5 * rng.random(3))
    file.close()
    cloud = surfel.read(path)
    file = pye57.E57(path)
    options = {"intensity": True, "colors": True, "ignore_missing_fields": True}
    theirs = [file.read_scan(i, **options) for i in (0, 1)]

    def both(name: str) -> np.ndarray:
        return np.concatenate([scan[name] for scan in theirs])

    np.testing.assert_allclose(
        cloud.points, np.stack([both(f"cartesian{axis}") for axis in "XYZ"], axis=1), rtol=0, atol=1e-9
    )
    np.testing.assert_array_equal(cloud.colors[:, 1], both("colorGreen"))
    np.testing.assert_array_equal(cloud.attributes["intensity"], both("intensity"))
    assert cloud.attributes["scan"].max() == 1 and len(cloud.provenance["notes"]) == 2
    surfel.write(tmp_path / "ours.e57", cloud)
    raw = pye57.E57(str(tmp_path / "ours.e57")).read_scan_raw(0, ignore_unsupported_fields=True)
    np.testing.assert_array_equal(raw["cartesianZ"], cloud.points[:, 2])
    np.testing.assert_array_equal(raw["colorBlue"], cloud.colors[:, 2])
    np.testing.assert_array_equal(raw["rowIndex"], cloud.attributes["row_index"])


@settings(max_examples=40)
@given(st.integers(0, 2500), st.integers(0, 2**31 - 1),
       st.lists(st.sampled_from(["u1", "i1", "u2", "i2", "u4", "i4", "i8", "f4", "f8"]), max_size=5),
       st.booleans(), st.sampled_from([None, "u1", "u2", "f8"]))  # fmt: skip
def test_there_and_back(count, seed, kinds, normals, colors):
    rng = np.random.default_rng(seed)
    raw = rng.integers(0, 256, (len(kinds), count, 8), np.uint8)
    attributes = {f"a_{i}B": raw[i].view(kind)[:, 0].copy() for i, kind in enumerate(kinds)}
    attributes["intensity"] = rng.random(count)
    content = Content(
        rng.normal(size=(count, 3)) * 1e7, normals=rng.normal(size=(count, 3)) if normals else None,
        colors=None if colors is None else (rng.random((count, 3)) * 255).astype(colors), attributes=attributes,
        frame=Frame(crs='PROJCS["a & b <c>"]'),
    )  # fmt: skip
    again = attempt(saved(content))
    np.testing.assert_array_equal(again.points, content.points)
    assert again.frame.crs == content.frame.crs and again.attributes.keys() == attributes.keys()
    for name, values in attributes.items():
        assert values.dtype == again.attributes[name].dtype
        np.testing.assert_array_equal(values, again.attributes[name])
    if normals:
        np.testing.assert_array_equal(again.normals, content.normals)
    if colors:
        np.testing.assert_array_equal(again.colors, content.colors)


def test_what_cannot_be_kept_is_said():
    attributes = {"a b": np.zeros(2), "text": np.array(["x", "y"]), "large": np.full(2, 2**63, np.uint64)}
    content = Content(np.eye(3)[:2], colors=np.zeros((2, 4), np.uint8), attributes=attributes)
    lost = e57.save(io.BytesIO(), content)
    assert [any(word in line for line in lost) for word in ("'a b'", "'text'", "'large'", "alpha")] == [True] * 4


@pytest.mark.data
@pytest.mark.parametrize("name", FILES)
def test_cut_at_20_places_and_20_flipped_bytes(data_folder, name):
    data = (data_folder / name).read_bytes()
    rng = random.Random(name)
    for _ in range(20):
        assert attempt(data[: rng.randrange(1, len(data))]) is None
    for _ in range(20):
        damaged = bytearray(data)
        damaged[rng.randrange(len(data))] ^= rng.randrange(1, 256)
        assert attempt(bytes(damaged)) is None  # every byte of these files lies in a page that is read


def test_damage_under_a_right_checksum():
    """What no checksum finds: the pages are made anew after the damage."""
    rng = random.Random(3)
    content = Content(
        np.random.default_rng(0).random((500, 3)), attributes={"intensity": np.arange(500, dtype=np.uint16)}
    )
    data = np.frombuffer(saved(content), np.uint8).reshape(-1, 1024)[:, :1020].tobytes()
    refused = 0
    for _ in range(400):
        damaged = bytearray(data)
        at = rng.choice([rng.randrange(8, 120), rng.randrange(len(data)), rng.randrange(len(data) - 2000, len(data))])
        match rng.randrange(3):
            case 0:
                damaged[at] ^= 1 << rng.randrange(8)
            case 1:
                damaged[at] = rng.choice(b'\0\xff0123456789<>"/ x')
            case 2:
                del damaged[at : at + rng.randrange(1, 9)]
        result = attempt(paged(bytes(damaged)))
        refused += result is None
        assert result is None or len(result.points) <= 500
    assert refused > 100


def test_lying_descriptions():
    good = file_of([(scaled(f"cartesian{a}", 0, 255), [1, 2, 3], 8) for a in "XYZ"], 3)
    assert attempt(good) is not None
    text = np.frombuffer(good, np.uint8).reshape(-1, 1024)[:, :1020].tobytes()
    section, xml = text[48 : text.index(b"<?xml")], text[text.index(b"<?xml") :].rstrip(b"\0")
    lies = [
        (b'recordCount="3"', b'recordCount="4"'), (b'recordCount="3"', b'recordCount="99999999999999"'),
        (b'recordCount="3"', b'recordCount="-1"'), (b'recordCount="3"', b""), (b'maximum="255"', b'maximum="65535"'),
        (b'maximum="255"', b'maximum="-9"'), (b'maximum="255"', b'maximum="99999999999999999999999"'),
        (b'fileOffset="48"', b'fileOffset="1021"'), (b'fileOffset="48"', b'fileOffset="52"'),
        (b"cartesianX", b"cartesianW"), (b'scale="0.001"', b'scale="nan"'), (b"ScaledInteger", b"Image"),
        (b"<?xml", b"<!DOCTYPE a><?xml"), (b"</data3D>", b""), (b"CompressedVector", b"Vector"),
        (b'scale="0.001"', b'scale="&a;"'), (b'maximum="255"', b'maximum="0"'),
        (b"<name", b'<pose type="Structure"><rotation type="Structure"><w type="Float">0</w></rotation></pose><name'),
        (b"<name", b'<pose type="Structure"><translation><x type="Float">inf</x></translation></pose><name'),
    ]  # fmt: skip
    for old, new in lies:
        assert old in xml
        assert attempt(assembled(section, xml.replace(old, new))) is None or new == b'maximum="0"', new
    nested = b"<a>" * 100_000 + b"</a>" * 100_000
    attempt(assembled(section, xml.replace(b"<name", nested + b"<name")))
    deep = b'<a type="Structure">' * 500 + b"</a>" * 500
    assert attempt(assembled(section, xml.replace(b"<cartesianX", deep + b"<cartesianX"))) is None


def test_no_scan_and_no_points():
    empty = saved(Content(np.empty((0, 3)), attributes={"intensity": np.empty(0, np.float32)}))
    content = attempt(empty)
    assert len(content.points) == 0 and content.attributes["intensity"].dtype == np.float32
    none = assembled(b"", f'<e57Root type="Structure" xmlns="{SPACE}"/>'.encode())
    assert len(attempt(none).points) == 0
