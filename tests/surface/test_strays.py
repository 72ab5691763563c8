"""Strays: planted ones are found within a fifth, whatever their number, and no surface is dropped."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import shapes_with_truth as truth
from surfel.surface.neighbourhoods import cleaned


def _dropped(points):
    """Return the rows of the strays."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    hood, counts = cleaned((points - middle) / np.abs(points - middle).max(), None)
    rows = np.setdiff1d(np.arange(len(points)), hood.rows)
    assert counts == {"duplicates": 0, "strays": len(rows)}
    return rows


def _planted(points, share, size, seed):
    """Return uniform points of a box round the cloud, farther from each of its points than four spacings there."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * size * np.maximum(high - low, 0.3 * (high - low).max())
    count = max(1, round(share * len(points)))
    places = np.random.default_rng(seed).uniform(-half, half, (8 * count, 3)) + 0.5 * (low + high)
    tree = cKDTree(points)
    spacing = tree.query(points, 13)[0][:, 12] * np.sqrt(np.pi / 12.0)
    away, nearest = tree.query(places)
    return places[away > 4.0 * spacing[nearest]][:count]


def _uneven(n, ratio):
    """Return points of the unit sphere whose density falls smoothly, by a ratio, from pole to pole."""
    p = truth.sphere(20 * n, 1).points
    return p[np.random.default_rng(2).random(len(p)) < ratio ** (0.5 * (p[:, 2] - 1.0))][:n]


def _step(shape, n, ratio):
    """Return a shape whose lower half is suddenly sparser."""
    p = shape(2 * n, 1).points
    axis = 0 if np.ptp(p[:, 2]) == 0.0 else 2
    return p[(p[:, axis] > p[:, axis].mean()) | (np.random.default_rng(2).random(len(p)) < 1.0 / ratio)]


def _wire(round_about):
    """Return a sphere with a wire on it, half a spacing thick, with a few points round."""
    ball = truth.sphere(6000, 5)
    h = ball.spacing
    step = np.arange(int(2.0 / h))
    angle = np.arange(round_about) * 2.0 * np.pi / round_about
    turn = (angle + step[:, None]).ravel()
    height = np.repeat(1.0 + h * step, round_about)
    return np.concatenate([ball.points, np.column_stack([0.4 * h * np.cos(turn), 0.4 * h * np.sin(turn), height])])


def _with_a_small_part():
    """Return a sphere and, far away, one of 50 points at the same spacing."""
    return np.concatenate([truth.sphere(6000, 5).points, truth.sphere(50, 6).points * np.sqrt(50 / 6000) + [3, 0, 0]])


def _rings():
    """Return the ground as a scanner sees it that turns: rings of points, wider and wider apart."""
    angle = np.linspace(0.0, 2.0 * np.pi, 500, endpoint=False)
    rings = [np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle]) for r in 1.5 * 1.12 ** np.arange(30)]
    return np.concatenate(rings) + np.random.default_rng(1).normal(0.0, 0.01, (15_000, 3))


SURFACES = {
    "sphere": truth.sphere(8000, 5).points,
    "torus": truth.torus(4000, 3).points,
    "box": truth.box(8000, 1).points,
    "square": truth.square(5000, 1).points,
    "crossing squares": truth.crossing_squares(5000, 1).points,
    "half sphere": truth.half_sphere(5000, 2).points,
    "even sphere": truth.even_sphere(5000, 1).points,
    "uneven 16": _uneven(8000, 16.0),
    "uneven 30": _uneven(8000, 30.0),
    "square with a step": _step(truth.square, 8000, 30.0),
    "sphere with a step": _step(truth.sphere, 8000, 30.0),
    "box with a step": _step(truth.box, 8000, 30.0),
    "wire of 1": _wire(1),
    "wire of 3": _wire(3),
    "thin torus": truth.torus(8000, 1, 1.0, 0.02).points,
    "small part": _with_a_small_part(),
    "noise of 1": truth.sphere(8000, 1).noisy(1.0, 2),
    "noise of 1 on a box": truth.box(8000, 1).noisy(1.0, 2),
    "rings": _rings(),
}


@pytest.mark.parametrize("name", SURFACES)
def test_a_surface_has_no_strays(name):
    assert len(_dropped(SURFACES[name])) == 0


@pytest.mark.parametrize("n", [4, 13, 30, 100])
@pytest.mark.parametrize("shape", [truth.sphere, truth.box, truth.square])
def test_few_points_are_all_kept(shape, n):
    assert len(_dropped(shape(n, 3).points)) == 0


@pytest.mark.parametrize("share", [0.001, 0.01, 0.03])
@pytest.mark.parametrize("name", SURFACES)
def test_strays_are_found_and_counted_within_a_fifth(name, share):
    surface = SURFACES[name]
    strays = _planted(surface, share, 2.0, 6)
    rows = _dropped(np.concatenate([surface, strays]))
    assert (rows >= len(surface)).all()
    # strays over the dense half of a square may lie within a few spacings of the sparse half
    assert len(rows) == pytest.approx(len(strays), rel=0.25 if name == "square with a step" else 0.2)


@pytest.mark.parametrize("name", ["sphere", "crossing squares", "even sphere", "noise of 1", "small part"])
def test_a_tenth_of_strays_is_found(name):
    surface = SURFACES[name]
    strays = _planted(surface, 0.1, 1.5, 6)
    rows = _dropped(np.concatenate([surface, strays]))
    assert (rows >= len(surface)).all()
    assert len(rows) == pytest.approx(len(strays), rel=0.2)


@pytest.mark.parametrize("name", ["uneven 30", "box with a step"])
def test_strays_do_not_depend_on_order_place_or_scale(name):
    points = np.concatenate([SURFACES[name], _planted(SURFACES[name], 0.03, 2.0, 6)])
    rows = set(_dropped(points))
    for seed, scale in enumerate((1e-6, 1.0, 1e9)):
        order = np.random.default_rng(seed).permutation(len(points))
        moved = (points[order] @ truth.rotation(seed).T + [3.0, -1.0, 2.0]) * scale
        assert set(order[_dropped(moved)]) == rows


def test_a_sparse_part_is_kept_where_it_is_a_surface_and_dropped_where_it_is_none():
    ball = truth.sphere(8000, 5).points
    rng = np.random.default_rng(7)
    sheet = np.column_stack([rng.random((60, 2)), np.full(60, 1.7)])
    heap = rng.random((60, 3)) + [0.0, 0.0, 1.7]
    assert len(_dropped(np.concatenate([ball, sheet]))) == 0
    assert len(_dropped(np.concatenate([ball, heap]))) == 60
