"""Exact solids, alone and with clouds: closed forms, most of them with faces that coincide."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball
from surfel import Box, Cylinder, HalfSpace, Intersection, Sphere

SPACING = 0.05


def at(shape, *vector):
    return shape.translated(vector)


def cube_mesh(size=2.0):
    x = 0.5 * size * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return surfel.Mesh(x, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


UNIT, TURNED = Sphere(1.0), Sphere(1.0).rotated((1.0, 2.0, 3.0), 40.0)
ROD = Cylinder(0.5, 2.0)
CASES = {
    "boxes that share a face": (Box(2) | at(Box(2), 2, 0, 0), 40.0),
    "what they have in common": (Box(2) & at(Box(2), 2, 0, 0), 0.0),
    "faces that overlap in part": (Box(2) | at(Box(2), 2, 1, 0), 44.0),
    "boxes shifted along a face": (Box(2) | at(Box(2), 1, 0, 0), 32.0),
    "a nested box": (Box(2) | at(Box(1), 0.5, 0, 0), 24.0),
    "the same cut out": (Box(2) - at(Box(1), 0.5, 0, 0), 28.0),
    "a pin on a box": (Box(2) | at(ROD, 0, 0, 2), 24.0 + 2.0 * PI),
    "a hole through a box": (Box(2) - ROD, 24.0 + 1.5 * PI),
    "equal spheres": (UNIT | TURNED, 4.0 * PI),
    "equal spheres in common": (UNIT & TURNED, 4.0 * PI),
    "a sphere without its equal": (UNIT - TURNED, 0.0),
    "a sphere without itself": (UNIT - UNIT, 0.0),
    "a box without its equal": (Box(2) - Box(2).rotated((0, 0, 1), 90.0), 0.0),
    "spheres that touch": (UNIT | at(UNIT, 2, 0, 0), 8.0 * PI),
    "a half-space in a face": (Box(2) & HalfSpace((0, 0, 1), 1.0), 24.0),
    "a half-space in the opposite face": (Box(2) & HalfSpace((0, 0, 1), -1.0), 0.0),
    "half a sphere": (UNIT & HalfSpace((0, 1, 1), 0.0), 3.0 * PI),
    "cylinders across": (
        Intersection(Cylinder(1.0, 4.0), Cylinder(1.0, 4.0).rotated((1, 0, 0), 90.0)), 16.0,
    ),
    "a mesh and a box of its size": (cube_mesh() | Box(2), 24.0),
    "a mesh without a box of its size": (cube_mesh() - Box(2), 0.0),
    "half a mesh": (cube_mesh() & HalfSpace((1, 0, 0), 0.0), 16.0),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_solids(name):
    tree, true = CASES[name]
    result = surfel.combine(tree, spacing=SPACING)
    assert area(result) == pytest.approx(true, rel=2e-3)
    if true == 0.0:
        assert len(result.surfels) == 0


def test_a_scan_minus_a_drill():
    drill = Cylinder(0.4, 4.0).rotated((1, 1, 0), 30.0)
    result = surfel.combine(ball(8000, 1) - drill)
    assert area(result) == pytest.approx(surfel.measure(Sphere(1) - drill).area.value, rel=1e-3)
    second = result.surfels.attributes["leaf"] == 1
    density = area(result) / len(result.surfels)
    wall = float(result.surfels.clips.areas[second].mean())
    assert wall == pytest.approx(density, rel=0.15)  # as dense as the scan
    assert surfel.measure(result.surfels, lines=4096).closed


def test_a_scan_cut_by_a_plane_and_by_a_mesh():
    half = surfel.combine(ball(8000, 1) & HalfSpace((0.2, 0.3, 1.0), 0.1))
    true = surfel.measure(Sphere(1) & HalfSpace((0.2, 0.3, 1.0), 0.1)).area.value
    assert area(half) == pytest.approx(true, rel=1e-3)
    corner = at(cube_mesh(), 1.0, 1.0, 1.0)
    assert area(surfel.combine(ball(8000, 1) - corner)) == pytest.approx(4.0 * PI - 0.5 * PI + 0.75 * PI, rel=1e-3)


def test_a_scan_without_the_exact_solid_of_its_shape_is_empty():
    assert len(surfel.combine(ball(5000) - Sphere(1)).surfels) == 0
    assert len(surfel.combine(Sphere(1) - ball(5000)).surfels) == 0
    assert area(surfel.combine(ball(5000) | Sphere(1))) == pytest.approx(4.0 * PI, rel=1e-3)


def test_a_vast_solid_costs_no_more_than_what_it_cuts():
    vast = Sphere(1e4).translated((0.0, 0.0, -1e4))
    result = surfel.combine(ball(5000) - vast)
    assert area(result) == pytest.approx(3.0 * PI, rel=2e-3)
    assert len(result.surfels) < 6000


def test_the_seed_decides_where_surfels_of_solids_lie():
    one, again, other = (surfel.combine(Box(2) - Sphere(1.2), spacing=0.1, seed=seed).surfels for seed in (1, 1, 2))
    assert np.array_equal(one.points, again.points)
    assert not np.array_equal(one.points, other.points)
