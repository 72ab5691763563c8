"""Splitting at the cut: levels, tolerances, and what is interpolated."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball

N = 6000
SPACING = np.sqrt(4.0 * PI / N)


def over(cloud):
    """Return how far the disks of the first ball reach into the second, in spacings."""
    first = cloud.attributes["leaf"] == 0
    away = cloud.points[first] - [1.0, 0.0, 0.0]
    far = np.linalg.norm(away, axis=1)
    tilt = np.einsum("ij,ij->i", away, cloud.normals[first]) / far
    return ((1.0 - far + cloud.radii[first] * np.sqrt(np.maximum(1.0 - tilt**2, 0.0))) / SPACING).clip(0.0)


@pytest.mark.parametrize(("level", "mean", "most"), [(1, 0.45, 0.85), (2, 0.2, 0.45), (4, 0.06, 0.13)])
def test_levels(level, mean, most):
    result = surfel.combine(ball(N, 1) - ball(N, 2, x=1.0), cut="split", level=level)
    assert not result.surfels.clips.counts.any()
    reach = over(result.surfels)
    assert reach[reach > 0.0].mean() < mean
    assert reach.max() < most
    assert area(result) == pytest.approx(4.0 * PI, rel=1.5e-3)


def test_a_tolerance_is_kept():
    reach = over(surfel.combine(ball(N, 1) - ball(N, 2, x=1.0), cut="split", tolerance=0.1 * SPACING).surfels)
    assert reach.max() <= 0.1


def test_small_surfels_lie_on_the_surface_and_interpolate():
    a = ball(N, 1)
    warm = surfel.Surfels(
        a.points, a.normals, colors=np.rint(127.0 + 120.0 * a.points).astype(np.uint8),
        attributes={"heat": a.points @ [1.0, 2.0, 3.0], "kind": (a.points[:, 0] > 0.5).astype(int)},
    )  # fmt: skip
    result = surfel.combine(warm - ball(N, 2, x=1.0), cut="split", level=3).surfels
    first = result.attributes["leaf"] == 0
    points = result.points[first]
    assert np.abs(np.linalg.norm(points, axis=1) - 1.0).max() < 1e-3 * SPACING
    assert np.einsum("ij,ij->i", points, result.normals[first]).min() > 0.9999
    assert np.abs(result.attributes["heat"][first] - points @ [1.0, 2.0, 3.0]).max() < 0.05 * np.sqrt(14.0) * SPACING
    assert np.abs(result.colors[first] - (127.0 + 120.0 * points)).max() < 3.0
    assert set(result.attributes["kind"]) <= {0, 1}


def test_what_is_split_measures_as_what_is_clipped():
    found = surfel.measure(surfel.combine(ball(N, 1) - ball(N, 2, x=1.0), cut="split").surfels, lines=4096)
    assert found.area.value == pytest.approx(4.0 * PI, rel=2e-3)
