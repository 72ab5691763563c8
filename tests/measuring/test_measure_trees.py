"""Trees with areas in closed form, most of them with coincident faces; tolerances, pickles, and what is refused."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import surfel
from surfel import Box, Cylinder, Difference, HalfSpace, InputError, Intersection, Sphere, Union
from surfel._numba import threads_for

PI = math.pi


def at(shape, *vector):
    return shape.translated(vector)


def cube_mesh(size=2.0):
    x = 0.5 * size * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return surfel.Mesh(x, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


BALL = Sphere(1.0)
TURNED = Sphere(1.0).rotated((1.0, 2.0, 3.0), 40.0)
ROD = Cylinder(0.5, 2.0)
CASES = {
    # name: tree, area, volume
    "two boxes that share a face": (Box(2) | at(Box(2), 2, 0, 0), 40.0, 16.0),
    "what they have in common": (Box(2) & at(Box(2), 2, 0, 0), 0.0, 0.0),
    "one without the other": (Box(2) - at(Box(2), 2, 0, 0), 24.0, 8.0),
    "faces that overlap in part": (Box(2) | at(Box(2), 2, 1, 0), 48.0 - 4.0, 16.0),
    "boxes shifted along a common face": (Box(2) | at(Box(2), 1, 0, 0), 32.0, 12.0),
    "a nested box that shares a face": (Box(2) | at(Box(1), 0.5, 0, 0), 24.0, 8.0),
    "the same cut out": (Box(2) - at(Box(1), 0.5, 0, 0), 24.0 + 4.0, 7.0),
    "the same in common": (Box(2) & at(Box(1), 0.5, 0, 0), 6.0, 1.0),
    "a pin in a hole of its size": ((Box(2) - Cylinder(0.5, 4)) | ROD, 24.0, 8.0),
    "a hole of the height of the box": (Box(2) - ROD, 24.0 - 0.5 * PI + 2.0 * PI, 8.0 - 0.5 * PI),
    "a pin on a box": (Box(2) | at(ROD, 0, 0, 2), 24.0 + 2.0 * PI, 8.0 + 0.5 * PI),
    "equal spheres": (BALL | TURNED, 4.0 * PI, 4.0 * PI / 3.0),
    "equal spheres in common": (BALL & TURNED, 4.0 * PI, 4.0 * PI / 3.0),
    "a sphere without its equal": (BALL - TURNED, 0.0, 0.0),
    "a sphere without itself": (BALL - BALL, 0.0, 0.0),
    "a box without its copy": (Box(2) - Box(2), 0.0, 0.0),
    "a box without its equal, turned": (Box(2) - Box(2).rotated((0, 0, 1), 90.0), 0.0, 0.0),
    "a turned box without its equal": (Box(2).rotated((1, 2, 3), 33.0) - Box(2).rotated((1, 2, 3), 33.0), 0.0, 0.0),
    "spheres that touch": (BALL | at(BALL, 2, 0, 0), 8.0 * PI, 8.0 * PI / 3.0),
    "a half-space in a face": (Box(2) & HalfSpace((0, 0, 1), 1.0), 24.0, 8.0),
    "a half-space in the opposite face": (Box(2) & HalfSpace((0, 0, 1), -1.0), 0.0, 0.0),
    "a box less what lies beyond its face": (Box(2) - HalfSpace((0, 0, -1), -1.0), 24.0, 8.0),
    "half a box": (Box(2) & HalfSpace((1, 0, 0), 0.0), 16.0, 4.0),
    "half a sphere": (BALL & HalfSpace((0, 1, 1), 0.0), 3.0 * PI, 2.0 * PI / 3.0),
    "a thin slab": (Box((2, 2, 1e-6)) | at(Box((2, 2, 1e-6)), 0, 0, 1e-6), 8.0 + 16e-6, 8e-6),
    "a wall left thin": (Box(2) - at(Box(2), 0, 0, 1e-5), 8.0 + 8e-5, 4e-5),
    "a mesh and a box of its size": (cube_mesh() | Box(2), 24.0, 8.0),
    "a mesh less a box of its size": (cube_mesh() - Box(2), 0.0, 0.0),
    "a box less a mesh of its size": (Box(2) - cube_mesh(), 0.0, 0.0),
    "a mesh beside a box": (cube_mesh() | at(Box(2), 2, 0, 0), 40.0, 16.0),
    "a half of a mesh": (cube_mesh() & at(Box(2), 1, 0, 0), 16.0, 4.0),
    "two cylinders across": (
        Cylinder(1, 4) & Cylinder(1, 4).rotated((1, 0, 0), 90.0), 16.0, 16.0 / 3.0,
    ),
    "a tetrahedron of half-spaces": (
        Intersection(*(HalfSpace(n, 1 / math.sqrt(3)) for n in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)))),
        24.0 * math.sqrt(3.0) / 3.0, 8.0 / 3.0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("method", ["patches", "lines"])
@pytest.mark.parametrize("name", CASES)
def test_areas_and_volumes_of_touching_solids(name, method):
    tree, area, volume = CASES[name]
    if name.startswith("a tetrahedron"):  # normal . x <= offset, whatever the length of the normal
        edge = np.ptp(np.asarray(tree.bounds), axis=0).max() * math.sqrt(2.0)
        area, volume = math.sqrt(3.0) * edge**2, edge**3 / (6.0 * math.sqrt(2.0))
    found = surfel.measure(tree, method=method, lines=16_384)
    for told, true in ((found.area, area), (found.volume, volume)):
        if true == 0.0:
            assert told.value == 0.0
            continue
        assert abs(told.value - true) <= 4.0 * told.standard_error + 1e-12 * true
        assert told.standard_error <= 0.03 * true
    parts = [float(part.value) for part in found.areas]
    assert math.fsum(parts) == pytest.approx(found.area.value, rel=1e-12, abs=1e-12)


def test_bounds_that_oblique_planes_leave():
    normals = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3.0)
    corner = Intersection(*(HalfSpace(tuple(n), 1.0) for n in normals))
    assert np.abs(np.asarray(corner.bounds) - [[-math.sqrt(3.0)] * 3, [math.sqrt(3.0)] * 3]).max() < 1e-6


def test_a_tolerance_is_reached():
    tree = Box(20) - Sphere(13)
    for method in ("patches", "lines"):
        found = surfel.measure(tree, method=method, lines=1024, tolerance=0.005)
        for told in (found.area, found.volume):
            low, high = told.interval(0.95)
            if told is found.area or method == "lines":
                assert 0.5 * (high - low) <= 0.005 * told.value
        assert abs(found.area.value / 1752.8286 - 1.0) < 0.02


def test_trees_measure_the_same_on_one_and_two_threads_and_after_pickling():
    tree = (Box(2) - Sphere(1.2)) | at(Cylinder(0.3, 3), 0.9, 0, 0)
    copy = pickle.loads(pickle.dumps(tree))
    for method in ("patches", "lines"):
        with threads_for(10**9, 1):
            one = surfel.measure(tree, method=method, lines=20_000, seed=3)
        with threads_for(10**9, 2):
            two = surfel.measure(copy, method=method, lines=20_000, seed=3)
        for name in ("area", "volume", "centroid", "inertia"):
            assert np.array_equal(getattr(one, name).value, getattr(two, name).value)
            assert np.array_equal(getattr(one, name).standard_error, getattr(two, name).standard_error)


def test_a_leaf_that_is_known_by_its_equation_alone_is_measured_by_lines():
    ellipsoid = surfel.Quadric(np.diag([1.0, 0.25, 1.0, -1.0]))
    tree = ellipsoid - at(Box(2), 0, 2, 0)
    found = surfel.measure(tree, lines=16_384)
    assert found.method == "lines"
    with pytest.raises(InputError, match="take method='lines'"):
        surfel.measure(tree, method="patches")
    assert (
        abs(found.volume.value - surfel.measure(surfel.Ellipsoid((1, 2, 1)) - at(Box(2), 0, 2, 0)).volume.value) < 0.02
    )


@pytest.mark.parametrize("operation", [Union, Intersection, Difference])
def test_only_shapes_can_be_combined(operation):
    with pytest.raises(InputError, match=r"takes shapes; got ndarray; wrap points as surfel\.Surfels"):
        operation(Box(1), np.zeros((3, 3)))
    with pytest.raises(InputError, match="takes shapes; got int"):
        operation(3)
    for act in (lambda a, b: a | b, lambda a, b: a & b, lambda a, b: a - b):
        with pytest.raises(TypeError):
            act(Box(1), 2)
    if operation is not Union:
        with pytest.raises(InputError, match="at least one operand"):
            operation()
