"""The core: one value whatever the way to it, derivatives, passes, banded systems, the streamed first pass."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from naive import dense
from surfel._numba import threads_for
from surfel.bounding.candidates import Rows
from surfel.bounding.certify import Lead, largest_gap, slack_of, violations
from surfel.bounding.corners import corners_of, over_corners
from surfel.bounding.energy import energy
from surfel.bounding.evaluate import derivatives, values
from surfel.bounding.frame import frame_over, rotation_onto
from surfel.bounding.gather import gather
from surfel.bounding.normal import PAD, factorize, solve, unknowns_of
from surfel.bounding.occupancy import WHOLE, trimmed_values
from surfel.bounding.passes import keep_highest, no_points, survey
from surfel.bounding.residuals import keep_residuals, no_residuals
from surfel.bounding.source import Source

RNG = np.random.default_rng(21)
DIRECTION = np.array([1.0, -2.0, 2.0]) / 3.0


def scipy_spline(c):
    n, m = c.shape[0] - 2, c.shape[1] - 2
    return NdBSpline((np.arange(-3.0, n + 3.0), np.arange(-3.0, m + 3.0)), c, 3, extrapolate=False)


def laid(points, shape=(7, 6), direction=DIRECTION):
    rotation = rotation_onto(direction)
    _, lowest, highest = survey(points, rotation)
    return frame_over(rotation, lowest, highest, shape)


def test_values_and_derivatives_agree_with_scipy():
    c = RNG.standard_normal((9, 7))
    uv = np.concatenate([RNG.random((500, 2)) * [6.0, 4.0], [[0, 0], [6, 4], [6, 0], [3, 2], [2.5, 4.0]]])
    reference = scipy_spline(c)
    assert np.abs(values(c, uv) - reference(uv)).max() < 1e-14
    all_of = derivatives(c, uv)
    assert (all_of[:, 0] == values(c, uv)).all()
    inside = uv[:500]
    for column, order in ((1, (1, 0)), (2, (0, 1)), (3, (2, 0)), (4, (1, 1)), (5, (0, 2))):
        assert np.abs(all_of[:500, column] - reference(inside, nu=order)).max() < 1e-12


@pytest.mark.parametrize("place", [(-1e-12, 1), (6.0000001, 1), (1, -1), (1, 4.5), (np.nan, 1), (1, np.inf)])
def test_outside_the_domain_is_nan(place):
    c = RNG.standard_normal((9, 7))
    assert np.isnan(values(c, np.array([place], float))).all()
    assert np.isnan(derivatives(c, np.array([place], float))).all()


def test_the_quarter_decides_on_the_trim():
    c = np.zeros((6, 6))
    trim = np.zeros((3, 3), np.uint8)
    uv = np.array([[1.1, 1.5], [1.9, 1.5], [1.5, 1.1], [1.5, 1.9], [0.5, 0.5]])
    for bit, kept in ((1, 0), (2, 1), (4, 2), (8, 3)):
        trim[1, 1] = bit
        assert np.flatnonzero(~np.isnan(trimmed_values(c, trim, uv))).tolist() == [kept]
    trim[1, 1] = WHOLE
    assert np.isnan(trimmed_values(c, trim, uv)).tolist() == [False] * 4 + [True]


@pytest.mark.parametrize("count", [1, 7, 8, 31, 32, 33, 119, 3000, 100_003])
def test_blocks_of_points_give_the_very_values_of_the_kernel(count):
    points = RNG.standard_normal((count, 3)) * [1.0, 5.0, 2.0]
    frame = laid(points)
    c = RNG.standard_normal((9, 8))
    uv, heights = frame.to_domain(points)
    residual = -heights - values(c, uv)
    seen, cells = no_residuals(frame, 4), np.empty(count, np.int32)
    keep_residuals(seen, points, frame, c, -1.0, cells)
    assert seen.points == count and seen.total[0] == pytest.approx(-heights.sum())
    assert seen.largest.max() == residual.max() and seen.smallest.min() == residual.min()
    micro = np.minimum((uv - np.minimum(np.floor(uv), frame.cells - 1)) * 4, 3).astype(int)
    micro += 4 * np.minimum(np.floor(uv), frame.cells - 1).astype(int)
    largest = np.full(seen.largest.shape, -np.inf)
    np.maximum.at(largest, (micro[:, 0], micro[:, 1]), residual)
    assert (largest == seen.largest).all()
    other = RNG.standard_normal((9, 8))
    assert seen.mean_value(other) == pytest.approx(values(other, uv).mean(), abs=1e-12)
    counts = np.zeros(seen.count.shape, np.int64)
    np.add.at(counts, (micro[:, 0], micro[:, 1]), 1)
    assert (counts == seen.count).all()
    h, k = np.minimum(uv.astype(int), frame.cells - 1).T
    assert (cells == h * frame.cells[1] + k).all()
    filled = np.isfinite(seen.by_cell())
    assert (filled == (seen.occupancy > 0)).all()
    bad, worst = violations(frame, -c, np.full(seen.occupancy.shape, WHOLE, np.uint8), points, "below")
    assert bad == (residual > 0).sum() and worst == max(residual.max(), 0.0)


@pytest.mark.parametrize("split", [1, 2, 3, 4])
@pytest.mark.parametrize("size", [(9, 8), (8, 9), (9, 10), (9, 11)])
def test_every_micro_cell_knows_its_points_and_the_highest_of_them(split, size):
    points = RNG.standard_normal((5003, 3))
    points[1000:3000] = points[1000] + 1e-3 * RNG.random((2000, 3))  # a run of points in one cell
    frame, c = laid(points, (size[0] - 2, size[1] - 2)), RNG.standard_normal(size)
    uv, heights = frame.to_domain(points)
    seen = no_residuals(frame, split)
    keep_residuals(seen, points, frame, c, 1.0)
    residual = heights - values(c, uv)
    cell = np.minimum(uv.astype(int), frame.cells - 1)
    micro = split * cell + np.minimum((uv - cell) * split, split - 1).astype(int)
    largest, count = np.full(seen.largest.shape, -np.inf), np.zeros(seen.count.shape, np.int64)
    np.maximum.at(largest, (micro[:, 0], micro[:, 1]), residual)
    np.add.at(count, (micro[:, 0], micro[:, 1]), 1)
    assert (seen.largest == largest).all() and (seen.count == count).all()
    smallest = np.full(seen.smallest.shape, np.inf)
    np.minimum.at(smallest, (cell[:, 0], cell[:, 1]), residual)
    assert (seen.smallest == smallest).all()
    at = [np.flatnonzero((micro == place).all(axis=1)) for place in np.argwhere(count > 0)]
    worst = np.array([some[np.argmax(residual[some])] for some in at])
    assert (seen.uv[count > 0] == uv[worst]).all() and (seen.height[count > 0] == heights[worst]).all()
    weights = np.stack([values(unit.reshape(size), uv).sum() for unit in np.eye(c.size)]).reshape(size)
    assert np.abs(seen.weights - 36.0 * weights).max() < 1e-9
    assert seen.mean_value(c) == pytest.approx(values(c, uv).mean(), abs=1e-12)
    assert seen.total == pytest.approx([heights.sum(), residual.sum()], abs=1e-9)


def test_a_surface_is_proven_where_it_leads_by_more_than_the_residuals():
    points = RNG.standard_normal((5000, 3))
    frame, reference = laid(points), RNG.standard_normal((9, 8))
    seen, of = no_residuals(frame, 4), np.empty(5000, np.int32)
    keep_residuals(seen, points, frame, reference, 1.0, of)
    uv, heights = frame.to_domain(points)
    cells = np.minimum(uv.astype(int), frame.cells - 1)
    lift = seen.largest.max()
    surface = reference + lift + 0.3 * RNG.random(reference.shape)
    lead = Lead.of(surface, reference, seen)
    over = values(surface, uv) - values(reference, uv)
    low, high = (lead.low[cells[:, 0], cells[:, 1]], lead.high[cells[:, 0], cells[:, 1]])
    assert (low < over).all() and (over < high).all() and (high - low).max() < 0.31
    assert (lead.shortfall() < 0.0).all()
    gaps = values(surface, uv) - heights
    assert largest_gap(lead, surface, frame, points, 1.0, of) == gaps.max()
    assert seen.mean_gap(surface, reference) == pytest.approx(gaps.mean(), abs=1e-12)
    assert lead.gap_limits().max() >= gaps.max()
    # without a margin for rounding nothing is proven: a surface that just touches the worst point falls short there
    short = Lead.of(reference + lift, reference, seen).shortfall()
    assert np.argwhere(short > 0.0).tolist() == [list(cells[np.argmax(heights - values(reference, uv))])]
    assert short.max() < 1e-13


def test_the_highest_points_are_kept_also_from_growing_chunks():
    points = RNG.standard_normal((4000, 3)) * [1.0, 3.0, 1.0]
    frame = laid(points)
    uv, heights = frame.to_domain(points)
    kept = no_points(frame, 4)
    keep_highest(kept, points, frame, 1.0)
    micro = np.minimum((uv * 4).astype(int), 4 * frame.cells - 1)
    highest = np.full(kept.height.shape, -np.inf)
    np.maximum.at(highest, (micro[:, 0], micro[:, 1]), heights)
    assert (kept.height == highest).all()
    order = np.argsort(uv[:, 0])
    gathered = gather(Source([points[order[i : i + 100]] for i in range(0, 4000, 100)]), frame.rotation, (7, 6), 1.0, 4)
    assert gathered.points == 4000
    again = frame_over(frame.rotation, gathered.lowest, gathered.highest, (7, 6))
    assert (again.low == frame.low).all() and (again.scale == frame.scale).all()
    places, tops, counts = gathered.over(again, 4)
    assert counts.sum() == 4000
    assert len(tops) >= 0.7 * np.isfinite(highest).sum()
    assert tops.max() == heights.max()
    found = np.abs(places[:, None] - uv[None]).max(axis=2).min(axis=1)
    assert found.max() < 1e-12  # each is one of the points


@pytest.mark.parametrize(("shape", "boundary"), [((7, 9), "open"), ((9, 6), "clamped"), ((4, 4), "open")])
def test_least_squares_agrees_with_a_dense_solver(shape, boundary):
    unknowns = unknowns_of(shape, boundary)
    uv = RNG.random((300, 2)) * (np.array(shape) - 1)
    uv = uv[np.lexsort(uv.astype(int).T[::-1])]
    z, weight = RNG.standard_normal(300), RNG.random(300)
    rows = np.stack([values(unknowns.spread(unit), uv) for unit in np.eye(unknowns.size)], axis=1)
    band = energy(unknowns, 0.1, 0.01)
    plain = dense(band)
    made = Rows.of(uv, unknowns)
    made.add_normal(weight, band)
    right = made.transposed_times(weight * z)
    assert np.abs(dense(band) - plain - rows.T @ (weight[:, None] * rows)).max() < 1e-13
    assert np.abs(right - rows.T @ (weight * z)).max() < 1e-13
    expected = np.linalg.solve(dense(band), right)
    assert factorize(band)
    solve(band, right)
    assert np.abs(right - expected).max() < 1e-10
    assert (unknowns.gather(unknowns.spread(right)) == right).all()
    assert np.abs(plain @ np.ones(unknowns.size)).max() < 1e-13  # a constant has no energy
    assert np.linalg.eigvalsh(plain).min() > -1e-12


def test_a_matrix_that_is_not_positive_is_told():
    band = energy(unknowns_of((5, 5), "open"), 1.0, 0.0)
    band[:, -1 - PAD] -= 1.0
    assert not factorize(band)


@pytest.mark.parametrize("boundary", ["open", "clamped"])
@pytest.mark.parametrize("symmetric", [False, True])
def test_the_surface_over_corners_lies_above_the_bilinear_interpolant(boundary, symmetric):
    for holes in (0.0, 0.3, 0.7):
        by_cell = np.where(RNG.random((8, 6)) < holes, -np.inf, RNG.standard_normal((8, 6)))
        c, _, fallbacks = over_corners(corners_of(by_cell), boundary, symmetric)
        uv = RNG.random((20000, 2)) * [8.0, 6.0]
        over = by_cell[uv[:, 0].astype(int), uv[:, 1].astype(int)]
        assert fallbacks == 0
        assert (values(c, uv) - over).min() > -1e-12
        assert np.abs(c).max() < 12.0


def test_the_slack_covers_a_small_number_beside_a_large_one_locally():
    c = np.full((20, 20), 1e-12)
    c[3, 3] = 1e12
    slack = slack_of(c)
    assert slack[3, 3] >= 32 * 2.2e-16 * 1e12 and slack[15, 15] < 1e-25


@pytest.mark.parametrize("direction", np.concatenate([np.eye(3), -np.eye(3), RNG.standard_normal((5, 3))]))
def test_rotations_are_proper_and_their_third_row_is_the_direction(direction):
    unit = direction / np.linalg.norm(direction)
    rotation = rotation_onto(unit)
    assert (rotation[2] == unit).all()
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-15) and np.linalg.det(rotation) > 0.0


def test_passes_add_up_over_chunks_and_give_the_same_bits_on_any_number_of_threads():
    points = RNG.standard_normal((220_000, 3))
    frame, c = laid(points), RNG.standard_normal((9, 8))
    uv, heights = frame.to_domain(points)
    results = []
    for threads in (1, 2):
        seen = no_residuals(frame, 4)
        with threads_for(len(points), threads):
            for chunk in (points[:120_000], points[120_000:120_050], points[120_050:]):
                keep_residuals(seen, chunk, frame, c, 1.0)
        results.append(seen)
    one, two = results
    assert one.points == len(points) and one.total[0] == pytest.approx(heights.sum(), abs=1e-8)
    assert one.mean_value(c) == pytest.approx(values(c, uv).mean(), abs=1e-10)
    residuals = heights - values(c, uv)
    assert one.total[1] == pytest.approx(residuals.sum(), abs=1e-8)
    assert (one.largest.max(), one.smallest.min()) == (residuals.max(), residuals.min())
    for name in ("largest", "smallest", "uv", "height", "count", "occupancy", "weights", "total"):
        assert (getattr(one, name) == getattr(two, name)).all(), name
