"""The octree of fixed depth: its boundary cells, and which of them a line meets."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.index.neighbours import PointIndex
from surfel.index.octree import DEEPEST, STACK, build_octree, leaves_on_line, nearest_squares

RNG = np.random.default_rng(0)
CLOUDS = {
    "random": RNG.random((700, 3)),
    "flat": RNG.random((500, 3)) * [1.0, 1.0, 0.0],
    "on a line": np.linspace(0.0, 1.0, 65)[:, None] * [0.0, 2.0, 0.0],
    "one place": np.ones((5, 3)),
    "far away": RNG.random((300, 3)) + 1e6,
}


def on_line(tree, origin, direction, r):
    found = np.empty(tree.leaves + 1, np.int32)
    stack = np.empty(STACK, np.int32)
    count = leaves_on_line.py_func(tree.middle, tree.half, tree.child, *origin, *direction, r, stack, found)
    return found[:count]


@pytest.mark.parametrize("depth", [1, 2, 4, 7])
@pytest.mark.parametrize("name", CLOUDS)
def test_every_point_lies_in_its_cell_and_no_cell_is_empty(name, depth):
    points = CLOUDS[name]
    tree = build_octree(points, depth)
    assert sorted(tree.order) == list(range(len(points)))
    assert np.array_equal(tree.points, points[tree.order])
    assert (tree.counts > 0).all() and tree.counts.sum() == len(points)
    leaf = len(tree.half) - tree.leaves + np.repeat(np.arange(tree.leaves), tree.counts)
    slack = 1e-9 * (1.0 + np.abs(points).max())
    assert (np.abs(tree.points - tree.middle[leaf]) <= tree.half[leaf, None] + slack).all()
    low, size = points.min(axis=0), np.ptp(points, axis=0).max() or 1.0
    cells = np.minimum(((points - low) * (2**depth / size)).astype(int), 2**depth - 1)
    assert tree.leaves == len(np.unique(cells, axis=0))


@pytest.mark.parametrize("depth", [1, 3, 6])
def test_children_lie_in_their_cell_and_each_has_one_parent(depth):
    tree = build_octree(CLOUDS["random"], depth)
    inner = len(tree.half) - tree.leaves
    children = [np.arange(tree.child[c], tree.child[c + 1]) for c in range(inner)]
    assert np.array_equal(np.concatenate(children), np.arange(1, len(tree.half)))
    for cell, below in enumerate(children):
        assert 1 <= len(below) <= 8
        assert np.allclose(tree.half[below], 0.5 * tree.half[cell])
        assert np.allclose(np.abs(tree.middle[below] - tree.middle[cell]), tree.half[below, None])
    assert (tree.child[inner:] == len(tree.half)).all()


@pytest.mark.parametrize("r", [0.0, 0.03, 0.2])
def test_a_line_meets_the_cells_that_it_meets(r):
    tree = build_octree(CLOUDS["random"], 3)
    first = len(tree.half) - tree.leaves
    for case in range(60):
        origin, direction = RNG.random(3) * 2.0 - 0.5, RNG.standard_normal(3)
        if case % 5 == 0:
            direction[case % 3] = 0.0
        direction /= np.linalg.norm(direction)
        with np.errstate(divide="ignore", invalid="ignore"):
            one = (tree.middle[first:] - tree.half[first:, None] - r - origin) / direction
            two = (tree.middle[first:] + tree.half[first:, None] + r - origin) / direction
        met = np.minimum(one, two).max(axis=1) <= np.maximum(one, two).min(axis=1)
        assert sorted(on_line(tree, origin, direction, r)) == list(first + np.flatnonzero(met))


def test_the_deepest_tree_is_within_its_scratch():
    corner = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    points = np.concatenate([corner * 2.0**-k for k in range(DEEPEST + 1)] + [1.0 - corner * 2.0**-k for k in range(9)])
    tree = build_octree(points, DEEPEST)
    assert len(on_line(tree, (0.5, 0.5, 0.5), np.ones(3) / np.sqrt(3.0), 2.0)) == tree.leaves


@pytest.mark.parametrize("depth", [1, 4, 6])
@pytest.mark.parametrize("name", [*CLOUDS, "crowded", "two"])
def test_nearest_distances_are_those_of_all_pairs(name, depth):
    crowd = np.concatenate([RNG.random((1500, 3)), [[1e5, 0.0, 0.0]]])
    points = {**CLOUDS, "crowded": crowd, "two": np.eye(3)[:2]}[name]
    tree = build_octree(points, depth)
    squares = np.square(tree.points[:, None] - tree.points[None]).sum(axis=2)
    np.fill_diagonal(squares, np.inf)
    assert np.allclose(nearest_squares(tree), squares.min(axis=1), rtol=1e-9, atol=1e-300)


def test_nearest_distances_of_many_points_in_few_cells():
    points = np.random.default_rng(1).random((30_000, 3)) * [1.0, 1.0, 0.0]
    tree = build_octree(points, 2)
    squares, _ = PointIndex(tree.points).knn(1)
    expected = np.empty(len(points))
    expected[PointIndex(tree.points).order] = squares[:, 0]
    assert np.allclose(nearest_squares(tree), expected, rtol=1e-12)
