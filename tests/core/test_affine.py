"""Affine maps: what they do to points, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from surfel import InputError
from surfel.core.affine import as_affine, box_under, inverse, reflection, rotation, scaling, translation


def test_quarter_turns_are_exact_and_counterclockwise():
    assert np.array_equal(rotation((0, 0, 1), 90.0)[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.array_equal(rotation((0, 0, 1), -270.0), rotation((0, 0, 1), 90.0))
    assert np.array_equal(rotation((0, 1, 0), 720.0), np.eye(4))
    assert np.array_equal(rotation((2, 0, 0), 180.0)[:3, :3], np.diag([1.0, -1.0, -1.0]))


def test_rotations_keep_lengths_and_their_axis():
    rng = np.random.default_rng(0)
    for _ in range(20):
        axis, degrees = rng.standard_normal(3), rng.uniform(-720.0, 720.0)
        turn = rotation(axis, degrees)[:3, :3]
        assert np.abs(turn @ turn.T - np.eye(3)).max() < 1e-14
        assert np.linalg.det(turn) == pytest.approx(1.0)
        assert np.abs(turn @ axis - axis).max() < 1e-14 * np.linalg.norm(axis) * 10
        assert np.trace(turn) == pytest.approx(1.0 + 2.0 * math.cos(math.radians(degrees)))


def test_reflections_undo_themselves():
    mirror = reflection((1.0, 2.0, 2.0))
    assert np.abs(mirror @ mirror - np.eye(4)).max() < 1e-15
    assert np.abs(mirror[:3, :3] @ [1.0, 2.0, 2.0] + [1.0, 2.0, 2.0]).max() < 1e-14


def test_the_inverse_undoes_a_map():
    matrix = translation((1, 2, 3)) @ rotation((1, 1, 0), 30.0) @ scaling((1, 2, 0.5))
    back = np.concatenate([inverse(matrix), [[0, 0, 0, 1]]])
    assert np.abs(back @ matrix - np.eye(4)).max() < 1e-14


def test_the_box_round_the_image_of_a_box():
    rng = np.random.default_rng(1)
    matrix = translation((5, 0, 0)) @ rotation(rng.standard_normal(3), 70.0) @ scaling((1, 3, 0.2))
    box = np.array([[-1.0, 0.0, 2.0], [1.0, 4.0, 3.0]])
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    moved = corners @ matrix[:3, :3].T + matrix[:3, 3]
    assert np.abs(box_under(matrix, box) - [moved.min(axis=0), moved.max(axis=0)]).max() < 1e-14
    half = np.array([[-np.inf, 0.0, 0.0], [0.0, 1.0, 1.0]])
    assert np.array_equal(box_under(rotation((0, 0, 1), 90.0), half), [[-1.0, -np.inf, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.zeros((4, 4)), "last row"),
        (np.diag([1.0, 1.0, 0.0, 1.0]), "singular"),
        (np.diag([1.0, 1.0, 1e-300, 1.0]), "singular"),
        (np.diag([1.0, 1.0, np.nan, 1.0]), "finite"),
        (np.diag([1.0, np.inf, 1.0, 1.0]), "finite"),
        (np.eye(3), "4"),
        (np.ones((4, 4)), "last row"),
        ("no matrix", "matrix"),
    ],
)
def test_bad_matrices_are_refused_by_every_shape(matrix, problem):
    with pytest.raises(InputError, match=problem):
        as_affine(matrix)
    for shape in (surfel.Box(1), surfel.Sphere(1).translated((1, 0, 0)), surfel.Box(1) - surfel.Sphere(1)):
        with pytest.raises(InputError, match=problem):
            shape.transformed(matrix)


@pytest.mark.parametrize(
    "act",
    [
        lambda s: s.translated((1.0, 2.0)),
        lambda s: s.translated((1.0, 2.0, np.nan)),
        lambda s: s.rotated((0, 0, 0), 30.0),
        lambda s: s.rotated((0, 0, 1), np.inf),
        lambda s: s.rotated((0, 0, 1), "half"),
        lambda s: s.scaled(0.0),
        lambda s: s.scaled(-1.0),
        lambda s: s.scaled((1.0, 2.0, 0.0)),
        lambda s: s.scaled((1.0, np.nan, 1.0)),
        lambda s: s.scaled((1.0, 2.0)),
        lambda s: s.mirrored((0.0, 0.0, 0.0)),
    ],
)
def test_bad_moves_are_refused(act):
    for shape in (surfel.Box(1), surfel.Torus(2, 1).translated((1, 0, 0)), surfel.Box(1) | surfel.Sphere(1)):
        with pytest.raises(InputError):
            act(shape)
