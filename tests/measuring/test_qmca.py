"""QMCA as published: its formula, its parameters, its known weaknesses, and what is not its business."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel.lines.enclosing import smallest_ball
from surfel.lines.models import line_block
from surfel.lines.sequences import shifts
from surfel.shapes.clusters import Reading
from surfel.shapes.lpsi import Lpsi


def grid_cube(side=60):
    """Return the grid points of a cube's faces, each once, with the normals of one of their faces."""
    g = np.linspace(-0.5, 0.5, side)
    u, v = (a.ravel() for a in np.meshgrid(g, g, indexing="ij"))
    points, normals = [], []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            p, n = np.empty((len(u), 3)), np.zeros(3)
            p[:, axis], p[:, (axis + 1) % 3], p[:, (axis + 2) % 3] = sign, u, v
            n[axis] = 2.0 * sign
            points.append(p)
            normals.append(np.tile(n, (len(u), 1)))
    points, normals = np.concatenate(points), np.concatenate(normals)
    _, first = np.unique(np.round(points * 1e6), axis=0, return_index=True)
    return surfel.Surfels(points[first], normals=normals[first])


BALL = truth.even_sphere(20_000)
SPHERE = surfel.Surfels(BALL.points, normals=BALL.normals)
SMALL = surfel.Surfels(BALL.points[::40], normals=BALL.normals[::40])


def area(cloud, **options):
    return surfel.measure(cloud, method="qmca", **{"lines": 5000, **options}).area.value


def test_simple_shapes_come_out_as_in_the_paper():
    assert area(SPHERE, radius_factor=3.0) == pytest.approx(4 * np.pi, rel=0.01)
    assert area(grid_cube(), lines=20_000) == pytest.approx(6.0, rel=0.015)


@pytest.mark.parametrize("model", ["chord", "tangent", "offset"])
@pytest.mark.parametrize("seed", [0, 7])
def test_the_area_is_that_of_equation_3(model, seed):
    m = surfel.measure(SPHERE, method="qmca", lines=3000, seed=seed, model=model, radius_factor=2.0, depth=3)
    counter = Lpsi.of(SPHERE.points, SPHERE.normals, radius_factor=2.0, depth=3)
    ball = smallest_ball(SPHERE.points).grown(counter.radius)
    shift = shifts(seed, 1)[0] if seed else None
    n = counter.counts(line_block("niederreiter", model, ball, 0, 3000, 3000, shift)).sum()
    assert m.area.value == pytest.approx(n / 6000.0 * 4 * np.pi * ball.radius**2, rel=1e-12)
    assert (m.method, m.lines, m.seed, m.points) == ("qmca", 3000, seed, 20_000)


def test_there_is_no_error_bar_and_it_is_said_why():
    m = surfel.measure(SPHERE, method="qmca", lines=1000)
    assert np.isinf(m.area.standard_error) and not m.area.reliable and "no error bar" in m.area.reason
    assert m.volume is None and m.areas[0].value == m.area.value and m.area.reason in m.warnings
    assert m.to_dict()["area"]["standard_error"] is None


def test_parameters_reach_the_counter():
    base = area(SPHERE)
    wide = Lpsi.of(SPHERE.points, SPHERE.normals, reading=Reading("cylinder"))
    lines = line_block("niederreiter", "tangent", smallest_ball(SPHERE.points).grown(wide.radius), 0, 5000, 5000)
    ball_area = smallest_ball(SPHERE.points).grown(wide.radius).surface
    assert area(SPHERE, cells="cylinder") == pytest.approx(wide.counts(lines).sum() / 1e4 * ball_area, rel=1e-12)
    for other in ({"radius_factor": 0.5}, {"depth": 6}, {"sequence": "r4"}, {"density": "uneven"}, {"denoise": 1}):
        assert area(SPHERE, **other) != base
    assert area(SPHERE) == base


def test_radii_are_used_where_there_are_any():
    gap = Lpsi.of(SPHERE.points, SPHERE.normals).gap
    wide = surfel.Surfels(SPHERE.points, normals=SPHERE.normals, radii=np.full(len(SPHERE), 2.0 * gap))
    assert area(wide, radius_factor=0.75) == pytest.approx(area(SPHERE), rel=1e-12)


def test_orientation_matters_here_and_not_to_the_default():
    signs = np.where(np.random.default_rng(0).random(len(SPHERE)) < 0.5, -1.0, 1.0)[:, None]
    mixed = surfel.Surfels(SPHERE.points, normals=SPHERE.normals * signs)
    assert area(mixed, radius_factor=2.0) > 1.3 * area(SPHERE, radius_factor=2.0)
    one, other = (surfel.measure(cloud, lines=256) for cloud in (SPHERE, mixed))
    assert other.area.value == one.area.value and other.area.standard_error == one.area.standard_error


def thinned_sphere():
    """Return points whose distance to the nearest grows by four from pole to pole."""
    from scipy.spatial import cKDTree

    p = truth.uneven_sphere(20_000, 1).points
    p = p[np.argsort(-p[:, 2], kind="stable")]
    near = cKDTree(p).query_ball_point(p, 0.03 * 4.0 ** (0.5 * (1.0 - p[:, 2])))
    alive = np.ones(len(p), bool)
    for row in range(len(p)):
        if alive[row]:
            alive[[other for other in near[row] if other > row]] = False
    return p[alive]


def test_uneven_sampling_is_met_by_an_uneven_cylinder_or_by_resampling():
    p = thinned_sphere()
    cloud = surfel.Surfels(p, normals=p)
    even, uneven, more = (
        abs(area(cloud, density=density, lines=20_000, cells="cylinder") / (4 * np.pi) - 1.0)
        for density in ("even", "uneven", "resampled")
    )
    assert uneven < 0.5 * even and more < 0.5 * even and even > 0.02
    m = surfel.measure(cloud, method="qmca", density="resampled", lines=64)
    assert any("points were inserted" in text for text in m.warnings)


def test_the_filter_tells_how_far_it_moved_the_points():
    noisy = surfel.Surfels(
        BALL.points * (1.0 + 0.002 * np.random.default_rng(1).standard_normal((20_000, 1))), BALL.normals
    )
    m = surfel.measure(noisy, method="qmca", denoise=2, lines=5000)
    assert any("bilateral filter moved the points by" in text for text in m.warnings)


def test_small_cells_are_warned_of():
    text = "small for a cylinder"
    assert any(text in w for w in surfel.measure(SMALL, method="qmca", lines=64).warnings)
    assert not any(text in w for w in surfel.measure(SMALL, method="qmca", lines=64, cells="cylinder").warnings)
    assert not any(text in w for w in surfel.measure(SPHERE, method="qmca", lines=64).warnings)


def test_what_was_left_out_is_counted():
    p = np.concatenate([SMALL.points, SMALL.points[:5], SMALL.points[:3] + 0.01, [[np.nan, 0, 0]]])
    n = np.concatenate([SMALL.normals, SMALL.normals[:5], np.zeros((3, 3)), [[0, 0, 1]]])
    m = surfel.measure(surfel.Surfels(p, normals=n), method="qmca", lines=64)
    assert m.cleaning == {"non_finite": 1, "without_normal": 3, "duplicates": 5}
    assert m.points == len(p)


def test_leak_is_the_share_of_odd_lines():
    assert surfel.measure(SPHERE, method="qmca", radius_factor=2.0, cells="cylinder").leak < 0.02
    half = truth.half_sphere(5000)
    m = surfel.measure(surfel.Surfels(half.points, normals=half.normals), method="qmca", radius_factor=3.0)
    assert m.leak > 0.3 and not m.closed


@pytest.mark.parametrize("points", [[], [[0, 0, 0]], [[1, 2, 3]] * 5])
def test_nothing_to_measure(points):
    m = surfel.measure(surfel.Surfels(np.reshape(points, (-1, 3)).astype(float)), method="qmca", lines=16)
    assert (m.area.value == 0.0) if not points else np.isnan(m.area.value)
    assert m.warnings


def test_a_flat_cloud_and_two_points_are_measured():
    flat = truth.square(3000)
    assert 0.5 < area(surfel.Surfels(flat.points, normals=flat.normals), radius_factor=2.0) < 1.5
    assert area(surfel.Surfels([[0, 0, 0], [1, 0, 0]], normals=[[0, 0, 1]] * 2)) >= 0.0


def test_progress_is_told():
    seen = []
    surfel.measure(SMALL, method="qmca", lines=200_000, progress=lambda share, what: seen.append(share))
    assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) > 2


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"radius_factor": -1.0}, "radius_factor must be positive"),
        ({"depth": 11}, "depth must be between 1 and 10"),
        ({"cells": "some"}, "cells must be one of line, cylinder"),
        ({"density": "odd"}, "density must be one of even, uneven, resampled"),
        ({"denoise": -1}, "denoise must be between 0 and 100"),
        ({"tolerance": 0.01}, "no error bar that a tolerance"),
        ({"reference": "box"}, "through the enclosing ball"),
    ],
)
def test_wrong_arguments(options, says):
    with pytest.raises(surfel.InputError, match=says):
        area(SMALL, **options)


def test_other_shapes_are_refused():
    with pytest.raises(surfel.InputError, match="measures clouds, and this is a Sphere"):
        area(surfel.Sphere(1.0))
    with pytest.raises(surfel.InputError, match="measures clouds, and this is a Mesh"):
        area(surfel.Mesh(*truth.box_mesh()))
