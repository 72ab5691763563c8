"""Grids that grow while points come and go: what was given is found again, what was not is refused, all stays safe."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import surfel
from surfel.bounding.refit import limits

DIRECTIONS = [(0, 0, 1), (0, 1, 0), (-1, 0, 0), (1.0, 2.0, 4.0), (-3.0, 0.5, 0.2)]
KINDS = ("random", "borders", "lattice", "duplicates", "far", "heights")


def batch(rng, kind, unit, middle, count):
    """Return points about a middle that drifts; the first batch lies over a square of the unit."""
    if kind in ("borders", "lattice"):
        steps = rng.integers(0, 13, (count, 2)) / (12.0 if kind == "borders" else 1.0)
        plane = (steps + np.round(middle * 12) / (12.0 if kind == "borders" else 1.0)) * unit
    else:
        plane = (rng.random((count, 2)) + middle) * unit
    heights = 0.3 * rng.standard_normal(count)
    if kind == "heights":
        heights *= 10.0 ** rng.integers(-12, 13, count)
    points = np.column_stack([plane, heights])
    return np.repeat(points[: count // 3 + 1], 3, axis=0)[:count] if kind == "duplicates" else points


def micro_cells(spline, first, points):
    """Return which micro-cell counts each point: found on the grid of the fit, as the fit finds it, and then moved."""
    frame, split = spline.frame, spline.memory.split
    r, x = frame.rotation, points.T
    found = []
    for axis in (0, 1):
        place = ((r[axis, 0] * x[0] + r[axis, 1] * x[1] + r[axis, 2] * x[2]) - frame.low[axis]) * frame.scale[axis]
        cell = np.floor(place)
        beyond = place >= first[axis]
        cell[beyond] = np.ceil(place[beyond]) - 1
        micro = np.minimum(np.floor((place - cell) * split), split - 1)
        found.append(((cell + frame.origin[axis]) * split + micro).astype(np.int64))
    return tuple(found)


def exact_value(coefficients, u, v):
    """Return the spline's value in exact rationals."""
    parts = []
    for t, cells in ((u, coefficients.shape[0] - 3), (v, coefficients.shape[1] - 3)):
        h = min(int(t), cells - 1)
        s = Fraction(float(t)) - h
        q = 1 - s
        parts.append((h, (q**3, 4 + s**2 * (3 * s - 6), 4 + q**2 * (3 * q - 6), s**3)))
    (h, along_u), (k, along_v) = parts
    total = Fraction(0)
    for i in range(4):
        for j in range(4):
            total += along_u[i] * along_v[j] * Fraction(float(coefficients[h + i, k + j]))
    return total / 36


def check(spline, points, first):
    sign = 1.0 if spline.side == "above" else -1.0
    assert spline.verify(points) == (0, 0.0)
    assert spline.report.points == len(points)
    assert spline.trim_mask(points).all()
    uv, heights = spline.to_domain(points)
    gap = sign * (spline.to_scipy()(uv) - heights)
    assert (gap >= 0.0).all()
    assert gap.max() <= spline.report.gap_max * (1 + 1e-9) + 1e-14 * np.abs(spline.coefficients).max()
    for i in gap.argsort()[:2]:
        assert sign * (exact_value(spline.coefficients, *uv[i]) - Fraction(float(heights[i]))) >= 0
    counts = np.zeros(spline.memory.count.shape, np.int64)
    places = micro_cells(spline, first, points)
    np.add.at(counts, places, 1)
    assert (counts == spline.memory.count).all()
    reference = replace(spline, coefficients=spline.memory.reference).to_scipy()(uv)
    assert (sign * (heights - reference) <= limits(spline.memory)[places]).all()


def check_strangers_are_refused(spline, points, first, rng):
    frame = spline.frame
    strangers = [frame.to_world([frame.cells + 0.5], 0.0), frame.to_world([[-0.5, 0.5]], 0.0)]
    row = int(rng.integers(len(points)))
    up = frame.direction * (1.0 if spline.side == "above" else -1.0)
    strangers.append(points[row : row + 1] + 4.0 * (1.0 + spline.report.gap_max + np.ptp(spline.memory.height)) * up)
    alone = np.argwhere((spline.memory.count == 1) & ~spline.memory.gone)
    places = np.stack(micro_cells(spline, first, points), axis=1)
    for micro in alone[:1]:  # another point where there is one: to forget that would not be safe
        lower = points[(places == micro).all(axis=1)] - 0.01 * up * (1.0 + np.abs(spline.memory.height).max())
        if np.all(np.stack(micro_cells(spline, first, lower), axis=1) == micro):
            strangers.append(lower)
    bare = np.argwhere(spline.memory.count == 0)
    if len(bare):
        there = (bare[:1] + 0.5) / spline.memory.split
        somewhere = frame.to_world(there, spline(there, trimmed=False) - 1e-3 * np.ptp(points @ up) * (up @ up))
        if np.all(np.stack(micro_cells(spline, first, somewhere), axis=1) == bare[:1]):
            strangers.append(somewhere)
    for stranger in strangers:
        with pytest.raises(surfel.InputError, match="not among"):
            spline.removed(stranger)


def come_and_go(seed, steps, path):
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    unit = float(rng.choice([0.1, 0.5, 1.0 / 3.0, 1.0, 7.0]))
    offset = rng.choice([0.0, 0.1, -1e3, 5e5, 1e6], 3) if kind != "far" else np.array([1e6, -1e6, 1e6])
    options = {
        "direction": DIRECTIONS[rng.integers(len(DIRECTIONS))],
        "side": str(rng.choice(["above", "below"])),
        "mode": str(rng.choice(["paper", "fast", "tight"])),
        "boundary": str(rng.choice(["open", "clamped"])),
        "shape": tuple(rng.integers(4, 14, 2)),
    }
    turn = surfel.bounding.frame.rotation_onto(np.asarray(options["direction"]) / np.linalg.norm(options["direction"]))
    drift = rng.normal(0.0, 0.15, 2)

    def more(step, count):
        return batch(rng, kind, unit, drift * step, count) @ turn + offset

    points = more(0, int(rng.integers(1, 300)))
    spline = surfel.bound(points if rng.random() < 0.8 else np.array_split(points, 3), **options)
    first = spline.frame.cells.copy()
    check(spline, points, first)
    for step in range(1, steps):
        act = rng.integers(0, 8)
        if act <= 2:
            new = more(step, int(rng.integers(1, 80)))
            try:
                spline, points = spline.inserted(new), np.concatenate([points, new])
            except surfel.InputError as error:
                assert "fit a new surface" in str(error)
        elif act <= 4 and len(points) > 1:
            order = rng.permutation(len(points))
            if rng.random() < 0.4:  # one side of what there is
                order = (points @ turn[rng.integers(2)]).argsort()
            gone = order[: rng.integers(1, len(points))]
            spline, points = spline.removed(points[gone]), np.delete(points, gone, axis=0)
        elif act <= 6:
            spline = spline.refitted()
        else:
            spline.save(path)
            spline = surfel.SafeSpline.load(path)
        check(spline, points, first)
    check_strangers_are_refused(spline, points, first, rng)
    return spline


def test_a_point_at_the_old_border_goes_from_where_it_was_counted():
    points = np.random.default_rng(0).random((500, 3))
    points[0] = [1.0, 0.5, 0.5]
    new = np.array([[1.0 + 1e-3, 0.5, 5.0], [1.3, 0.5, 0.5]])
    spline = surfel.bound(points, shape=(6, 6)).inserted(new).removed(points[:1]).refitted()
    rest = np.concatenate([points[1:], new])
    assert spline.verify(rest) == (0, 0.0)
    assert spline.report.points == len(rest)


@pytest.mark.parametrize("beyond", [(1.3, 0.5), (-0.3, 0.5), (0.5, 1.3), (0.5, -0.3)])
def test_the_outermost_points_are_found_after_growth_on_each_side(beyond):
    points = np.random.default_rng(0).random((500, 3))
    grown = surfel.bound(points, shape=(6, 6)).inserted([[*beyond, 0.5]])
    for i in (*points[:, :2].argmax(axis=0), *points[:, :2].argmin(axis=0), 100):
        assert grown.removed(points[i : i + 1]).report.points == 500
    assert grown.removed(points).report.points == 1


def test_growth_adds_no_more_cells_than_the_points_need():
    points = np.random.default_rng(0).random((500, 3))
    points[:4, :2] = [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0]]
    lid = surfel.bound(points, shape=(6, 6))
    assert lid.inserted([[1.1, 0.5, 0.5]]).shape == (7, 6)
    assert lid.inserted([[1.2, 0.5, 0.5]]).shape == (7, 6)  # at the border of the cell that it needs
    assert lid.inserted([[-0.1, 0.5, 0.5]]).shape == (7, 6)
    assert lid.inserted([[-0.1, -0.3, 0.5]]).inserted([[-0.1, 1.3, 0.5]]).shape == (7, 10)


def test_far_from_zero_a_narrow_grid_grows_safely():
    # beside such a width one unit in the last place of the offset is a large share of a cell
    rng = np.random.default_rng(3)
    points = np.column_stack([1e6 + rng.integers(0, 40, (300, 2)) * 1.2e-10, rng.random(300)])
    new = points[:50] - [2.4e-9, 1.2e-9, 0.0]
    grown = surfel.bound(points, shape=(9, 9)).inserted(new)
    both = np.concatenate([points, new])
    check(grown, both, np.array([8, 8]))
    left = grown.removed(points[:200]).refitted()
    check(left, both[200:], np.array([8, 8]))


def test_many_new_fits_in_a_row_stay_safe_beside_heights_that_went():
    points = np.random.default_rng(5).random((400, 3))
    huge = np.array([[0.52, 0.48, 1e15]])
    spline = surfel.bound(np.concatenate([points, huge]), shape=(8, 8)).inserted([[-0.2, 0.5, 0.5]])
    for _ in range(3):
        spline = spline.refitted()
    spline = spline.removed(huge)
    rest = np.concatenate([points, [[-0.2, 0.5, 0.5]]])
    for _ in range(5):
        spline = spline.refitted()
        check(spline, rest, np.array([7, 7]))


def test_what_cannot_have_been_given_is_refused():
    points = np.random.default_rng(1).random((40, 3))
    lid = surfel.bound(points, shape=(9, 9))
    micro = micro_cells(lid, (8, 8), points)
    alone = np.flatnonzero(lid.memory.count[micro] == 1)[0]
    for change in ([0.0, 0.0, -0.1], [0.0, 0.0, 9.0], [0.0, 1e-15, 0.0]):
        with pytest.raises(surfel.InputError, match="not among"):
            lid.removed(points[alone : alone + 1] + change)
    assert lid.removed(points[alone : alone + 1]).report.points == 39


def test_a_point_that_came_back_counts_as_there():
    lid = surfel.bound(np.random.default_rng(1).random((40, 3)), shape=(5, 5))
    bare = np.argwhere(lid.memory.count == 0)[:1]
    place = lid.frame.to_world((bare + 0.5) / lid.memory.split, 0.0)
    top, low = place + [0.0, 0.0, 5.0], place + [1e-3, 0.0, 4.0]
    lid = lid.inserted(np.concatenate([top, low]))
    here = micro_cells(lid, (4, 4), top)
    assert micro_cells(lid, (4, 4), low) == here
    assert np.stack(here, axis=1).tolist() == bare.tolist() and lid.memory.count[here] == 2
    left = lid.removed(top)
    assert left.memory.gone[here].all()
    assert left.removed(low).memory.count[here] == 0  # the worst point went before
    back = left.inserted(top)
    assert not back.memory.gone[here].any()
    with pytest.raises(surfel.InputError, match="not among"):
        back.removed(np.concatenate([low, low]))


def test_steep_places_stay_safe_when_many_cells_come_before_them():
    # old coordinates are rounded to fewer bits then, and on a slope that moves the surface by more than its own slack
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 40), np.linspace(0.0, 1.0, 40))
    points = np.column_stack([x.ravel(), y.ravel(), np.sin(30.0 * x.ravel())])
    lid = surfel.bound(points, shape=(20, 20))
    new = np.column_stack([rng.random((400, 2)), np.zeros(400)])
    new[:, 2] = lid(new) + 1e-6
    lid = lid.inserted(new)
    both = np.concatenate([points, new, [[-100.0, 0.5, 0.0]], [[0.5, -50.0, 0.0]]])
    for far in both[-2:]:
        lid = lid.inserted(far[None])
    assert lid.shape > (1900, 900)
    assert lid.verify(both) == (0, 0.0)


@pytest.mark.parametrize("seed", range(14))
def test_random_clouds_come_and_go(seed, tmp_path):
    come_and_go(seed, 12, tmp_path / "lid.npz")


@pytest.mark.slow
def test_many_random_clouds_come_and_go(tmp_path):
    for seed in range(100, 400):
        come_and_go(seed, 25, tmp_path / "lid.npz")
