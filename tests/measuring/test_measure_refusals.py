"""What cannot be measured is said to be so, in words: noise above the features, and sheets too near without normals."""

from __future__ import annotations

import json

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel.cli import main


def _plate(points: int, thickness: float) -> tuple[np.ndarray, float]:
    """Return random points of a square plate, turned, and its area; the thickness is in spacings of one side."""
    rng = np.random.default_rng(5)
    thick = thickness / np.sqrt(points / 2)
    areas = np.array([1.0, 1.0, thick, thick, thick, thick])
    face, (u, v) = rng.choice(6, points, p=areas / areas.sum()), rng.random((2, points))
    place = np.stack([u, v, thick * (face == 1)], axis=1)
    for side in range(4):
        here, axis = face == side + 2, side // 2
        place[here, axis], place[here, 2] = side % 2, thick * v[here]
        place[here, 1 - axis] = u[here]
    return place @ truth.rotation(3).T, float(areas.sum())


@pytest.fixture(scope="module")
def drowned():
    """A sphere with noise of one hundredth of the diagonal of its box, which is more than a spacing."""
    ball = truth.sphere(20_000, 2)
    return ball.points + 0.01 * np.sqrt(12.0) * np.random.default_rng(4).standard_normal((20_000, 3))


def test_noise_of_a_hundredth_of_the_diagonal_is_refused_in_words(drowned):
    found = surfel.measure(surfel.Surfels(drowned), lines=256)
    assert not found.area.reliable
    assert "hides the surface" in found.area.reason
    assert found.area.reason in found.warnings


def test_the_command_says_so_too(drowned, tmp_path, capsys):
    file = tmp_path / "drowned.npy"
    np.save(file, drowned)
    assert main(["measure", str(file), "--lines", "256"]) == 0
    told = capsys.readouterr()
    assert "not reliable: noise of" in told.out and "hides the surface" in told.err
    assert main(["measure", str(file), "--lines", "256", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert any("hides the surface" in text for text in told["warnings"])


@pytest.mark.parametrize("thickness", [2.1, 2.5])
def test_a_plate_somewhat_more_than_two_spacings_thick_is_measured_without_normals(thickness):
    points, area = _plate(10_000, thickness)
    found = surfel.measure(surfel.Surfels(points), lines=256).area
    assert found.value == pytest.approx(area, rel=0.01)


@pytest.mark.parametrize("thickness", [0.5, 1.0, 1.5, 1.8])
def test_a_thinner_plate_is_refused(thickness):
    points, _ = _plate(10_000, thickness)
    found = surfel.measure(surfel.Surfels(points), lines=256)
    assert not found.area.reliable and found.area.reason in found.warnings
