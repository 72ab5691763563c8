"""Open surfaces, holes, flipped normals, sheets and hopeless clouds: an answer, and a word about it."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball


def test_a_hole_is_reported_and_the_rest_is_right():
    a = ball(8000, 1)
    holed = a[np.linalg.norm(a.points - [0.0, 0.0, -1.0], axis=1) > 0.25]
    result = surfel.combine(holed - ball(8000, 2, 0.6, 0.9))
    assert result.leaky
    assert result.conflict > 0.0
    assert any("operand 0 is open" in warning for warning in result.warnings)
    exact = surfel.Sphere(1) - surfel.Sphere(0.6).translated((0.9, 0, 0))
    hole = float(surfel.measure(surfel.Surfels(a.points, a.normals)).area.value) * (1 - len(holed) / len(a))
    assert area(result) == pytest.approx(surfel.measure(exact).area.value - hole, rel=0.01)


def test_a_bowl_gives_an_answer():
    a = ball(6000, 1)
    bowl = a[a.points[:, 2] < 0.3]
    for tree in (bowl - ball(5000, 2, x=1.0), ball(5000, 2, x=1.0) - bowl, bowl | ball(5000, 2, x=1.0)):
        result = surfel.combine(tree)
        assert result.leaky
        assert result.warnings
        assert len(result.surfels) > 0


def test_strays_are_told_of_and_change_little():
    rng = np.random.default_rng(4)
    a, tool = ball(20_000, 1), ball(20_000, 2, 0.6, 0.9)
    away = rng.uniform(-1.0, 1.0, (200, 3))
    away = away[np.abs(np.linalg.norm(away, axis=1) - 1.0) > 0.15]
    normals = np.concatenate([a.normals, away / np.linalg.norm(away, axis=1)[:, None]])
    spoilt = surfel.Surfels(np.concatenate([a.points, away]), normals)
    clean, result = surfel.combine(tool - a), surfel.combine(tool - spoilt)
    (warning,) = (text for text in result.warnings if "far off" in text)
    assert warning.startswith("operand 1: 1") and not any("far off" in text for text in clean.warnings)
    assert result.kept[0] == pytest.approx(clean.kept[0], rel=0.01)


def test_a_flipped_patch_is_turned_and_reported():
    a = ball(6000, 1)
    normals = np.where(a.points[:, 2:] > 0.75, -a.normals, a.normals)
    result = surfel.combine(surfel.Surfels(a.points, normals) - ball(6000, 2, x=1.0))
    assert area(result) == pytest.approx(4.0 * PI, rel=1e-3)
    assert any("were turned" in warning for warning in result.warnings)
    first = result.surfels.attributes["leaf"] == 0
    assert (np.einsum("ij,ij->i", result.surfels.normals, result.surfels.points)[first] > 0.99).all()


def test_clouds_without_normals_are_oriented():
    result = surfel.combine(surfel.Surfels(ball(6000, 1).points) - surfel.Surfels(ball(6000, 2, x=1.0).points))
    assert area(result) == pytest.approx(4.0 * PI, rel=2e-3)


def test_sheets():
    a = ball(6000, 1)
    sheet, other = a[a.points[:, 2] < 0.3].with_solid(False), ball(6000, 2, x=1.0)
    ring = surfel.measure(surfel.Sphere(1) & surfel.HalfSpace((0, 0, 1), 0.3)).areas[0].value
    inside, outside = surfel.combine(sheet & other), surfel.combine(sheet - other)
    assert inside.kept[1] == outside.kept[1] == 0
    assert not inside.leaky
    assert area(inside) + area(outside) == pytest.approx(ring, rel=0.01)
    assert surfel.combine(sheet | other).kept == (len(sheet), len(other))
    with pytest.raises(surfel.InputError, match="cannot be subtracted"):
        surfel.combine(other - sheet)
    with pytest.raises(surfel.InputError, match="two sheets"):
        surfel.combine(sheet & surfel.Surfels(sheet.points, sheet.normals, solid=False))


@pytest.mark.parametrize(
    "hopeless",
    [
        np.zeros((1, 3)),
        np.array([[0.9, 0, 0], [1.0, 0, 0], [0.95, 0.1, 0]]),
        np.zeros((50, 3)),
        np.outer(np.linspace(0.0, 1.5, 40), [1.0, 0.2, 0.0]),
        np.random.default_rng(0).uniform(-1, 1, (300, 3)),
    ],
    ids=["one point", "three", "one place", "a line", "dust"],
)
def test_hopeless_clouds_raise_nothing(hopeless):
    a = ball(3000, 1)
    for cloud in (surfel.Surfels(hopeless, np.tile([0.0, 0.6, 0.8], (len(hopeless), 1))), surfel.Surfels(hopeless)):
        for tree in (a | cloud, a & cloud, a - cloud, cloud - a):
            result = surfel.combine(tree)
            assert np.isfinite(result.surfels.points).all()


@pytest.mark.parametrize(("count", "said"), [(12, True), (400, False)])
def test_clouds_of_a_few_surfels_are_told_of(count, said):
    few, many = ball(count, 1, radius=0.5), ball(2000, 2)
    found = surfel.combine(many - few.translated((0.9, 0.0, 0.0)))
    assert any("operand 1 has 12 surfels" in text for text in found.warnings) == said


def test_the_judges_are_named():
    result = surfel.combine(ball(3000, 1).with_judge("two-cluster") | ball(3000, 2, x=1.0), judge="nearest")
    assert [judge[0] for judge in result.judges] == ["two-cluster", "nearest"]
    told = result.to_dict()
    assert told["judges"][0] == {"judge": "two-cluster", "reason": "it was asked for"}
    assert told["surfels"] == len(result.surfels)
