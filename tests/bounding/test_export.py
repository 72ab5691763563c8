"""What leaves the house is the same surface: by SciPy, in a 3DM file, in our own file; and lying files are refused."""

from __future__ import annotations

import io
import json
import sys
import zipfile

import numpy as np
import pytest
from scipy.interpolate import BSpline

import surfel
from surfel import FileFormatError, InputError, MissingExtraError
from surfel.bounding import export
from surfel.bounding.spline import SafeSpline

PLACED = {"direction": (0.3, -0.5, 0.8), "low": (-3.0, 2.0), "scale": (2.0, 0.5)}


def test_scipy_evaluates_the_same_surface(make_spline):
    spline = make_spline(**PLACED)
    uv = np.random.default_rng(0).uniform([0.0, 0.0], [8.0, 6.0], (2000, 2))
    uv[:4] = [[0, 0], [8, 6], [0, 6], [8, 0]]
    theirs = spline.to_scipy()
    np.testing.assert_allclose(theirs(uv), spline(uv), atol=1e-14)
    np.testing.assert_allclose(theirs(uv, nu=(1, 0)), spline.gradient(uv)[:, 0], atol=1e-13)
    assert np.isnan(theirs([[8.5, 1.0], [-0.1, 1.0]])).all()


def surface_of(path):
    """Return control points and full clamped knots of the surface in a 3DM file."""
    points, knots = export.read_surface(path)
    return points, [np.array([k[0], *k, k[-1]]) for k in knots]


@pytest.mark.parametrize("side", ["above", "below"])
@pytest.mark.parametrize("where", [{}, PLACED, {"low": (4e6, -3e5), "scale": (0.01, 0.02)}])
def test_the_nurbs_surface_is_the_graph_and_safe(make_spline, tmp_path, side, where):
    pytest.importorskip("rhino3dm")
    spline = make_spline(side=side, **where)
    spline.to_3dm(tmp_path / "a.3dm")
    points, knots = surface_of(tmp_path / "a.3dm")
    uv = np.random.default_rng(1).uniform([0.0, 0.0], [8.0, 6.0], (1000, 2))
    u, v = (BSpline.design_matrix(uv[:, k], knots[k], 3).toarray() for k in (0, 1))
    graph = np.einsum("ki,kj,ijc->kc", u, v, points)
    expected = spline.frame.to_world(uv, spline(uv))
    np.testing.assert_allclose(graph, expected, atol=2e-13 * np.abs(expected).max() + 1e-14)
    place, heights = spline.to_domain(graph)
    inside = ((place >= 0.0) & (place <= [8.0, 6.0])).all(axis=1)
    beyond = heights[inside] - spline(place[inside])
    assert (beyond > 0.0).all() if side == "above" else (beyond < 0.0).all()


def test_the_file_holds_the_outlines_of_the_trim(make_spline, tmp_path):
    rhino = pytest.importorskip("rhino3dm")
    occupancy = np.zeros((8, 6), np.uint8)
    occupancy[1:3, 1:3] = occupancy[5:7, 4] = 15
    spline = make_spline(occupancy=occupancy)
    spline.to_3dm(tmp_path / "a.3dm")
    items = list(rhino.File3dm.Read(str(tmp_path / "a.3dm")).Objects)
    assert sorted(item.Attributes.Name for item in items) == ["safe spline", "trim", "trim"]
    assert all(item.Geometry.IsValid for item in items)
    curve = next(item.Geometry for item in items if item.Attributes.Name == "trim")
    assert curve.IsClosed
    ends = curve.PointAtStart
    uv, heights = spline.to_domain([[ends.X, ends.Y, ends.Z]])
    np.testing.assert_allclose(spline(uv, trimmed=False), heights, atol=1e-12)


def test_a_file_that_reads_back_differently_is_not_kept(make_spline, tmp_path, monkeypatch):
    pytest.importorskip("rhino3dm")
    spline, target = make_spline(), tmp_path / "a.3dm"
    target.write_bytes(b"old")
    honest = export.read_surface

    def rounded(path):
        points, knots = honest(path)
        return points.astype(np.float32).astype(float), knots

    monkeypatch.setattr(export, "read_surface", rounded)
    with pytest.raises(export.SurfelError, match="read back"):
        spline.to_3dm(target)
    assert target.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["a.3dm"]


def test_without_rhino_the_extra_is_named(make_spline, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rhino3dm", None)
    with pytest.raises(MissingExtraError, match="cad"):
        make_spline().to_3dm(tmp_path / "a.3dm")
    assert not list(tmp_path.iterdir())


def test_saved_and_loaded_is_the_same(make_spline, tmp_path):
    spline = make_spline(side="below", **PLACED)
    spline.save(tmp_path / "a.npz")
    spline.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = SafeSpline.load(tmp_path / "a.npz")
    for name in ("coefficients", "occupancy", "trim"):
        np.testing.assert_array_equal(getattr(again, name), getattr(spline, name))
    for name in ("rotation", "low", "scale", "cells"):
        np.testing.assert_array_equal(getattr(again.frame, name), getattr(spline.frame, name))
    assert (again.side, again.boundary, again.report, again.shape) == ("below", "open", spline.report, spline.shape)


def test_what_is_remembered_of_the_points_travels_too(tmp_path):
    points = np.random.default_rng(0).random((600, 3))
    fitted = surfel.bound(points, shape=(6, 5), mode="tight")
    fitted.save(tmp_path / "a.npz")
    again = SafeSpline.load(tmp_path / "a.npz")
    assert again.report == fitted.report and again.verify(points) == (0, 0.0)
    known, remembered = fitted.memory.to_arrays(), again.memory.to_arrays()
    assert known.keys() == remembered.keys()
    for name, array in known.items():
        np.testing.assert_array_equal(array, remembered[name])
    np.testing.assert_array_equal(again.refitted().coefficients, fitted.refitted().coefficients)


def altered(data, name, change):
    """Return the bytes of an NPZ with one array changed; None takes it away."""
    arrays = dict(np.load(io.BytesIO(data)))
    new = change(arrays.pop(name).copy())
    if new is not None:
        arrays[name] = new
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def words(**changes):
    def change(array):
        known = json.loads(array.tobytes())
        return np.frombuffer(json.dumps({**known, **changes}).encode(), np.uint8)

    return change


def set_nan(array):
    array[0, 0] = np.nan
    return array


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("coefficients", set_nan, "not finite"),
        ("coefficients", lambda a: a[:-1], "expected shape"),
        ("coefficients", lambda a: a.astype(np.float32), "float64"),
        ("coefficients", lambda a: None, "absent"),
        ("trim", lambda a: a * 0, "leaves out"),
        ("trim", lambda a: a + 1, "expected 0 to 15"),
        ("rotation", lambda a: 2.0 * a, "orthonormal"),
        ("scale", lambda a: -a, "grid"),
        ("cells", lambda a: a * 0, "grid"),
        ("cells", lambda a: a + 1, "expected shape"),
        ("words", lambda a: None, "no safe spline"),
        ("words", lambda a: a[:-3], "no safe spline"),
        ("words", words(kind="soup"), "'soup'"),
        ("words", words(version=99), "version 99"),
        ("words", words(side="left"), "'left'"),
        ("words", words(report={"mode": "fast"}), "garbled"),
        ("words", words(report=[]), "garbled"),
    ],
)
def test_lying_files_are_refused(make_spline, tmp_path, name, change, said):
    make_spline().save(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(altered((tmp_path / "a.npz").read_bytes(), name, change))
    with pytest.raises(FileFormatError, match=said):
        SafeSpline.load(tmp_path / "b.npz")


def test_cut_and_flipped_files_are_refused_or_read_right(make_spline, tmp_path):
    spline, path = make_spline(), tmp_path / "a.npz"
    spline.save(path)
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    for cut in rng.integers(0, len(data), 20):
        path.write_bytes(data[:cut])
        with pytest.raises((FileFormatError, InputError)):
            SafeSpline.load(path)
    for place in rng.integers(0, len(data), 200):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        try:
            again = SafeSpline.load(path)
        except FileFormatError:
            continue
        np.testing.assert_array_equal(again.coefficients, spline.coefficients)


def test_other_files_and_no_file(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"something else")
    with pytest.raises(FileFormatError, match=r"SafeSpline\.save"):
        SafeSpline.load(tmp_path / "a.npz")
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("points.txt", "1 2 3")
    with pytest.raises(FileFormatError):
        SafeSpline.load(tmp_path / "b.npz")
    with pytest.raises(InputError, match="no such file"):
        SafeSpline.load(tmp_path / "c.npz")


def test_a_failed_save_leaves_the_old_file(make_spline, tmp_path):
    with pytest.raises(InputError, match="folder"):
        make_spline().save(tmp_path / "no" / "a.npz")
