"""The columns of the table: what each judge is good and bad at, on small clouds made here."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import box, torus
from surfel.inside.judges import named
from surfel.inside.operand import Operand

LENGTHS = np.array([0.9, 0.7, 0.6])


def wrong(name, operand, places, inside):
    return 100.0 * np.mean(named(name)(operand, places).inside != inside)


@pytest.fixture(scope="module")
def edges():
    """Places round the edges of a box of 20,000 surfels, 0.7 spacings off."""
    cloud = box(20_000, 1, tuple(LENGTHS))
    operand = Operand.of(cloud.points, cloud.normals)
    rng = np.random.default_rng(2)
    place = (rng.random((20_000, 3)) - 0.5) * LENGTHS
    kept = rng.integers(3, size=20_000)
    for step in (1, 2):
        axis = (kept + step) % 3
        place[np.arange(20_000), axis] = 0.5 * LENGTHS[axis] * rng.choice([-1.0, 1.0], 20_000)
    place += rng.normal(0.0, 0.7 * operand.spacing, place.shape)
    return operand, place, (np.abs(place) < 0.5 * LENGTHS).all(axis=1)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("nearest", 4.7, 10.6),
        ("two-nearest", 1.7, 3.75),
        ("imls", 6.5, 14.5),
        ("mls", 6.0, 13.5),
        ("two-cluster", 0.0, 0.5),
        ("winding", 5.6, 12.6),
    ],
)
def test_at_the_edges_of_a_box(name, low, high, edges):
    assert low < wrong(name, *edges) < high


@pytest.mark.parametrize(
    ("name", "high"),
    [("nearest", 0.34), ("two-nearest", 0.12), ("imls", 0.42), ("mls", 0.72), ("two-cluster", 0.05), ("winding", 9.8)],
)
def test_near_a_thin_plate(name, high):
    cloud = box(62_000, 3, (0.9, 0.7, 0.012))
    operand = Operand.of(cloud.points, cloud.normals)
    rng = np.random.default_rng(4)
    at = box(20_000, 5, (0.9, 0.7, 0.012))
    place = at.points + at.normals * rng.uniform(-2.0, 2.0, (20_000, 1)) * operand.spacing
    assert wrong(name, operand, place, (np.abs(place) < np.array([0.45, 0.35, 0.006])).all(axis=1)) < high


class TestTorus:
    def make(self, noise=0.0, flips=0.0):
        cloud = torus(30_000, 6, 0.35, 0.13)
        rng = np.random.default_rng(7)
        spacing = np.sqrt(cloud.area / 30_000)
        normals = cloud.normals + rng.normal(0.0, 0.125, (30_000, 3)) * (noise > 0.0)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals[rng.random(30_000) < flips] *= -1.0
        operand = Operand.of(cloud.points + rng.normal(0.0, 1.0, (30_000, 3)) * noise * spacing, normals)
        place = rng.uniform([-0.5, -0.5, -0.15], [0.5, 0.5, 0.15], (20_000, 3))
        return operand, place, np.hypot(np.hypot(place[:, 0], place[:, 1]) - 0.35, place[:, 2]) < 0.13

    def test_smooth(self):
        case = self.make()
        for name in ("nearest", "two-nearest", "imls", "mls", "two-cluster", "winding"):
            assert wrong(name, *case) < 0.2

    def test_noise(self):
        case = self.make(noise=1.2)
        found = {name: wrong(name, *case) for name in ("nearest", "imls", "winding", "indicator")}
        assert found["indicator"] < 0.7 * found["imls"] < 0.7 * 0.6 * found["nearest"]
        assert found["winding"] < 0.8 * found["nearest"]

    def test_flips(self):
        case = self.make(flips=0.2)
        found = {name: wrong(name, *case) for name in ("nearest", "imls", "winding", "indicator")}
        assert 15.0 < found["nearest"] < 25.0
        assert found["imls"] < 4.0 and found["winding"] < 4.0 and found["indicator"] < 0.6
