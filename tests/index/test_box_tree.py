"""The tree over boxes names every box that a line passes or a point lies in, and few others."""

from __future__ import annotations

import numpy as np
import pytest

from surfel._numba import rows
from surfel.index.box_tree import STACK, box_tree, boxes_on_line, boxes_round_point


@rows
def _ask(first, last, boxes, item, always, origins, directions, on_line, round_point):
    stack, found = np.empty(STACK, np.int32), np.empty(on_line.shape[1] + 1, np.int32)
    for k in range(first, last):
        x, y, z = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        for one in range(boxes_on_line(boxes, item, always, x, y, z, dx, dy, dz, stack, found)):
            on_line[k, found[one]] += 1
        for one in range(boxes_round_point(boxes, item, always, x, y, z, stack, found)):
            round_point[k, found[one]] += 1


def asked(boxes, origins, directions):
    tree = box_tree(boxes)
    counts = np.zeros((len(origins), len(boxes)), np.int64), np.zeros((len(origins), len(boxes)), np.int64)
    _ask(len(origins), *tree, origins, directions, *counts)
    return *counts, tree


def brute(boxes, origins, directions):
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (boxes[None] - origins[:, None, None]) / directions[:, None, None]
        near, far = np.nanmin(ends, axis=2).max(axis=2), np.nanmax(ends, axis=2).min(axis=2)
    inside = ((origins[:, None] >= boxes[None, :, 0]) & (origins[:, None] <= boxes[None, :, 1])).all(axis=2)
    return near <= far, inside


@pytest.mark.parametrize("count", [1, 3, 4, 5, 17, 64, 300])
def test_it_names_what_brute_force_finds(count):
    rng = np.random.default_rng(count)
    low = rng.uniform(-5.0, 5.0, (count, 3))
    boxes = np.stack([low, low + rng.uniform(0.0, 2.0, (count, 3))], axis=1)
    origins, directions = rng.uniform(-5.0, 5.0, (500, 3)), rng.standard_normal((500, 3))
    on_line, round_point, tree = asked(boxes, origins, directions)
    passed, inside = brute(boxes, origins, directions)
    assert on_line.max() <= 1 and round_point.max() <= 1
    if len(tree.always):  # a few boxes are not worth a tree: all of them are named
        assert on_line.all() and round_point.all()
    else:
        assert np.array_equal(on_line == 1, passed)
        assert np.array_equal(round_point == 1, inside)


def test_unbounded_boxes_are_always_named_and_empty_ones_never():
    rng = np.random.default_rng(1)
    low = rng.uniform(-5.0, 5.0, (20, 3))
    boxes = np.stack([low, low + 1.0], axis=1)
    boxes[3] = [[-np.inf] * 3, [0.0, 0.0, np.inf]]
    boxes[7] = [[np.inf] * 3, [-np.inf] * 3]
    boxes[8] = [[1.0, 1.0, 1.0], [2.0, 0.0, 2.0]]
    on_line, round_point, _ = asked(boxes, rng.uniform(-5.0, 5.0, (200, 3)), rng.standard_normal((200, 3)))
    for found in (on_line, round_point):
        assert (found[:, 3] == 1).all()
        assert (found[:, [7, 8]] == 0).all()


def test_lines_along_the_axes_and_in_the_faces_of_boxes():
    boxes = np.array([[[k, 0.0, 0.0], [k + 1.0, 1.0, 1.0]] for k in range(10)], float)
    origins = np.array([[-5.0, 0.5, 0.5], [-5.0, 2.0, 0.5], [4.5, 0.5, -9.0], [4.5, -3.0, 0.5]])
    directions = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    on_line, _, _ = asked(boxes, origins, directions)
    assert on_line[0].all() and not on_line[1].any()
    assert np.flatnonzero(on_line[2]).tolist() == [4] and np.flatnonzero(on_line[3]).tolist() == [4]
