"""Areas and volumes of polynomial surfaces against closed forms and quadrature that knows nothing of lines."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

import surfel
from polynomials_with_truth import (
    X,
    Y,
    Z,
    barth_area,
    barth_sextic,
    cyclide,
    cyclide_area,
    heart,
    heart_area,
    rounded_cube,
    rounded_cube_area,
    sphere,
    torus,
    torus_area,
)
from surfel import Box, Polynomial, Sphere
from surfel.lines.models import lines_through_ball
from surfel.lines.sequences import unit_points

FRAME = np.linalg.qr(np.random.default_rng(11).standard_normal((3, 3)))[0]

SURFACES = {
    "sphere": lambda: (Polynomial(sphere(), Box(2.5)), 4.0 * math.pi),
    "torus": lambda: (Polynomial(torus(1.0, 0.4), Box((2.9, 2.9, 0.9))), torus_area(1.0, 0.4)),
    "cyclide": lambda: (Polynomial(cyclide(1.0, 0.9, 0.6), Sphere(2.1)), cyclide_area(1.0, 0.9, 0.6)),
    "rounded cube 4": lambda: (Polynomial(rounded_cube(4), Box(2.2)), rounded_cube_area(4)),
    "rounded cube 6": lambda: (Polynomial(rounded_cube(6), Box(2.2)), rounded_cube_area(6)),
    "heart": lambda: (Polynomial(heart(), Box((2.4, 1.6, 2.6))), heart_area()),
    "Barth sextic": lambda: (Polynomial(barth_sextic(), Sphere(1.6), capped=False), barth_area(1.6)),
    "half a ball": lambda: (
        Polynomial(sphere(), Box((2.5, 2.5, 1.25)).translated((0.0, 0.0, -0.625))),
        3.0 * math.pi,
    ),
    "half a sphere": lambda: (
        Polynomial(sphere(), Box((2.5, 2.5, 1.25)).translated((0.0, 0.0, -0.625)), capped=False),
        2.0 * math.pi,
    ),
    "lens": lambda: (Polynomial(sphere(1.0, (0.0, 0.0, 1.0)), Sphere(1.0)), 2.0 * math.pi),
    "crossing planes": lambda: (Polynomial(X * Y, Box(2.0), capped=False), 8.0),
    "paraboloid": lambda: (
        Polynomial(X**2 + Y**2 - Z, Box((4.0, 4.0, 2.0)), capped=False),
        math.pi / 6.0 * (5.0**1.5 - 1.0),
    ),
}


@cache
def surface_and_truth(name):
    return SURFACES[name]()


def area_by_bundles(shape, side):
    """The area as the sum of |n . d| over lines along three directions at right angles: the squares sum to one.

    The sum over a plane is smooth but at silhouettes, so that few lines do.
    """
    low, high = shape.bounds
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    steps = ((np.arange(side) + 0.5) / side * 2.0 - 1.0) * radius
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    disk = u * u + v * v < radius * radius
    u, v = u[disk], v[disk]
    total = 0.0
    for axis in range(3):
        a, b, d = FRAME[axis - 2], FRAME[axis - 1], FRAME[axis]
        origins = middle + u[:, None] * a + v[:, None] * b
        hits = shape.cross(surfel.Lines.of(origins, np.broadcast_to(d, origins.shape), 1.0))
        total += float(np.abs(hits.cosine).sum())
    return total * (2.0 * radius / side) ** 2


def volume_by_bundle(shape, side):
    low, high = shape.bounds
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    steps = ((np.arange(side) + 0.5) / side * 2.0 - 1.0) * radius
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    origins = middle + u[:, None] * FRAME[0] + v[:, None] * FRAME[1]
    hits = shape.cross(surfel.Lines.of(origins, np.broadcast_to(FRAME[2], origins.shape), 1.0))
    return float((hits.t * np.sign(hits.cosine)).sum()) * (2.0 * radius / side) ** 2


@pytest.mark.parametrize("name", SURFACES)
def test_area_from_bundles_of_lines(name):
    shape, truth = surface_and_truth(name)
    assert area_by_bundles(shape, 200) == pytest.approx(
        truth, rel=1e-3 if shape.capped else 3e-3
    )  # a sheet has a border


@pytest.mark.slow
@pytest.mark.parametrize("name", SURFACES)
def test_the_limit_of_the_area_at_a_million_lines(name):
    shape, truth = surface_and_truth(name)
    side = 652 if shape.capped else 1000  # three disks of side^2 pi / 4 lines; a sheet's border needs some more
    assert area_by_bundles(shape, side) == pytest.approx(truth, rel=1e-4)


@pytest.mark.parametrize("name", ["torus", "half a ball", "Barth sextic"])
def test_area_by_cauchy_and_crofton(name):
    shape, truth = surface_and_truth(name)
    low, high = shape.bounds
    radius = 0.5 * float(np.linalg.norm(high - low))
    lines = lines_through_ball(unit_points("r4", 0, 100_000), 0.5 * (low + high), radius)
    area = float((lines.weights * shape.cross(lines).counts).sum()) / math.pi
    assert area == pytest.approx(truth, rel=6e-3)


@pytest.mark.parametrize(
    ("name", "truth"),
    [
        ("sphere", 4.0 / 3.0 * math.pi),
        ("torus", 2.0 * math.pi**2 * 0.16),
        ("half a ball", 2.0 / 3.0 * math.pi),
        ("lens", 5.0 / 12.0 * math.pi),
    ],
)
def test_volume(name, truth):
    shape, _ = surface_and_truth(name)
    assert volume_by_bundle(shape, 400) == pytest.approx(truth, rel=5e-4)


def test_area_under_an_affine_map():
    matrix = np.diag([2.0, -1.0, 0.5, 1.0])  # an ellipsoid, mirrored
    shape = Polynomial(sphere(), Box(2.1)).transformed(matrix)
    other = Polynomial(0.25 * X**2 + Y**2 + 4.0 * Z**2 - 1.0, Box(4.4))
    assert area_by_bundles(shape, 400) == pytest.approx(area_by_bundles(other, 400), rel=2e-3)
    assert volume_by_bundle(shape, 400) == pytest.approx(4.0 / 3.0 * math.pi, rel=1e-3)
