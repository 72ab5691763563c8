"""Orientation against known outward normals."""

from __future__ import annotations

import numpy as np
import pytest

import naive
import shapes_with_truth as truth
from surfel.surface.orient import orient


def _orient(points, normals):
    rng = np.random.default_rng(3)
    shuffled = normals * np.where(rng.random(len(points)) < 0.5, -1.0, 1.0)[:, None]
    return orient(points, shuffled, naive.nearest(points, 8)[1])


@pytest.mark.parametrize("shape", [truth.sphere, truth.torus, truth.cylinder, truth.box, truth.uneven_sphere])
def test_a_closed_piece_points_outward(shape):
    cloud = shape(1500, 2)
    found = _orient(cloud.points, cloud.normals)
    right = np.einsum("ij,ij->i", found.normals, cloud.normals) > 0.999
    assert right.mean() > 0.99
    assert found.piece.max() == 0
    assert not found.ambiguous


def test_pieces_are_told_apart_and_each_points_outward():
    ball = truth.sphere(600, 1)
    points = np.concatenate([ball.points, ball.points + [5.0, 0.0, 0.0], ball.points * 0.2 + [0.0, 9.0, 0.0]])
    found = _orient(points, np.tile(ball.normals, (3, 1)))
    assert len(set(found.piece)) == 3
    assert (np.einsum("ij,ij->i", found.normals, np.tile(ball.normals, (3, 1))) > 0.999).all()


def test_a_sheet_is_consistent():
    flat = truth.square(800, 1)
    found = _orient(flat.points, flat.normals)
    assert abs(found.normals[:, 2].sum()) == 800
    assert found.conflict == 0.0


def test_a_moebius_band_is_ambiguous():
    rng = np.random.default_rng(0)
    angle, across = rng.random(3000) * 2 * np.pi, rng.random(3000) - 0.5

    def place(angle, across):
        r = 1.0 + across * np.cos(angle / 2)
        return np.column_stack([r * np.cos(angle), r * np.sin(angle), across * np.sin(angle / 2)])

    step = 1e-5
    along = place(angle + step, across) - place(angle - step, across)
    over = place(angle, across + step) - place(angle, across - step)
    normals = np.cross(along, over)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    found = _orient(place(angle, across), normals)
    assert found.conflict > 0.0


def test_only_signs_change_and_the_given_signs_do_not_matter():
    cloud = truth.torus(700, 5)
    rows = naive.nearest(cloud.points, 8)[1]
    signs = np.where(np.random.default_rng(1).random(700) < 0.5, -1.0, 1.0)[:, None]
    ours, theirs = orient(cloud.points, cloud.normals, rows), orient(cloud.points, cloud.normals * signs, rows)
    np.testing.assert_array_equal(ours.normals, theirs.normals)
    np.testing.assert_array_equal(np.abs(ours.normals), np.abs(cloud.normals))
