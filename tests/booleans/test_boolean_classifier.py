"""The public classifier: moving clouds, edits, and the order of the answers."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import ball
from surfel.core.affine import rotation, translation


def test_moving_clouds_are_told_as_moved_ones():
    space, other = surfel.Classifier(ball(6000, 1)), ball(4000, 2, 0.8)
    for k in range(3):
        pose = translation((0.3 * k, 0.2, 0.0)) @ rotation((1, 2, 3), 40.0 * k)
        found = space.classify(other, pose=pose)
        moved = other.transformed(pose)
        true = np.linalg.norm(moved.points, axis=1) < 1.0
        sure = (np.abs(np.linalg.norm(moved.points, axis=1) - 1.0) > 1e-3) & ~found.on
        assert np.array_equal(found.inside[sure], true[sure])
        assert np.array_equal(found.kind, space.classify(moved).kind)


def test_answers_come_in_the_order_of_the_cloud():
    space, other = surfel.Classifier(ball(6000, 1)), ball(3000, 2, 0.8, 0.5)
    found = space.classify(other)
    by_place = space.classify(other.points, normals=other.normals)
    assert np.array_equal(found.kind, by_place.kind)
    assert (np.diff(found.judged) > 0).all()
    assert (np.sign(found.value) < 0).tolist() == [bool(found.inside[row]) for row in found.judged]


def test_edits_are_told_as_new_clouds():
    cloud = ball(6000, 1)
    space = surfel.Classifier(cloud)
    chosen = np.flatnonzero(cloud.points[:, 2] > 0.9)
    points = cloud.points.copy()
    points[chosen] *= 0.97
    edited = space.edited(chosen, points[chosen], cloud.normals[chosen])
    fresh = surfel.Classifier(surfel.Surfels(points, cloud.normals))
    other = ball(4000, 2, 0.985)
    assert (edited.classify(other).kind != fresh.classify(other).kind).mean() < 2e-3
    assert edited.recolored < space.recolored
    assert not edited.leaky
    assert edited.decision.judge == space.decision.judge


def test_bad_arguments_are_refused():
    with pytest.raises(surfel.InputError, match="cloud must be"):
        surfel.Classifier(np.zeros((3, 3)))
    with pytest.raises(surfel.InputError, match="judge must be one of"):
        surfel.Classifier(ball(), "jury")
    with pytest.raises(surfel.InputError, match="normals must be left out"):
        surfel.Classifier(ball()).classify(ball(), normals=np.zeros((5000, 3)))


def test_both_ways_answers_for_both_clouds_in_their_order():
    one, other = ball(6000, 1), ball(4000, 2, 0.8, 0.5)
    pose = translation([0.1, -0.2, 0.3])
    spaces = surfel.Classifier(one), surfel.Classifier(other)
    of_other, of_one = spaces[0].both_ways(spaces[1], pose)
    for found, alone in (
        (of_other, spaces[0].classify(other, pose=pose)),
        (of_one, spaces[1].classify(one, pose=translation([-0.1, 0.2, -0.3]))),
    ):
        assert np.array_equal(found.kind, alone.kind) and np.array_equal(found.near, alone.near)
        assert found.inside.any() and not found.inside.all()
    with pytest.raises(surfel.InputError, match="Classifier"):
        spaces[0].both_ways(other)
