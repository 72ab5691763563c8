"""Volume, centroid and inertia against closed forms; intervals that hold what they promise."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel

AWAY = np.array([3.0, -1.0, 0.5])


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.box, truth.cylinder])
def test_solids_away_from_the_origin(shape, given):
    solid = shape(8000, 3).moved(AWAY)
    m = surfel.measure(surfel.Surfels(solid.points, normals=solid.normals if given else None), lines=32_768)
    assert m.closed and m.volume is not None
    assert m.volume.value == pytest.approx(solid.volume, rel=0.005)
    size = np.cbrt(solid.volume)
    np.testing.assert_allclose(m.centroid.value, solid.centroid, atol=0.004 * size)
    np.testing.assert_allclose(m.inertia.value, solid.inertia, atol=0.015 * np.abs(solid.inertia).max())
    np.testing.assert_array_equal(m.inertia.value, m.inertia.value.T)
    assert (np.asarray(m.centroid.standard_error) > 0).all() and m.volume.standard_error > 0
    assert m.volume.reliable and m.centroid.reliable


def test_intervals_hold_the_truth_for_most_seeds():
    held = {"area": 0, "volume": 0}
    for seed in range(12):
        solid = truth.torus(3000, 100 + seed)
        m = surfel.measure(surfel.Surfels(solid.points), lines=8192, seed=seed)
        for name, value in (("area", solid.area), ("volume", solid.volume)):
            low, high = getattr(m, name).interval(0.95)
            held[name] += low <= value <= high
            assert high - low < 0.2 * value  # an interval that holds everything tells nothing
    assert held["area"] >= 9 and held["volume"] >= 9


def test_a_tolerance_is_kept():
    solid = truth.torus(3000, 1)
    m = surfel.measure(surfel.Surfels(solid.points), method="lines", lines=1024, tolerance=0.01)
    assert m.lines > 2 * 1024
    m = surfel.measure(surfel.Mesh(*truth.box_mesh()), method="lines", lines=64, tolerance=0.003)
    low, high = m.area.interval(0.95)
    assert 0.5 * (high - low) <= 0.003 * m.area.value
    assert m.area.value == pytest.approx(6.0, rel=0.01)


def test_lines_and_patches_agree_within_their_errors():
    for shape in (truth.torus, truth.half_sphere):
        cloud = surfel.Surfels(shape(4000, 5).points)
        patches = surfel.measure(cloud, lines=16)
        lines = surfel.measure(cloud, method="lines", lines=65_536)
        assert (patches.method, lines.method) == ("patches", "lines")
        assert lines.area.value != patches.area.value
        error = np.sqrt(max(lines.area.standard_error**2 - patches.area.standard_error**2, 0.0))
        assert abs(lines.area.value - patches.area.value) < 4.0 * error + 1e-12
        assert error < 0.01 * patches.area.value


@pytest.mark.parametrize("turned", [False, True])
def test_meshes_are_exact(turned):
    sides = (1.0, 2.0, 3.0)
    vertices, triangles = truth.box_mesh(sides)
    turn = truth.rotation(2) if turned else np.eye(3)
    expected = truth.box(10, 0, sides)
    m = surfel.measure(surfel.Mesh(vertices @ turn.T + AWAY, triangles))
    assert m.area.value == pytest.approx(22.0, rel=1e-14) and m.volume.value == pytest.approx(6.0, rel=1e-13)
    np.testing.assert_allclose(m.centroid.value, AWAY, atol=1e-13)
    np.testing.assert_allclose(m.inertia.value, turn @ expected.inertia @ turn.T, atol=1e-12)
    for estimate, value in ((m.area, 22.0), (m.volume, 6.0)):
        low, high = estimate.interval(0.999)
        assert low <= value <= high and high - low < 1e-12 * value
    assert m.closed and m.leak == 0.0 and m.lines == 0


def test_an_inverted_mesh_is_the_same_solid_and_says_so():
    vertices, triangles = truth.box_mesh()
    m = surfel.measure(surfel.Mesh(vertices + AWAY, triangles[:, ::-1]))
    assert m.volume.value == pytest.approx(1.0) and m.area.value == pytest.approx(6.0)
    np.testing.assert_allclose(m.centroid.value, AWAY)
    assert np.linalg.eigvalsh(m.inertia.value).min() > 0
    assert any("inward" in text for text in m.warnings)


def test_an_open_mesh_has_an_area_but_no_volume():
    vertices, triangles = truth.box_mesh()
    m = surfel.measure(surfel.Mesh(vertices, triangles[:-1]))
    assert m.area.value == pytest.approx(5.5) and m.volume is None and m.centroid is None and not m.closed
    assert any("open" in text for text in m.warnings)
    flipped = triangles.copy()
    flipped[0] = flipped[0, ::-1]  # every edge has two triangles, but one faces the wrong way
    assert not surfel.measure(surfel.Mesh(vertices, flipped)).closed


def test_a_mesh_without_triangles_measures_nothing():
    m = surfel.measure(surfel.Mesh(np.zeros((3, 3)), np.empty((0, 3), int)))
    assert m.area.value == 0.0 and m.volume is None and m.warnings
    assert surfel.measure(surfel.Mesh(np.zeros((3, 3)), np.empty((0, 3), int)), method="lines").area.value == 0.0


@pytest.mark.parametrize("model", ["tangent", "chord", "offset"])
@pytest.mark.parametrize("sequence", ["niederreiter", "r4", "sobol", "halton", "random"])
def test_meshes_by_lines_of_every_kind(model, sequence):
    mesh = surfel.Mesh(*truth.box_mesh((1.0, 2.0, 3.0)))
    m = surfel.measure(mesh, method="lines", lines=16_384, model=model, sequence=sequence)
    assert abs(m.area.value - 22.0) < 5.0 * m.area.standard_error + 1e-5 * 22.0
    assert abs(m.volume.value - 6.0) < 5.0 * m.volume.standard_error + 1e-5 * 6.0
    assert m.area.standard_error < 0.03 * 22.0
    assert m.method == "lines" and m.leak < 1e-3
