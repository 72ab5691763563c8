"""How close the modes come to the linear program, what they promise beside safety, and chunks."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.bounding.evaluate import values


def smooth(n, rng):
    x = rng.random((n, 2))
    return np.column_stack([x, np.sin(6 * x[:, 0]) * np.cos(5 * x[:, 1]) + 0.5 * x[:, 0]])


def balls(n, rng):
    d = rng.standard_normal((n, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    return d + np.array([[0.0, 0.0, 0.0], [1.3, 0.9, -1.1]])[rng.integers(0, 2, n)]


def cliff(n, rng):
    x = rng.random((n, 2))
    return np.column_stack([x, (x @ [0.7, 0.4] > 0.55) + 0.02 * rng.standard_normal(n)])


def rough(n, rng):
    x = rng.random((n, 2))
    z = sum(np.sin(x @ rng.standard_normal(2) * 6 * k + rng.random() * 6) / k for k in (1, 2, 3, 5, 8, 13))
    return np.column_stack([x, z])


CLOUDS = {"smooth": smooth, "balls": balls, "cliff": cliff, "rough": rough}


def least_mean_gap(spline, points):
    """Solve the linear program that is the yardstick: least mean gap, coefficients within ten ranges."""
    from scipy.optimize import linprog

    uv, heights = spline.to_domain(points)
    size = spline.coefficients.shape
    rows = np.stack([values(unit.reshape(size), uv) for unit in np.eye(size[0] * size[1])], axis=1)
    middle, reach = 0.5 * (heights.max() + heights.min()), np.ptp(heights)
    done = linprog(
        rows.mean(axis=0), A_ub=-rows, b_ub=-(heights - middle) / reach, bounds=(-10.0, 10.0), method="highs"
    )
    return done.fun * reach + middle - heights.mean()


@pytest.mark.parametrize("name", CLOUDS)
def test_the_modes_come_as_close_to_the_linear_program_as_promised(name):
    points = CLOUDS[name](3000, np.random.default_rng(5))
    tight = surfel.bound(points, shape=(10, 10), mode="tight")
    fast = surfel.bound(points, shape=(10, 10))
    paper = surfel.bound(points, shape=(10, 10), mode="paper")
    least = least_mean_gap(tight, points)
    assert least * 0.99 <= tight.report.gap_mean <= 1.03 * least
    assert fast.report.gap_mean <= 2.0 * least
    assert paper.report.gap_mean >= fast.report.gap_mean
    assert 0.95 * least <= tight.report.dual_bound <= least * (1.0 + 1e-3)


def test_the_dual_bound_is_below_every_safe_surface():
    points = cliff(2000, np.random.default_rng(6))
    bound = surfel.bound(points, mode="tight", shape=(8, 8)).report.dual_bound
    for mode in ("fast", "paper"):
        assert 0.0 < bound <= surfel.bound(points, mode=mode, shape=(8, 8)).report.gap_mean


def test_open_ends_are_closer_than_clamped_ones_on_smooth_data():
    points = smooth(4000, np.random.default_rng(7))
    gaps = [surfel.bound(points, boundary=boundary).report.gap_mean for boundary in ("open", "clamped")]
    assert gaps[0] < 0.1 * gaps[1]


@pytest.mark.parametrize("mode", ["paper", "fast"])
def test_symmetric_treats_u_and_v_alike(mode):
    points = rough(3000, np.random.default_rng(8))
    exchanged = points[:, [1, 0, 2]]
    one = surfel.bound(points, mode=mode, symmetric=True, shape=(10, 10))
    two = surfel.bound(exchanged, mode=mode, symmetric=True, shape=(10, 10))
    assert np.abs(one.coefficients - two.coefficients.T).max() < 1e-9
    plain = surfel.bound(points, mode=mode, shape=(10, 10))
    assert np.abs(plain.coefficients - one.coefficients).max() > 1e-6
    assert one.verify(points) == (0, 0.0)


def test_below_is_above_upside_down_to_the_last_bit():
    points = rough(2000, np.random.default_rng(9))
    for mode in ("paper", "fast", "tight"):
        above = surfel.bound(points * [1, 1, -1], mode=mode)
        below = surfel.bound(points, mode=mode, side="below")
        assert (below.coefficients == -above.coefficients).all()


def test_along_z_the_height_is_z_and_the_plane_is_kept():
    points = rough(500, np.random.default_rng(10)) + [100.0, -50.0, 3.0]
    lid = surfel.bound(points)
    uv, heights = lid.to_domain(points)
    assert (heights == points[:, 2]).all()
    assert uv.min() >= 0.0 and (uv.max(axis=0) <= [19.0, 19.0]).all() and uv.max() > 19.0 - 1e-9
    assert np.allclose(lid.frame.to_world(uv, heights), points, rtol=0, atol=1e-11)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 0, -2), (1, -2, 0.5)])
def test_any_direction(direction):
    points = np.random.default_rng(12).standard_normal((800, 3))
    lid = surfel.bound(points, direction)
    unit = np.asarray(direction) / np.linalg.norm(direction)
    assert np.allclose(lid.direction, unit)
    assert np.allclose(lid.frame.rotation @ lid.frame.rotation.T, np.eye(3), atol=1e-15)
    assert np.allclose(lid.to_domain(points)[1], points @ unit)
    assert lid.verify(points) == (0, 0.0)


class Chunks:
    """Chunks that begin anew each time, and count how often they were asked for."""

    def __init__(self, points, size):
        self.points_, self.size, self.passes = points, size, 0

    def __iter__(self):
        self.passes += 1
        for start in range(0, len(self.points_), self.size):
            yield self.points_[start : start + self.size]


@pytest.mark.parametrize("mode", ["paper", "fast", "tight"])
def test_chunks_take_two_passes_and_bound_every_point(mode):
    points = rough(6000, np.random.default_rng(13))
    points = points[np.lexsort((points[:, 1], -points[:, 0]))]  # the box grows with every chunk
    chunks = Chunks(points, 500)
    lid = surfel.bound(chunks, mode=mode)
    assert chunks.passes == 2
    assert lid.verify(points) == (0, 0.0) and lid.report.points == 6000
    whole = surfel.bound(points, mode=mode)
    assert (lid.frame.low == whole.frame.low).all() and (lid.frame.scale == whole.frame.scale).all()
    uv, heights = lid.to_domain(points)
    assert lid.report.gap_mean == pytest.approx((lid(uv) - heights).mean(), rel=1e-9)
    assert lid.report.gap_mean < 1.6 * whole.report.gap_mean


def test_chunks_that_change_between_passes_are_refused():
    class Shrinking(Chunks):
        def __iter__(self):
            self.points_ = self.points_[: len(self.points_) - self.passes * 100]
            return super().__iter__()

    with pytest.raises(surfel.InputError, match="changed between two passes"):
        surfel.bound(Shrinking(rough(2000, np.random.default_rng(14)), 300))


def test_progress_is_told():
    told = []
    surfel.bound(np.random.default_rng(0).random((50, 3)), progress=lambda share, what: told.append(share))
    assert told == sorted(told) and told[-1] == 1.0


def test_a_sandwich_never_crosses_in_exact_arithmetic():
    from fractions import Fraction

    matrix = [[Fraction(x, 6) for x in row] for row in ([1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1])]
    rng = np.random.default_rng(15)
    holes = np.concatenate([rng.random((200, 3)), rng.random((200, 3)) + [3.0, 2.0, 0.5]])
    for points in (balls(1500, rng), holes, rng.random((12, 3))):
        for mode in ("paper", "fast", "tight"):
            upper, lower = surfel.sandwich(points, shape=(9, 8), mode=mode)
            assert upper.verify(points) == (0, 0.0) and lower.verify(points) == (0, 0.0)
            assert (upper.side, lower.side) == ("above", "below")
            apart = [
                [Fraction(float(a)) - Fraction(float(b)) for a, b in zip(r, s, strict=True)]
                for r, s in zip(upper.coefficients, lower.coefficients, strict=True)
            ]
            for h in range(8):
                for k in range(7):
                    rows = [
                        [sum(matrix[j][c] * apart[h + i][k + c] for c in range(4)) for j in range(4)] for i in range(4)
                    ]
                    net = [sum(matrix[i][c] * rows[c][j] for c in range(4)) for i in range(4) for j in range(4)]
                    assert min(net) >= 0
            uv, heights = upper.to_domain(points)
            assert upper.report.gap_mean == pytest.approx((upper(uv) - heights).mean(), rel=1e-6, abs=1e-12)
            assert lower.report.gap_mean == pytest.approx((heights - lower(uv)).mean(), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("base", [1e13, 1e14, 1e15, 1e16])
@pytest.mark.parametrize("boundary", ["open", "clamped"])
def test_a_sandwich_of_heights_that_differ_by_rounding_is_made(base, boundary):
    """A lift of a few units of rounding was rounded away, four times, and the sandwich was given up."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        points = np.column_stack([rng.random((1000, 2)), base * (1.0 + 2e-15 * (rng.random(1000) < 0.5))])
        upper, lower = surfel.sandwich(points, (1.0, 2.0, 3.0), shape=(15, 11), boundary=boundary)
        assert upper.verify(points) == (0, 0.0) and lower.verify(points) == (0, 0.0)
