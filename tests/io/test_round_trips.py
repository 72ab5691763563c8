"""What is written is read again, for every format and every kind of value; what is not is said."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import surfel
from surfel.core.errors import SurfelWarning

FULL = ("ply", "npz", "pcd")
TEXT = ("csv", "xyz")
TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
NAMES = st.text("abcdefghijklmnopqrstuvwxyz_0123456789", min_size=2, max_size=12).filter(lambda w: w.strip("_") == w)
TAKEN = {"x", "y", "z", "nx", "ny", "nz", "r", "g", "b", "a", "red", "green", "blue", "alpha", "radius", "rgb", "rgba",
         "points", "normals", "colors", "radii", "inf", "nan", "infinity"}  # fmt: skip

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
common = settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])


@st.composite
def clouds(draw):
    rows = draw(st.integers(1, 9))
    points = draw(hnp.arrays(np.float64, (rows, 3), elements=finite))
    normals = draw(st.none() | hnp.arrays(np.float64, (rows, 3), elements=st.floats(-1, 1)))
    radii = draw(st.none() | hnp.arrays(np.float64, rows, elements=st.floats(0, 1e9)))
    colors = draw(st.none() | hnp.arrays(np.uint8, st.sampled_from([(rows, 3), (rows, 4)])))
    attributes = {}
    for name in draw(st.lists(NAMES.filter(lambda w: w not in TAKEN), max_size=3, unique=True)):
        kind = np.dtype(draw(st.sampled_from(TYPES)))
        attributes[name] = draw(hnp.arrays(kind, rows))
    return surfel.Surfels(points, normals, radii, colors, attributes)


def there_and_back(cloud, suffix: str, **options):
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing may be lost
        path = Path(folder, f"a.{suffix}")
        surfel.write(path, cloud, **options)
        return surfel.read(path)


def same(a, b) -> None:
    assert (a is None) == (b is None)
    if a is not None:
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("ascii", [False, True])
@pytest.mark.parametrize("suffix", FULL)
@given(cloud=clouds())
@common
def test_formats_that_hold_everything(suffix, ascii, cloud):
    again = there_and_back(cloud, suffix, ascii=ascii)
    same(again.points, cloud.points)
    same(again.normals, cloud.normals)
    same(again.radii, cloud.radii)
    same(again.colors, cloud.colors)
    assert set(again.attributes) == set(cloud.attributes)
    for name, values in cloud.attributes.items():
        same(again.attributes[name], values)


@pytest.mark.parametrize("suffix", TEXT)
@given(cloud=clouds())
@common
def test_text_holds_all_values_as_doubles(suffix, cloud):
    again = there_and_back(cloud, suffix)
    same(again.points, cloud.points)
    same(again.normals, cloud.normals)
    same(again.radii, cloud.radii)
    if cloud.colors is not None:
        np.testing.assert_array_equal(again.colors, cloud.colors)
    for name, values in cloud.attributes.items():
        np.testing.assert_array_equal(again.attributes[name].astype(values.dtype), values)


@pytest.mark.parametrize("suffix", ["npy", "obj", "off"])
@given(points=hnp.arrays(np.float64, st.tuples(st.integers(1, 9), st.just(3)), elements=finite))
@common
def test_points_alone(suffix, points):
    same(there_and_back(points, suffix).points, points)


@given(
    stored=hnp.arrays(np.int32, st.tuples(st.integers(1, 9), st.just(3)), elements=st.integers(-(2**30), 2**30)),
    scale=st.sampled_from([0.01, 0.001, 0.0001, 0.00025]),
    offset=st.sampled_from([(0.0, 0.0, 0.0), (500_000.0, 4_000_000.0, 0.0), (0.5, -7.25, 1e5)]),
    suffix=st.sampled_from(["las", "laz"]),
    way=st.sampled_from(["ply", "npz", "csv", "pcd"]),
)
@common
def test_scaled_coordinates_come_back_to_the_last_stored_digit(stored, scale, offset, suffix, way):
    """LAS written, read, and written again: the same whole numbers; so through any format with doubles."""
    from surfel.io.content import Frame

    points = stored * scale + np.array(offset)
    cloud = surfel.Surfels(points, provenance={"frame": Frame((scale,) * 3, offset)})
    with tempfile.TemporaryDirectory() as folder:
        first, second, between = Path(folder, f"a.{suffix}"), Path(folder, f"b.{suffix}"), Path(folder, f"c.{way}")
        surfel.write(first, cloud)
        read = surfel.read(first)
        np.testing.assert_array_equal(np.rint((read.points - offset) / scale), stored)
        surfel.write(second, read)
        np.testing.assert_array_equal(surfel.read(second).points, read.points)
        surfel.convert(first, between)
        np.testing.assert_array_equal(surfel.read(between).points, read.points)


def test_the_frame_stays_with_a_part_of_the_cloud(tmp_path):
    points = np.array([[500_000.01, 4_000_000.02, 3.03], [500_001.5, 4_000_001.25, 2.0], [500_002.0, 4_000_002.0, 1.5]])
    surfel.write(tmp_path / "a.las", points)
    cloud = surfel.read(tmp_path / "a.las")
    part = cloud[np.array([True, False, True])]
    assert part.provenance["frame"] == cloud.provenance["frame"]
    surfel.write(tmp_path / "b.las", part)
    np.testing.assert_array_equal(surfel.read(tmp_path / "b.las").points, part.points)


@pytest.mark.parametrize("suffix", ["npy", "obj", "off", "pts", "e57", "las"])
def test_what_a_format_cannot_hold_is_said(tmp_path, suffix):
    rng = np.random.default_rng(0)
    cloud = surfel.Surfels(rng.random((4, 3)).round(2), radii=np.ones(4), attributes={"curl": np.array(list("abcd"))})
    with pytest.warns(SurfelWarning, match="curl"):
        surfel.write(tmp_path / f"a.{suffix}", cloud)
    surfel.write(tmp_path / "a.npz", cloud)
    assert any("curl" in lost for lost in surfel.convert(tmp_path / "a.npz", tmp_path / f"b.{suffix}")["lost"])
