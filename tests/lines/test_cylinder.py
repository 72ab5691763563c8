"""The enclosing cylinder holds its points and is small; lines through it have the invariant measure."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surfel.core.errors import InputError
from surfel.lines.box import OrientedBox
from surfel.lines.cylinder import EnclosingCylinder, enclosing_cylinder
from surfel.lines.enclosing import smallest_ball
from surfel.lines.models import line_block, lines_through_cylinder
from surfel.lines.sequences import unit_points

RNG = np.random.default_rng(11)
TURN = Rotation.random(random_state=3).as_matrix()


def rod(number=4000, radius=1.0, half=8.0):
    angle = RNG.uniform(0.0, 2.0 * np.pi, number)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), RNG.uniform(-half, half, number)], axis=1)


def clouds():
    normal = RNG.standard_normal((3000, 3))
    yield "normal", normal
    yield "turned rod", rod() @ TURN + [5.0, -3.0, 2.0]
    yield "plane", normal * [3.0, 1.0, 0.0] @ TURN
    yield "line", normal * [0.0, 1.0, 0.0] @ TURN
    yield "point", np.full((10, 3), 4.0)
    yield "two points", normal[:2]
    yield "far away", normal + 1e6
    yield "huge", normal * 1e100
    yield "tiny", normal * 1e-100


@pytest.mark.parametrize(("name", "points"), list(clouds()))
def test_holds_all_points(name, points):
    found = enclosing_cylinder(points)
    size = max(np.abs(points - points.mean(axis=0)).max(), 1e-300)
    slack = 1e-12 * size + 1e-15 * np.abs(points).max()
    local = (points - found.centre) @ found.axes.T
    assert np.abs(found.axes @ found.axes.T - np.eye(3)).max() < 1e-13 and np.linalg.det(found.axes) > 0.99
    assert np.hypot(local[:, 0], local[:, 1]).max() <= found.radius + slack
    assert np.abs(local[:, 2]).max() <= found.half_height + slack


def test_finds_a_turned_rod_again_and_it_is_tighter_than_a_ball():
    points = rod(20_000) @ TURN
    found = enclosing_cylinder(points)
    assert found.radius == pytest.approx(1.0, rel=2e-3) and found.half_height == pytest.approx(8.0, rel=2e-3)
    assert abs(found.axes[2] @ TURN[2]) == pytest.approx(1.0, abs=1e-5)
    assert found.surface < 0.15 * smallest_ball(points).surface
    assert found.grown(0.5).radius == found.radius + 0.5


def crossings_of_sphere(lines, centre, radius):
    offset = lines.origins - centre
    along = np.einsum("ij,ij->i", offset, lines.directions)
    return 2.0 * (np.einsum("ij,ij->i", offset, offset) - along**2 < radius**2)


@pytest.mark.parametrize(("radius", "half"), [(1.0, 1.0), (3.0, 0.2), (0.5, 4.0), (2.0, 0.0)])
def test_every_line_hits_the_cylinder_and_its_foot_is_nearest(radius, half):
    body = EnclosingCylinder(np.array([1.0, 2.0, 3.0]), TURN, radius, half)
    lines = lines_through_cylinder(unit_points("niederreiter", 0, 4096), body)
    assert np.allclose(np.linalg.norm(lines.directions, axis=1), 1.0, atol=1e-14)
    local, along = (lines.origins - body.centre) @ TURN.T, lines.directions @ TURN.T
    assert np.abs(np.einsum("ij,ij->i", local, along)).max() < 1e-13 * (radius + half)
    a = (along[:, :2] ** 2).sum(axis=1)
    b = (local[:, :2] * along[:, :2]).sum(axis=1)
    gap = b**2 - a * ((local[:, :2] ** 2).sum(axis=1) - radius**2)
    root = np.sqrt(np.maximum(gap, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = np.sort([(-half - local[:, 2]) / along[:, 2], (half - local[:, 2]) / along[:, 2]], axis=0)
        first, last = np.maximum((-b - root) / a, low), np.minimum((-b + root) / a, high)
    assert (gap > -1e-12).all() and (first <= last + 1e-9).all()


@pytest.mark.parametrize(
    ("centre", "radius"), [((0.0, 0.0, 0.0), 0.9), ((0.3, -0.2, 2.0), 0.5), ((0.0, 0.0, -2.6), 0.3)]
)
def test_the_area_of_a_sphere_inside_comes_out_right(centre, radius):
    body = EnclosingCylinder(np.zeros(3), np.eye(3), 1.0, 3.0)
    lines = line_block("niederreiter", "tangent", body, 0, 1 << 16, 1 << 16)
    area = (lines.weights * crossings_of_sphere(lines, np.array(centre), radius)).sum() / math.pi
    assert area == pytest.approx(4.0 * math.pi * radius**2, rel=0.01)


def test_the_directions_are_uniform():
    body = EnclosingCylinder(np.zeros(3), np.eye(3), 1.0, 3.0)
    lines = lines_through_cylinder(unit_points("niederreiter", 0, 1 << 16), body)
    ball = crossings_of_sphere(lines, np.zeros(3), 0.8) > 0.0
    second = np.einsum("ij,ik->jk", lines.directions[ball], lines.directions[ball]) / ball.sum()
    assert np.allclose(second, np.eye(3) / 3.0, atol=5e-3)


def test_bad_input():
    with pytest.raises(InputError, match="at least one point"):
        enclosing_cylinder(np.empty((0, 3)))
    flat = EnclosingCylinder(np.zeros(3), np.eye(3), 0.0, 1.0)
    with pytest.raises(InputError, match="no surface"):
        lines_through_cylinder(np.zeros((1, 4)), flat)
    with pytest.raises(InputError, match="EnclosingCylinder"):
        line_block("r4", "tangent", 3, 0, 1, 1)
    assert OrientedBox(np.zeros(3), np.eye(3), np.ones(3)).surface == 24.0
