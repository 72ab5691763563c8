"""LPSI against an oracle that follows the text of Liu et al. word by word, and its four cases by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel._numba import threads_for
from surfel.core.lines import Lines
from surfel.shapes.clusters import CELLS, HALVES, Reading
from surfel.shapes.lpsi import Lpsi

RNG = np.random.default_rng(3)


def random_lines(number, reach=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return Lines.of(rng.uniform(-reach, reach, (number, 3)), rng.standard_normal((number, 3)), 1.0)


def mean_nearest(points):
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1)


def cell_of(points, depth):
    """Return which cell of the octree's grid each point lies in, and the corners of those cells."""
    low, size = points.min(axis=0), np.ptp(points, axis=0).max()
    place = np.minimum(((points - low) * (2**depth / size)).astype(int), 2**depth - 1)
    side = size / 2**depth
    return low + place * side, low + (place + 1) * side


def by_the_text(points, normals, origin, direction, radius, gap, depth, reading):
    """Return t and cosine of every resultant cluster of one line; radius and gap are one number for each point."""
    t = (points - origin) @ direction
    away = np.linalg.norm(points - origin - t[:, None] * direction, axis=1)
    inside = away < radius
    if reading.cells == "line":
        low, high = cell_of(points, depth)
        with np.errstate(divide="ignore", invalid="ignore"):
            one, two = (low - origin) / direction, (high - origin) / direction
        inside &= np.minimum(one, two).max(axis=1) <= np.maximum(one, two).min(axis=1)
    rows = np.flatnonzero(inside)
    rows = rows[np.argsort(t[rows], kind="stable")]
    clusters, found = [], []
    for row in rows:
        if clusters and t[row] - t[clusters[-1][-1]] <= gap[row] + gap[clusters[-1][-1]]:
            clusters[-1].append(row)
        else:
            clusters.append([row])
    projected = origin + t[:, None] * direction
    out = np.einsum("ij,ij->i", normals, projected - points) > 0.0
    up = normals @ direction > 0.0
    for cluster in clusters:
        if all(out[q] for q in cluster):
            continue
        if len({up[q] for q in cluster}) == 1:
            parts = [cluster]
        elif reading.halves == "sides":
            parts = [[q for q in cluster if up[q]], [q for q in cluster if not up[q]]]
            parts = [part for part in parts if not all(out[q] for q in part)]
        else:
            first = next(k for k, q in enumerate(cluster) if up[q] != up[cluster[0]])
            parts = [cluster[:first], cluster[first:]]
            if reading.halves == "again":
                parts = [part for part in parts if not all(out[q] for q in part)]
        found += [(np.mean(t[part]), np.mean(normals[part] @ direction)) for part in parts]
    return sorted(found)


def rough_cloud(n=500):
    p = truth.sphere(n, 5).points
    normals = p + 0.5 * RNG.standard_normal(p.shape)
    return p * [1.0, 0.7, 0.4], normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("reading", [Reading(*both) for both in itertools.product(CELLS, HALVES)], ids=".".join)
@pytest.mark.parametrize("cylinder", ["even", "uneven"])
def test_clusters_are_those_of_the_text(reading, cylinder):
    points, normals = rough_cloud()
    counter = Lpsi.of(points, normals, radius_factor=2.5, depth=3, cylinder=cylinder, reading=reading)
    apart = mean_nearest(points)
    radius = np.full(len(points), 2.5 * apart.mean())
    if cylinder == "uneven":
        low, _ = cell_of(points, 3)
        _, cell = np.unique(low, axis=0, return_inverse=True)
        cell = cell.ravel()
        radius = 2.5 * (np.bincount(cell, apart) / np.bincount(cell))[cell]
    lines = random_lines(300)
    crossings = counter.cross(lines)
    kinds = set()
    for row in range(len(lines)):
        expected = by_the_text(points, normals, lines.origins[row], lines.directions[row], radius, radius, 3, reading)
        got = slice(crossings.offsets[row], crossings.offsets[row + 1])
        assert got.stop - got.start == len(expected)
        assert np.allclose(crossings.t[got], [t for t, _ in expected], atol=1e-12)
        assert np.allclose(crossings.cosine[got], [c for _, c in expected], atol=1e-12)
        kinds.add(len(expected))
    assert {0, 1, 2, 3} <= kinds
    assert (crossings.weight == 1.0).all() and (crossings.leaf == 0).all()
    assert np.array_equal(counter.counts(lines), crossings.counts)


def one_line(points, normals, halves="two", **options):
    """Cross points near the z axis with it; a radius of 0.3 and clusters at gaps of 0.6."""
    far = np.array([[50.0, 50.0, 50.0], [-50.0, -50.0, -50.0]])
    points, normals = np.concatenate([points, far]), np.concatenate([normals, np.tile([1.0, 0.0, 0.0], (2, 1))])
    reading = Reading("cylinder", halves)
    counter = Lpsi.of(
        points, np.asarray(normals), np.full(len(points), 0.2), radius_factor=1.5, reading=reading, **options
    )
    assert counter.radius == pytest.approx(0.3)
    return counter.cross(Lines.of([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], 1.0))


def test_case_1_all_projections_are_outside():
    assert len(one_line([[0.1, 0, 0], [-0.1, 0.1, 0.3]], [[-1.0, 0, 0], [0.8, -0.6, 0]]).t) == 0


def test_case_2_points_on_the_line_are_one_touching_point():
    hits = one_line([[0, 0, 0], [0, 0, 0.4]], [[0, 0.6, 0.8], [0, 0.6, -0.8]])
    assert hits.t == pytest.approx([0.2])


def test_case_3_normals_on_one_side_are_one_intersection():
    hits = one_line([[0.1, 0, 1.0], [-0.1, 0, 1.1], [0, 0.1, 1.3]], [[0.6, 0, 0.8], [0, 0, 1], [0, 0.6, 0.8]])
    assert hits.t == pytest.approx([np.mean([1.0, 1.1, 1.3])])  # equation (6)
    assert hits.cosine == pytest.approx([np.mean([0.8, 1.0, 0.8])])


def test_case_4_splits_at_the_first_normal_of_the_other_side():
    points = [[0.1, 0, 0.0], [0.1, 0, 0.1], [0.1, 0, 0.4], [0.1, 0, 0.5]]
    normals = [[0.6, 0, -0.8], [0.6, 0, -0.8], [0.6, 0, 0.8], [0.6, 0, -0.8]]
    assert one_line(points, normals).t == pytest.approx([0.05, 0.45])
    assert one_line(points, normals, "sides").t == pytest.approx([0.2, 0.4])


def test_case_4_counts_both_halves_or_classifies_them_again():
    points = [[0.1, 0, 0.0], [0.1, 0, 0.4]]
    normals = [[0.6, 0, -0.8], [-0.6, 0, 0.8]]  # the second is outside
    assert len(one_line(points, normals, "two").t) == 2
    assert one_line(points, normals, "again").t == pytest.approx([0.0])
    assert one_line(points, normals, "sides").t == pytest.approx([0.0])


def test_clusters_part_where_the_gap_is_wider_than_two_radii():
    normals = [[0.0, 0, 1.0]] * 2
    assert len(one_line([[0.1, 0, 0.0], [0.1, 0, 0.59]], normals).t) == 1
    assert len(one_line([[0.1, 0, 0.0], [0.1, 0, 0.61]], normals).t) == 2


def test_gap_size_is_the_largest_radius_or_the_mean_nearest_distance():
    points, normals = rough_cloud(300)
    assert Lpsi.of(points, normals).gap == pytest.approx(mean_nearest(points).mean(), rel=1e-12)
    radii = RNG.uniform(0.01, 0.1, 300)
    assert Lpsi.of(points, normals, radii).gap == pytest.approx(radii.max(), rel=1e-12)
    twice = Lpsi.of(np.repeat(points, 2, axis=0), np.repeat(normals, 2, axis=0))  # a set holds a point once
    assert twice.gap == pytest.approx(mean_nearest(points).mean(), rel=1e-12)
    assert len(twice.normals) == 300


def test_with_the_cells_of_the_cylinder_the_depth_changes_nothing():
    points, normals = rough_cloud(3000)
    lines = random_lines(400, 0.5)
    results = [
        Lpsi.of(points, normals, depth=depth, reading=Reading("cylinder")).counts(lines) for depth in (1, 4, 5, 8)
    ]
    assert all(np.array_equal(results[0], other) for other in results[1:])
    fine = Lpsi.of(points, normals, depth=8).counts(lines)
    assert fine.sum() < 0.5 * results[0].sum()  # as cells of the line they lose what lies beside them


def test_a_sphere_is_met_where_it_is():
    ball = truth.even_sphere(20_000)
    lines = random_lines(300, 0.5)
    cloud = surfel.Surfels(ball.points, normals=ball.normals)
    hits = cloud.cross(lines, "lpsi", radius_factor=3.0, cells="cylinder")
    assert (hits.counts == 2).mean() > 0.99
    rows = np.flatnonzero(hits.counts == 2)
    middle = np.einsum("ij,ij->i", lines.origins, lines.directions)
    half = np.sqrt(1.0 - np.square(lines.origins).sum(axis=1) + middle**2)
    first = hits.offsets[rows]
    assert np.abs(hits.t[first] - (-middle - half)[rows]).max() < 0.03
    assert np.abs(hits.t[first + 1] - (-middle + half)[rows]).max() < 0.03
    assert np.abs(hits.cosine[first] + half[rows]).max() < 0.05
    assert (hits.cosine[first + 1] > 0.0).all()


def test_the_single_hit_counter_finds_the_first_hit_alone():
    ball = truth.even_sphere(20_000)
    cloud, lines = surfel.Surfels(ball.points, normals=ball.normals), random_lines(300, 0.5)
    hits = cloud.cross(lines, "single", radius_factor=2.5)
    assert (hits.counts == 1).mean() > 0.99 and hits.counts.max() == 1
    middle = np.einsum("ij,ij->i", lines.origins, lines.directions)
    half = np.sqrt(1.0 - np.square(lines.origins).sum(axis=1) + middle**2)
    error = hits.t - (-middle - half)[hits.lines]
    assert np.quantile(np.abs(error), 0.9) < 2e-3  # disks follow the surface: far nearer than a mean of projections


def test_signs_of_normals_matter_to_lpsi_and_not_to_the_patches():
    ball = truth.even_sphere(5000)
    signs = np.where(RNG.random(5000) < 0.5, -1.0, 1.0)[:, None]
    given, mixed = (surfel.Surfels(ball.points, normals=n) for n in (ball.normals, ball.normals * signs))
    lines = random_lines(500, 0.4)
    one, other = (cloud.cross(lines, "lpsi", radius_factor=3.0).counts.sum() for cloud in (given, mixed))
    assert other > 1.3 * one
    a, b = given.cross(lines), mixed.cross(lines)
    assert np.array_equal(a.t, b.t) and np.array_equal(a.weight, b.weight)


def test_units_and_offsets_change_nothing():
    points, normals = rough_cloud(2000)
    lines = random_lines(200, 0.5)
    expected = surfel.Surfels(points, normals=normals).cross(lines, "lpsi")
    moved = Lines(lines.origins * 1024.0 + 2.0**20, lines.directions, lines.weights)
    got = surfel.Surfels(points * 1024.0 + 2.0**20, normals=normals).cross(moved, "lpsi")
    assert np.array_equal(got.counts, expected.counts)
    assert np.allclose(got.t, expected.t * 1024.0, atol=1e-6)
    tiny = Lines(lines.origins * 2.0**-600, lines.directions, lines.weights)
    assert np.array_equal(
        surfel.Surfels(points * 2.0**-600, normals=normals).cross(tiny, "lpsi").counts, expected.counts
    )


def test_threads_change_no_bit():
    points, normals = rough_cloud(2000)
    lines = random_lines(3000, 0.5)
    counter = Lpsi.of(points, normals, radius_factor=2.0)
    with threads_for(10**9, 1):
        one = counter.cross(lines)
    two = counter.cross(lines)
    assert one.t.tobytes() == two.t.tobytes() and one.offsets.tobytes() == two.offsets.tobytes()


def test_more_points_on_a_line_than_there_was_room_for():
    p = np.column_stack([RNG.uniform(-0.01, 0.01, (5000, 2)), np.linspace(0.0, 1.0, 5000)])
    n = np.tile([0.0, 0.0, 1.0], (5000, 1))
    counter = Lpsi.of(p, n, np.full(5000, 0.05), reading=Reading("cylinder"))
    hits = counter.cross(Lines.of([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], 1.0))
    assert hits.t == pytest.approx([p[:, 2].mean()])


def test_points_without_a_normal_take_no_part_where_others_have_one():
    points, normals = rough_cloud(800)
    lines = random_lines(200, 0.5)
    without = np.concatenate([normals, np.zeros((50, 3))])
    more = np.concatenate([points, points[:50] + 0.01])
    one = surfel.Surfels(points, normals=normals).cross(lines, "lpsi")
    two = surfel.Surfels(more, normals=without).cross(lines, "lpsi")
    assert np.array_equal(one.t, two.t)


def test_a_cloud_without_normals_is_given_fitted_ones():
    ball = truth.even_sphere(4000)
    lines = random_lines(200, 0.3)
    fitted = surfel.Surfels(ball.points).cross(lines, "lpsi", radius_factor=2.0)
    given = surfel.Surfels(ball.points, normals=ball.normals).cross(lines, "lpsi", radius_factor=2.0)
    assert (fitted.counts == given.counts).mean() > 0.97


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"counter": "all"}, "counter must be one of patches, lpsi, single"),
        ({"counter": "lpsi", "radius_factor": 0.0}, "radius_factor must be positive"),
        ({"counter": "lpsi", "depth": 0}, "depth must be between 1 and 10"),
        ({"counter": "lpsi", "depth": 2.5}, "depth must be a whole number"),
        ({"counter": "single", "cells": "all"}, "cells must be one of line, cylinder"),
        ({"counter": "lpsi", "cylinder": "wide"}, "cylinder must be one of even, uneven"),
    ],
)
def test_wrong_arguments(arguments, says):
    cloud = surfel.Surfels(*rough_cloud(50))
    with pytest.raises(surfel.InputError, match=says):
        cloud.cross(random_lines(3), **arguments)


def test_what_shows_no_surface_is_refused():
    lines = random_lines(3)
    for points in (np.empty((0, 3)), np.zeros((1, 3)), np.ones((7, 3))):
        with pytest.raises(surfel.InputError, match="fewer than two places"):
            surfel.Surfels(points, normals=np.tile([0.0, 0.0, 1.0], (len(points), 1))).cross(lines, "lpsi")
    with pytest.raises(surfel.InputError, match="radii of the surfels are all zero"):
        surfel.Surfels(*rough_cloud(50), radii=np.zeros(50)).cross(lines, "lpsi")
    with pytest.raises(surfel.InputError, match=r"lines must be a surfel\.Lines"):
        surfel.Surfels(*rough_cloud(50)).cross([[0, 0, 1]], "lpsi")
