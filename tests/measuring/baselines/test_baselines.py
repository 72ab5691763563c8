"""The baselines find known areas, converge, and keep to one interface; their functions and ranges are right."""

import math

import numpy as np
import pytest

from surfel import Torus
from surfel._numba import kernel
from surfel.core.errors import InputError, MissingExtraError
from surfel.measuring.baselines import BASELINES, Reading, marching_cubes, random_lines, subdivision
from surfel.measuring.baselines.functions import bending, gradient_at, range_over, value_at
from surfel.measuring.baselines.implicit import implicit_of
from surfel.measuring.baselines.marching_cubes import field_on_grid
from surfel.shapes.mesh import Mesh
from surfel.shapes.primitives.box import Box
from surfel.shapes.primitives.cylinder import Cone, Cylinder
from surfel.shapes.primitives.ellipsoid import Ellipsoid, Sphere
from surfel.shapes.primitives.half_space import HalfSpace
from surfel.shapes.primitives.quadric import Quadric
from surfel.shapes.tree import Union

RNG = np.random.default_rng(21)
SKEW = np.array([[1.0, 0.3, 0, 0.1], [0, 0.7, 0.5, -0.2], [0.2, 0, -1.4, 0.3], [0, 0, 0, 1.0]])
TURN = np.array([[0.36, 0.48, -0.8, 1.0], [-0.8, 0.6, 0.0, 0.5], [0.48, 0.64, 0.6, -1.0], [0, 0, 0, 1.0]])

PRIMITIVES = {
    "half-space": HalfSpace((1, 2, 3), 0.5) & Box(4),
    "box": Box((1, 2, 3)),
    "sphere": Sphere(1.5),
    "ellipsoid": Ellipsoid((1, 2, 1.5)),
    "cylinder": Cylinder(1, 2.5),
    "cone": Cone(1.5, 0, 2),
    "frustum": Cone(0.5, 1.5, 2),
    "torus": Torus(1.4, 0.5),
    "quadric": Quadric(np.diag([1.0, 1.0, -0.5, -0.4])) & Box(3),
}

SOLIDS = [
    ("cube", Box(20), 2400.0),
    ("turned cube", Box(2).transformed(TURN), 24.0),
    ("sphere", Sphere(10), 400 * math.pi),
    ("cylinder", Cylinder(10, 20), 600 * math.pi),
    ("cone", Cone(3, 0, 4), 24 * math.pi),
    ("torus", Torus(3, 1), 12 * math.pi**2),
    ("skeleton", Box(20) - Sphere(13), 1752.8284),
    ("turned skeleton", (Box(20) - Sphere(13)).transformed(TURN), 1752.8284),
    ("two boxes that share a face", Box(2) | Box(2).translated((2, 0, 0)), 40.0),
    ("steps with faces in one plane", Box(2) | Box((2, 2, 1)).translated((2, 0, -0.5)), 36.0),
    ("cylinder on its like", Cylinder(1, 2) | Cylinder(1, 3).translated((0, 0, 2.5)), 12 * math.pi),
    ("lens", Sphere(2) & Sphere(2).translated((2, 0, 0)), 8 * math.pi),
    ("ball in a ball", Sphere(2) - Sphere(1), 20 * math.pi),
    ("nothing left", Box(2) - Box(2), 0.0),
    ("empty", Union(), 0.0),
    ("less nothing", Box(2) - Union(), 24.0),
    ("and nothing", (Box(2) & Union()) | Box(2).translated((5, 0, 0)), 24.0),
]


@pytest.mark.parametrize(("name", "shape", "area"), SOLIDS)
def test_subdivision_finds_the_area(name, shape, area):
    reading = subdivision(shape, 15)
    assert isinstance(reading, Reading) and reading.seconds >= 0.0
    assert reading.area == pytest.approx(area, rel=2.5e-3, abs=1e-9)
    assert (reading.elements > 0) == (area > 0.0)


def test_subdivision_is_exact_on_planes_whatever_the_effort():
    for effort in (1, 7, 30):
        assert subdivision(Box(20), effort).area == pytest.approx(2400.0, rel=1e-12)
    plates = Union(*(Box((1, 5, 5)).translated((3 * k, 0, 0)) for k in range(5)))
    assert subdivision(plates.transformed(TURN), 2).area == pytest.approx(5 * 70.0, rel=1e-10)


def test_subdivision_converges():
    errors = [abs(subdivision(Sphere(1), effort).area / (4 * math.pi) - 1.0) for effort in (4, 8, 16)]
    assert errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1] < 0.002


def test_long_strips_along_a_cylinder():
    assert subdivision(Cylinder(1, 2), 16).elements < 0.25 * subdivision(Sphere(1), 16).elements


def test_many_leaves():
    grid = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    cheese = Box(12) - Union(*(Sphere(1).translated(np.multiply(4, place)) for place in grid))
    assert subdivision(cheese, 12).area == pytest.approx(864 + 27 * 4 * math.pi, rel=1e-3)


@pytest.mark.parametrize(("name", "shape", "area"), SOLIDS)
def test_random_lines(name, shape, area):
    reading = random_lines(shape, 20_000)
    assert reading.elements == 20_000
    assert reading.area == pytest.approx(area, rel=0.05, abs=1e-9)


def test_runs_that_start_elsewhere_are_independent():
    areas = [random_lines(Box(20), 4096, start=4096 * k).area for k in range(16)]
    assert len(set(areas)) == 16 and np.mean(areas) == pytest.approx(2400.0, rel=0.02)
    assert 0.003 < np.std(areas) / 2400.0 < 0.04


def test_low_discrepancy_lines_are_nearer_than_random_ones():
    errors = {
        name: np.sqrt(
            np.mean(
                [
                    (random_lines(Box(20), 16_384, sequence=name, shift=s).area / 2400 - 1) ** 2
                    for s in RNG.random((8, 4))
                ]
            )
        )
        for name in ("random", "niederreiter")
    }
    assert errors["niederreiter"] < 0.6 * errors["random"] < 0.01


def test_marching_cubes():
    pytest.importorskip("skimage")
    assert marching_cubes(Sphere(10), 50).area == pytest.approx(400 * math.pi, rel=2e-3)
    assert marching_cubes(Box(20), 80).area == pytest.approx(2400.0, rel=0.03)
    assert marching_cubes(Torus(3, 1), 60).area == pytest.approx(12 * math.pi**2, rel=5e-3)
    assert marching_cubes(Box(2) - Box(2), 10) == (0.0, 0, pytest.approx(0.0, abs=60.0))


def test_marching_cubes_say_which_extra_is_missing(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "skimage", None)
    with pytest.raises(MissingExtraError, match="bench"):
        marching_cubes(Sphere(1), 10)


@kernel
def probed(row, x, y, z, hx, hy, hz):
    low, high = range_over(row, x, y, z, hx, hy, hz)
    return value_at(row, x, y, z), gradient_at(row, x, y, z), low, high, bending(row, x, y, z, hx, hy, hz)


@pytest.mark.parametrize("matrix", [np.eye(4), TURN, SKEW], ids=["here", "turned", "skewed"])
@pytest.mark.parametrize("name", list(PRIMITIVES))
def test_functions_are_negative_inside(name, matrix):
    shape = PRIMITIVES[name].transformed(matrix)
    implicit = implicit_of(shape)
    low, high = shape.bounds
    points = 24
    step = 1.1 * float((high - low).max()) / points
    start = 0.5 * (low + high) - 0.5 * step * points
    field = field_on_grid(implicit, start, step, points + 1)
    grid = start + step * np.stack(np.meshgrid(*[np.arange(points + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    sure = np.abs(field.ravel()) > 1e-9
    assert sure.mean() > 0.9 and (shape.contains(grid) == (field.ravel() < 0.0))[sure].all()


@pytest.mark.parametrize("matrix", [np.eye(4), SKEW], ids=["here", "skewed"])
@pytest.mark.parametrize("name", list(PRIMITIVES))
def test_ranges_hold_every_value_and_gradients_are_differences(name, matrix):
    functions = implicit_of(PRIMITIVES[name].transformed(matrix)).functions
    for row in functions:
        for size in (1.0, 0.1):
            for centre in RNG.uniform(-2, 2, (10, 3)):
                half = size * RNG.random(3)
                _, gradient, low, high, _ = probed(row, *centre, *half)
                values = [probed(row, *p, *half)[0] for p in RNG.uniform(centre - half, centre + half, (30, 3))]
                assert low <= min(values) and max(values) <= high
                ends = [[probed(row, *(centre + s * h), *half)[0] for s in (-1, 1)] for h in 1e-5 * np.eye(3)]
                assert np.allclose(gradient, np.diff(ends)[:, 0] / 2e-5, rtol=1e-4, atol=1e-4)
                assert high - low < 40.0 * (np.abs(gradient) @ half + (half @ half))


@pytest.mark.parametrize("name", ["sphere", "ellipsoid", "torus", "quadric", "cone"])
def test_bending_is_how_far_gradients_turn(name):
    for row in implicit_of(PRIMITIVES[name].transformed(SKEW)).functions:
        for centre in RNG.uniform(-2, 2, (10, 3)):
            half = np.full(3, 1e-4)
            _, g, _, _, turns = probed(row, *centre, *half)
            for k, h in enumerate(np.diag(half)):
                moved = np.array(probed(row, *(centre + h), *half)[1])
                angle = np.linalg.norm(np.cross(g, moved)) / np.linalg.norm(g) / np.linalg.norm(moved)
                assert turns[k] == pytest.approx(angle, rel=0.02, abs=1e-9)


@pytest.mark.parametrize("method", [subdivision, marching_cubes])
def test_what_has_no_function_is_refused(method):
    pytest.importorskip("skimage")
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    with pytest.raises(InputError, match="a Mesh has no implicit function"):
        method(mesh | Box(1), 10)
    with pytest.raises(InputError, match="unbounded"):
        method(Union(HalfSpace((0, 0, 1), 0)), 10)
    with pytest.raises(InputError, match="effort"):
        method(Box(1), 0)


def test_one_interface():
    pytest.importorskip("skimage")
    for method in BASELINES.values():
        area, elements, seconds = method(Sphere(1), 30)
        assert abs(area / (4 * math.pi) - 1) < 0.5 and elements > 0 and seconds >= 0.0
