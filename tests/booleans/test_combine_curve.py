"""The curve of intersection: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, ball, cube, sampled
from surfel.booleans.surfaces import SheetSurface, SmoothSurface


def length(line):
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def off_circle(line):
    return np.hypot(np.hypot(line[:, 1], line[:, 2]) - np.sqrt(0.75), line[:, 0] - 0.5)


@pytest.mark.parametrize("n", [8000, 500], ids=["as dense", "sixteen times sparser"])
def test_the_circle_of_two_balls(n):
    spacing = np.sqrt(4.0 * PI / n)
    for tree in (ball(8000, 1) | ball(n, 2, x=1.0), ball(8000, 1) - ball(n, 2, x=1.0)):
        (line,) = surfel.combine(tree).curve
        assert np.array_equal(line[0], line[-1])
        assert off_circle(line).mean() < (1e-3 if n == 8000 else 4e-3) * spacing
        assert length(line) == pytest.approx(2.0 * PI * np.sqrt(0.75), rel=2e-3)
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < 1.2 * np.sqrt(4.0 * PI / 8000)


def test_on_clean_smooth_scans_the_published_surface_is_met_far_better_than_the_sheets():
    a, b = (sampled(surfel.Sphere(1.0).translated((x, 0.0, 0.0)), 8000, 1, "random") for x in (0.0, 1.0))
    spacing = np.sqrt(4.0 * PI / 8000)
    (line,) = surfel.combine(a | b).curve
    assert off_circle(line).max() < 1e-3 * spacing
    towards = np.array([[1.0, 0.0, 0.0]])
    inner = 0.4 * spacing  # so far above the surface
    places = (1.0 + inner) * a.points[:200]
    for surface, close in ((SmoothSurface(a.operand), 1e-3), (SheetSurface(a.operand), 2e-2)):
        height, normal = surface.over(places, np.repeat(towards, 200, axis=0))
        assert np.abs(height - inner).mean() < close * spacing
        assert np.einsum("ij,ij->i", normal, a.points[:200]).min() > 0.999


def test_exact_surfaces_are_met_exactly():
    big, small = surfel.Cylinder(1.0, 4.0), surfel.Cylinder(0.7, 4.0).rotated((1, 0, 0), 90.0)
    lines = surfel.combine(big | small, spacing=0.06).curve
    assert len(lines) == 2
    for line in lines:
        assert np.array_equal(line[0], line[-1])
        assert np.abs(np.hypot(line[:, 0], line[:, 1]) - 1.0).max() < 1e-12
        assert np.abs(np.hypot(line[:, 0], line[:, 2]) - 0.7).max() < 1e-12
        angle = np.linspace(0.0, 2.0 * PI, 20_001)  # x = .7 cos, z = .7 sin, y = sqrt(1 - x^2)
        x, z = 0.7 * np.cos(angle), 0.7 * np.sin(angle)
        true = length(np.stack([x, np.sqrt(1.0 - x * x), z], axis=1))
        assert length(line) == pytest.approx(true, rel=1e-3)


@pytest.mark.parametrize("scanned", [False, True])
def test_the_corner_of_a_cube_cut_by_a_ball(scanned):
    box = cube(12_000, 3) if scanned else surfel.Box(2)
    (line,) = surfel.combine(box - surfel.Sphere(0.8).translated((1, 1, 1)), spacing=0.05).curve
    assert np.array_equal(line[0], line[-1])
    assert length(line) == pytest.approx(1.2 * PI, rel=1e-3)
    for edge in ((0.2, 1.0, 1.0), (1.0, 0.2, 1.0), (1.0, 1.0, 0.2)):  # three arcs meet on the edges
        assert np.linalg.norm(line - edge, axis=1).min() < 1e-3


def test_two_curves_and_none():
    rod = sampled(surfel.Cylinder(0.3, 4.0), 12_000, 4)
    lines = surfel.combine(ball(8000, 1) | rod).curve
    assert len(lines) == 2
    for line in lines:
        assert length(line) == pytest.approx(0.6 * PI, rel=5e-3)
    assert surfel.combine(ball(3000, 1) | ball(3000, 2, 1.0, 5.0)).curve == []


def test_only_what_bounds_the_result_is_traced():
    half = surfel.HalfSpace((0, 0, 1), 0.0)
    lines = surfel.combine((ball(8000, 1) | ball(8000, 2, x=1.0)) & half).curve
    whole = sum(length(line) for line in lines)
    arcs = 2.0 * (2.0 * PI - 2.0 * PI / 3.0)  # of the two circles in the plane, outside of each other
    assert whole == pytest.approx(PI * np.sqrt(0.75) + arcs, rel=0.02)
