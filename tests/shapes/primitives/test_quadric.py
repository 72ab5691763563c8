"""Quadrics of every kind, turned and moved, bounded or not."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from primitives_with_truth import ELLIPSOID, PLACEMENTS, lines_round, places, to_quadric
from surfel import InputError, Lines
from surfel.core.affine import rotation, translation
from surfel.shapes.primitives.ellipsoid import ellipsoid_area

HERE = np.eye(4)[:3]


def moved(matrix, placement):
    """The matrix of the quadric under an affine map."""
    back = np.linalg.inv(placement)
    turned = back.T @ matrix @ back
    return 0.5 * (turned + turned.T)


PARABOLOID = np.diag([1.0, 1.0, 0.0, 0.0])
PARABOLOID[2, 3] = PARABOLOID[3, 2] = -0.5
SADDLE = np.diag([1.0, -1.0, 0.0, 0.0])
SADDLE[2, 3] = SADDLE[3, 2] = 0.5
TROUGH = np.diag([1.0, 0.0, 0.0, 0.3])
TROUGH[1, 3] = TROUGH[3, 1] = -1.0
PLANE = np.array([[0, 0, 0, 0.5], [0, 0, 0, 1.0], [0, 0, 0, -0.5], [0.5, 1.0, -0.5, -0.7]])
OPEN = {
    "cylinder": np.diag([1.0, 2.0, 0.0, -1.0]),
    "cone": np.diag([1.0, 1.0, -1.0, 0.0]),
    "one sheet": np.diag([1.0, 1.0, -1.0, -1.0]),
    "two sheets": np.diag([1.0, 1.0, -1.0, 1.0]),
    "outside of a ball": np.diag([-1.0, -1.0, -1.0, 4.0]),
    "slab": np.diag([0.0, 4.0, 0.0, -1.0]),
    "outside of a slab": np.diag([0.0, -4.0, 0.0, 1.0]),
    "crossed planes": np.diag([1.0, -1.0, 0.0, 0.0]),
    "paraboloid": PARABOLOID,
    "saddle": SADDLE,
    "trough": TROUGH,
    "half-space": PLANE,
}


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("kind", OPEN)
def test_events_lie_on_the_surface_and_part_inside_from_outside(kind, placement):
    matrix = moved(OPEN[kind], PLACEMENTS[placement])
    shape = surfel.Quadric(matrix)
    assert shape.volume == math.inf
    assert shape.area == (pytest.approx(shape.area) if kind == "outside of a ball" else math.inf)
    lines = lines_round(np.array([[-3.0] * 3, [3.0] * 3]), 3000, seed=1)
    found = shape._cross_placed(lines, HERE)
    assert (found.counts % 2 == 0).all()
    assert (found.cosine[0::2] <= 0.0).all()
    assert (found.cosine[1::2] >= 0.0).all()
    finite = np.isfinite(found.t)
    points = lines.origins[found.lines[finite]] + found.t[finite, None] * lines.directions[found.lines[finite]]
    assert len(points) > 100
    size = 4.0 + np.linalg.norm(points, axis=1)
    # how far the matrix itself is known: it was rounded when it was turned
    slope = np.linalg.norm(np.c_[points, np.ones(len(points))] @ matrix[:, :3], axis=1)
    known = 4.0 * np.finfo(float).eps * np.abs(matrix).max() * size**2 / slope
    assert (np.abs(to_quadric(matrix)(points)) <= 1e-12 * size + known).all()
    for t in (-4.0, 0.0, 2.5):
        below = np.add.reduceat(np.append(found.t < t, False), np.minimum(found.offsets[:-1], len(found.t)))
        below[found.counts == 0] = 0
        h = np.c_[lines.origins + t * lines.directions, np.ones(len(lines))]
        level = np.einsum("ni,ij,nj->n", h, matrix, h)
        clear = np.abs(level) > 1e-9
        assert np.array_equal((below % 2 == 1)[clear], level[clear] < 0.0)


@pytest.mark.parametrize("kind", OPEN)
def test_a_box_bounds_any_quadric(kind):
    shape = surfel.Quadric(OPEN[kind]) & surfel.Box(2.5)
    points = np.random.default_rng(2).uniform(-1.3, 1.3, (2000, 3))
    level = np.einsum("ni,ij,nj->n", np.c_[points, np.ones(2000)], OPEN[kind], np.c_[points, np.ones(2000)])
    truth = (level < 0.0) & (np.abs(points).max(axis=1) < 1.25)
    clear = np.abs(level) > 1e-9
    assert np.array_equal(shape.contains(points)[clear], truth[clear])


def test_ellipsoids_have_area_volume_and_bounds():
    shape = surfel.Quadric(ELLIPSOID)
    centre = np.linalg.solve(ELLIPSOID[:3, :3], -ELLIPSOID[:3, 3])
    level = ELLIPSOID[3, 3] + ELLIPSOID[:3, 3] @ centre
    inverse = np.linalg.inv(ELLIPSOID[:3, :3] / -level)
    reach = np.sqrt(np.diag(inverse))
    assert np.asarray(shape.bounds) == pytest.approx(np.stack([centre - reach, centre + reach]), abs=1e-14)
    assert shape.volume == pytest.approx(4.0 / 3.0 * math.pi * math.sqrt(np.linalg.det(inverse)), rel=1e-14)
    radii = 1.0 / np.sqrt(np.linalg.eigvalsh(ELLIPSOID[:3, :3] / -level))
    assert shape.area == pytest.approx(ellipsoid_area(radii), rel=1e-13)


def test_a_quadric_is_the_ellipsoid_that_it_describes():
    radii = np.array([1.0, 0.3, 2.0])
    placement = translation((3.0, -1.0, 0.5)) @ rotation((1.0, 2.0, 3.0), 40.0)
    quadric = surfel.Quadric(moved(np.diag([*radii**-2.0, -1.0]), placement))
    ellipsoid = surfel.Ellipsoid(radii).transformed(placement)
    lines = lines_round(np.asarray(ellipsoid.bounds), 5000, seed=3)
    one, other = quadric.cross(lines), ellipsoid.cross(lines)
    same = one.counts == other.counts
    assert same.mean() > 0.999
    rows = np.repeat(same, one.counts), np.repeat(same, other.counts)
    assert np.abs(one.t[rows[0]] - other.t[rows[1]]).max() <= 1e-9
    assert np.abs(one.cosine[rows[0]] - other.cosine[rows[1]]).max() <= 1e-6
    assert np.asarray(quadric.bounds) == pytest.approx(np.asarray(ellipsoid.bounds), abs=1e-13)


def test_bounds_are_infinite_where_there_is_no_end():
    inf = math.inf
    assert surfel.Quadric(OPEN["cylinder"]).bounds.tolist() == [[-1, -math.sqrt(0.5), -inf], [1, math.sqrt(0.5), inf]]
    assert surfel.Quadric(OPEN["slab"]).bounds.tolist() == [[-inf, -0.5, -inf], [inf, 0.5, inf]]
    turned = surfel.Quadric(moved(OPEN["cylinder"], rotation((0, 1, 0), 90.0)))
    assert turned.bounds[:, 0].tolist() == [-inf, inf]
    assert turned.bounds[1, 1:] == pytest.approx([math.sqrt(0.5), 1.0])
    for kind in ("cone", "one sheet", "two sheets", "outside of a ball", "saddle", "half-space"):
        assert np.isinf(surfel.Quadric(OPEN[kind]).bounds).all()


def test_a_thin_turned_cylinder_stays_a_cylinder():
    matrix = moved(np.diag([1e4, 1e4, 0.0, -1.0]), rotation((1.0, 2.0, 3.0), 33.0))
    form = surfel.Quadric(matrix).canonical.form
    assert form[2] == form[3] == 0.0
    assert form[0] == pytest.approx(form[1], rel=1e-12)


def test_a_flat_and_a_thin_one_are_hit_on_their_surface():
    rng = np.random.default_rng(4)
    for diagonal in ([1.0, 1e6, 1.0, -1.0], [1.0, 1e12, 1.0, -1.0], [1e6, 1e6, 1.0, -1.0], [1e12, 1e12, 0.0, -1.0]):
        matrix = np.diag(diagonal)
        inside = rng.uniform(-0.4, 0.4, (3000, 3)) / np.sqrt(np.maximum(np.array(diagonal[:3]), 1.0))
        directions = rng.standard_normal((3000, 3))
        lines = Lines.of(inside - directions * rng.uniform(-0.5, 0.5, (3000, 1)), directions, 1.0)
        found = surfel.Quadric(matrix)._cross_placed(lines, HERE)
        assert (found.counts == 2).mean() > 0.999
        points = places(lines, found)
        near = np.abs(points).max(axis=1) < 10.0
        assert np.abs(to_quadric(matrix)(points[near])).max() <= 1e-12


@pytest.mark.parametrize(
    ("matrix", "said"),
    [
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "finite"),
        (np.arange(16.0).reshape(4, 4), "symmetric"),
        (np.zeros((4, 4)), "constant"),
        (np.diag([0.0, 0.0, 0.0, -1.0]), "constant"),
        (np.eye(4), "empty"),
        (np.diag([1.0, 1.0, 1.0, 0.0]), "empty"),
        (np.diag([1.0, 0.0, 0.0, 2.0]), "empty"),
        ("round", "real numbers"),
    ],
)
def test_bad_matrices(matrix, said):
    with pytest.raises(InputError, match=said):
        surfel.Quadric(matrix)
