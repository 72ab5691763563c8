"""Solids that are known by an equation alone: sampled by lines that cross them, and combined like all others."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import surfel
from booleans_with_truth import PI, area, ball
from surfel import Box, HalfSpace, Polynomial, Quadric, Sphere
from surfel.shapes.sample_lines import OfLines

SPACING = 0.05
SPHERE = Quadric(np.diag([1.0, 1.0, 1.0, -1.0]))
TURNED = Quadric(np.diag([1.0, 1.0, 1.0, -1.0])).transformed(np.diag([1.0, 0.6, 1.4, 1.0])).rotated((1, 2, 3), 50.0)
HYPERBOLOID = Quadric(np.diag([1.0, 1.0, -1.0, -0.09]))
RING = {  # (x^2 + y^2 + z^2 + R^2 - r^2)^2 = 4 R^2 (x^2 + y^2), R = .7, r = .25
    (4, 0, 0): 1.0, (0, 4, 0): 1.0, (0, 0, 4): 1.0, (2, 2, 0): 2.0, (2, 0, 2): 2.0, (0, 2, 2): 2.0,
    (2, 0, 0): 2.0 * 0.4275 - 1.96, (0, 2, 0): 2.0 * 0.4275 - 1.96, (0, 0, 2): 2.0 * 0.4275,
    (0, 0, 0): 0.4275**2,
}  # fmt: skip
TORUS = Polynomial(RING, within=Box((2.5, 2.5, 1.0)))


@pytest.mark.parametrize(
    ("shape", "region", "slope"),
    [
        (SPHERE, 1.5, lambda x: x),
        (HYPERBOLOID, 1.0, lambda x: x * [1.0, 1.0, -1.0]),
        (TORUS, 1.3, lambda x: x - 0.7 * x * [1, 1, 0] / np.hypot(x[:, 0], x[:, 1])[:, None]),
    ],
    ids=["sphere", "hyperboloid", "torus"],
)
def test_points_are_uniform_and_normals_exact(shape, region, slope):
    box = region * np.array([[-1.0] * 3, [1.0] * 3])
    source = OfLines(shape, box)
    exact = float(surfel.measure(shape & Box(2.0 * region), lines=1 << 14).area)
    if shape is not HYPERBOLOID:  # which the box cuts off, and that is surface too
        assert source.area == pytest.approx(exact, rel=0.03)
    points, normals = source.random(40_000, np.random.default_rng(0))
    assert len(points) == pytest.approx(40_000, rel=0.05)
    true = slope(points)
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    assert np.abs(normals - true).max() < 1e-7
    if shape is SPHERE:  # of a sphere, slices of one height have one area
        counts = np.histogram(points @ [0.6, 0.0, 0.8], np.linspace(-1, 1, 21))[0]
        assert np.abs(counts / len(points) * 20.0 - 1.0).max() < 0.12


def test_surfels_of_an_equation_lie_evenly():
    cloud = surfel.combine(surfel.Union(TURNED), spacing=SPACING).surfels
    known = surfel.combine(surfel.Union(Sphere(1.0).scaled((1.0, 0.6, 1.4)).rotated((1, 2, 3), 50.0)), spacing=SPACING)
    assert len(cloud) == pytest.approx(len(known.surfels), rel=0.03)
    nearest = cKDTree(cloud.points).query(cloud.points, 2)[0][:, 1]
    assert nearest.min() > 0.7 * SPACING
    assert nearest.mean() == pytest.approx(
        cKDTree(known.surfels.points).query(known.surfels.points, 2)[0][:, 1].mean(), rel=0.03
    )


CASES = {
    "two spheres": (SPHERE | SPHERE.translated((1.0, 0, 0)), Sphere(1.0) | Sphere(1.0).translated((1.0, 0, 0))),
    "half a sphere": (SPHERE & HalfSpace((0, 1, 1), 0.0), Sphere(1.0) & HalfSpace((0, 1, 1), 0.0)),
    "a box without an ellipsoid": (
        Box(2) - TURNED.translated((1.0, 0.4, 0.2)),
        Box(2) - Sphere(1.0).scaled((1.0, 0.6, 1.4)).rotated((1, 2, 3), 50.0).translated((1.0, 0.4, 0.2)),
    ),
    "a torus and a box": (TORUS | Box(0.8), surfel.Torus(0.7, 0.25) | Box(0.8)),
    "a torus without a rod": (TORUS - surfel.Cylinder(0.7, 4.0), surfel.Torus(0.7, 0.25) - surfel.Cylinder(0.7, 4.0)),
    "a sphere without its equal": (SPHERE - Sphere(1.0), None),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_areas_beside_the_same_solids_with_a_parametrization(name):
    tree, same = CASES[name]
    result = surfel.combine(tree, spacing=SPACING)
    if same is None:
        assert len(result.surfels) == 0
    else:
        assert area(result) == pytest.approx(float(surfel.measure(same, tolerance=3e-4).area), rel=2e-3)


def test_an_open_equation_within_a_tree_that_bounds_it():
    tree = HYPERBOLOID & Box((1.6, 1.6, 1.2))
    exact = surfel.measure(tree, lines=1 << 18)
    assert area(surfel.combine(tree, spacing=0.03)) == pytest.approx(float(exact.area), rel=3e-3)


def test_a_scan_and_equations():
    blob = SPHERE.scaled((0.5, 0.5, 0.5)).translated((1.0, 0.0, 0.0))
    result = surfel.combine(ball(8000, 1) - blob)
    true = float(surfel.measure(Sphere(1.0) - Sphere(0.5).translated((1.0, 0, 0)), tolerance=3e-4).area)
    assert area(result) == pytest.approx(true, rel=1e-3)
    second = result.surfels.attributes["leaf"] == 1
    density = area(result) / len(result.surfels)
    assert float(result.surfels.clips.areas[second].mean()) == pytest.approx(density, rel=0.15)  # as dense as the scan
    (line,) = result.curve
    x = 1.0 - 0.5 * 0.25  # x^2 + r^2 = 1 and (x - 1)^2 + r^2 = 1/4
    assert np.abs(line[:, 0] - x).max() < 2e-3
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(
        2.0 * PI * np.sqrt(1.0 - x * x), rel=2e-3
    )


def test_a_sheet_of_an_equation_is_trimmed_by_a_scan():
    saddle = Polynomial({(2, 0, 0): 1.0, (0, 2, 0): -1.0, (0, 0, 1): -1.0}, within=Box(4), capped=False)
    found = surfel.combine(saddle & ball(6000, 1), spacing=SPACING).surfels
    sheet = found[found.attributes["leaf"] == 0]
    assert np.abs(sheet.points[:, 2] - sheet.points[:, 0] ** 2 + sheet.points[:, 1] ** 2).max() < 1e-9
    exact = surfel.measure(saddle & Sphere(1.0), lines=1 << 18)
    assert float(sheet.clips.areas.sum()) == pytest.approx(float(exact.area), rel=5e-3)


def test_the_sheet_of_a_safe_spline_is_trimmed_by_a_solid():
    xy = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 2))
    sheet = surfel.bound(np.column_stack([xy, 0.2 * np.sin(3.0 * xy[:, 0]) * xy[:, 1]])).sheet()
    found = surfel.combine(sheet & Sphere(0.7), spacing=0.03)
    assert found.kept[1] == 0
    assert np.linalg.norm(found.surfels.points, axis=1).max() < 0.75
    assert area(found) == pytest.approx(float(surfel.measure(sheet & Sphere(0.7), lines=1 << 18).area), rel=4e-3)
