"""Passages of lines through clouds: on the sheets, not on the triangles between the points, and even on every line."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel import Lines, Surfels
from surfel.shapes.cloud_passages import closed_events


def lines_through(reach, count=3000, seed=6):
    rng = np.random.default_rng(seed)
    origins, directions = rng.uniform(-1.0, 1.0, (count, 3)) * reach, rng.standard_normal((count, 3))
    return Lines(origins, directions / np.linalg.norm(directions, axis=1, keepdims=True), np.ones(count))


def through_box(lines, half):
    """Return where lines enter and leave a box, NaN where they miss it."""
    with np.errstate(divide="ignore"):
        a, b = (-half - lines.origins) / lines.directions, (half - lines.origins) / lines.directions
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    hit = enter < leave
    return np.where(hit, enter, np.nan), np.where(hit, leave, np.nan)


def length_inside(events):
    place = np.arange(len(events.t)) - events.offsets[events.lines]
    return np.bincount(events.lines, np.where(place % 2 == 0, -events.t, events.t), minlength=len(events))


def test_edges_are_not_cut_off():
    box = truth.box(6000, 1)
    cloud = Surfels(box.points, box.normals)
    lines = lines_through(0.6)
    raw = cloud.cross(lines)
    enter, leave = through_box(lines, np.full(3, 0.5))
    exact = np.nan_to_num(leave - enter)
    before, after = cloud._sheets(raw), closed_events(cloud, lines, raw)
    even = before.counts % 2 == 0
    flat, curved = (np.abs(length_inside(found) - exact)[even].mean() for found in (before, after))
    assert curved < 0.5 * flat
    assert length_inside(after).sum() == pytest.approx(exact.sum(), rel=1e-3)


def test_passages_lie_on_a_smooth_surface():
    ball = truth.sphere(2000, 2)
    cloud = Surfels(ball.points, ball.normals)
    lines = lines_through(0.5)
    raw = cloud.cross(lines)
    found = closed_events(cloud, lines, raw)
    off = np.linalg.norm(lines.origins[found.lines] + found.t[:, None] * lines.directions[found.lines], axis=1) - 1.0
    far = np.abs(off) / np.sqrt(4.0 * np.pi / 2000)
    assert (found.counts == 2).all() and far.mean() < 0.01 and np.quantile(far, 0.99) < 0.06 and far.max() < 0.5
    assert (np.diff(found.t)[np.diff(found.lines) == 0] > 0.0).all()


@pytest.mark.parametrize("given", [True, False])
def test_lines_that_leak_are_asked_all_along(given):
    """Six hundred points on a ring so thin that lines often find only one of its two sides."""
    ring = truth.torus(1000, 2, 1.0, 0.07)
    cloud = Surfels(ring.points, ring.normals if given else None, solid=True)
    count = 20_000
    rng = np.random.default_rng(3)
    origins = np.column_stack([rng.uniform(-1.1, 1.1, (count, 2)), np.full(count, -1.0)])
    lines = Lines(origins, np.tile([0.0, 0.0, 1.0], (count, 1)), np.ones(count))
    raw = cloud.cross(lines)
    before, after = cloud._sheets(raw), closed_events(cloud, lines, raw)
    odd = before.counts % 2 == 1
    assert odd.sum() > 30 and (after.counts % 2 == 0).all()
    across = np.hypot(origins[:, 0], origins[:, 1]) - 1.0
    exact = 2.0 * np.sqrt(np.maximum(0.07**2 - across**2, 0.0))
    assert length_inside(after)[odd].sum() == pytest.approx(exact[odd].sum(), rel=0.15)


def test_an_open_cloud_said_to_be_a_solid_is_even_on_every_line():
    cap = truth.capless_sphere(6000, 0.05)
    cloud = Surfels(cap.points, cap.normals, solid=True)
    lines = lines_through(0.7)
    raw = cloud.cross(lines)
    before, after = cloud._sheets(raw), closed_events(cloud, lines, raw)
    odd = before.counts % 2 == 1
    assert odd.sum() > 30 and (after.counts % 2 == 0).all()
    assert np.array_equal(after.counts[~odd], before.counts[~odd])
    assert np.abs(length_inside(after)[odd]).min() > 0.0 and length_inside(after)[odd].max() < 2.1


def test_noise_is_left_as_it_was_taken_off():
    """Sheets through noisy points would be noisy; the triangles are those of the projected points."""
    ball = truth.sphere(4000, 4)
    cloud = Surfels(ball.noisy(0.5, 1), ball.normals)
    lines = lines_through(0.5, 500)
    raw = cloud.cross(lines)
    before, after = cloud._sheets(raw), closed_events(cloud, lines, raw)
    even = before.counts % 2 == 0
    assert np.array_equal(length_inside(after)[even], length_inside(before)[even])


def test_no_lines_and_no_surface():
    cloud = Surfels(truth.sphere(500).points)
    nothing = Lines(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    assert len(closed_events(cloud, nothing, cloud.cross(nothing))) == 0
    lone, lines = Surfels([[0.0, 0, 0]], solid=True), lines_through(1.0, 5)
    assert closed_events(lone, lines, lone.cross(lines)).counts.tolist() == [0] * 5
