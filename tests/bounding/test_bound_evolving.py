"""Points that come and go: every surface on the way is safe, and a new fit gains where there is something to gain."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.bounding.memory import Memory

OPTIONS = [
    {},
    {"boundary": "clamped", "side": "below"},
    {"mode": "paper", "direction": (1.0, 2.0, 4.0)},
    {"mode": "tight", "boundary": "clamped", "shape": (9, 14)},
]


def cloud(count, seed, offset=(0.0, 0.0, 0.0)):
    rng = np.random.default_rng(seed)
    x = rng.random((count, 2))
    z = np.sin(5 * x[:, 0]) + 0.3 * x[:, 1] + 0.05 * rng.standard_normal(count)
    return np.column_stack([x, z]) + np.asarray(offset)


def check_safe(spline, points):
    assert spline.verify(points) == (0, 0.0)
    uv, heights = spline.to_domain(points)
    sign = 1.0 if spline.side == "above" else -1.0
    gap = sign * (spline.to_scipy()(uv) - heights)
    assert (gap >= 0.0).all()
    assert spline.report.points == len(points)
    assert spline.report.gap_mean == pytest.approx(gap.mean(), rel=1e-6, abs=1e-9)
    assert gap.max() <= spline.report.gap_max * (1 + 1e-9)
    if spline.boundary == "clamped":
        c = spline.coefficients
        assert (c[0] == c[1]).all() and (c[-1] == c[-2]).all() and (c[:, 0] == c[:, 1]).all()
    return gap.mean()


@pytest.mark.parametrize("options", OPTIONS)
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (5e5, 5e6, 100.0)])
def test_points_come_and_go_safely(options, offset):
    points = cloud(2000, 1, offset)
    far = cloud(30, 2, np.asarray(offset) + [0.6, -0.4, 0.2])
    spline = surfel.bound(points[:1200], **options)
    for step in range(1200, 2000, 200):
        spline = spline.inserted(points[step : step + 200])
        check_safe(spline, points[: step + 200])
    check_safe(spline.refitted(), points)
    grown = spline.inserted(far)
    both = np.concatenate([points, far])
    check_safe(grown, both)
    again = grown.refitted()
    check_safe(again, both)
    back = again.removed(far)
    check_safe(back, points)
    check_safe(back.refitted(), points)
    assert grown.shape > spline.shape


def test_a_lattice_on_the_borders_of_cells_survives_growth():
    x, y = np.meshgrid(np.arange(0.0, 20.0), np.arange(0.0, 20.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel())]) / 3.0 + 1e3
    grown = surfel.bound(points).inserted([[990.0, 1000.0, 1000.0]])
    check_safe(grown, np.concatenate([points, [[990.0, 1000.0, 1000.0]]]))


def test_insertion_raises_no_more_than_it_must():
    points = cloud(3000, 3)
    lid = surfel.bound(points)
    new = np.array([[0.51, 0.47, lid([[0.51, 0.47, 0.0]])[0] + 0.1]])
    raised = lid.inserted(new)
    assert raised(new) == pytest.approx(new[:, 2], abs=1e-9)
    assert (raised.coefficients >= lid.coefficients).all()
    assert ((raised.coefficients - lid.coefficients) > 1e-9).sum() <= 16
    below = np.array([[0.5, 0.5, -9.0]])
    assert (lid.inserted(below).coefficients == lid.coefficients).all()
    assert lid.inserted(np.empty((0, 3))) is lid


def test_a_new_fit_gains_after_a_spike_is_gone():
    points = cloud(4000, 4)
    spike = np.array([[0.5, 0.5, 3.0]])
    lid = surfel.bound(np.concatenate([points, spike]))
    near = (np.abs(points[:, :2] - 0.5) < 1.0 / 76 + 0.02).all(axis=1)
    rest = points[~near]
    fresh = lid.removed(np.concatenate([points[near], spike])).refitted()
    assert check_safe(fresh, rest) < 0.95 * lid.report.gap_mean
    assert fresh.report.gap_mean < 2.0 * surfel.bound(rest).report.gap_mean


def test_fits_in_a_row_do_not_drift_away_from_the_points():
    points = cloud(6000, 8)
    live, rest = np.arange(3000), np.arange(3000, 6000)
    lid = surfel.bound(points).removed(points[rest])
    for _ in range(10):
        lid = lid.inserted(points[rest[:300]]).removed(points[live[:300]]).refitted()
        live, rest = np.concatenate([live[300:], rest[:300]]), np.concatenate([rest[300:], live[:300]])
    assert check_safe(lid, points[live]) < 1.6 * surfel.bound(points[live]).report.gap_mean


def test_the_difference_of_two_times():
    points = cloud(3000, 5)
    before, after = surfel.bound(points), surfel.bound(points + [0.0, 0.0, 0.25], shape=(15, 18))
    apart = before.difference(after)
    assert apart.shape == before.shape
    assert np.nanmedian(apart) == pytest.approx(0.25, abs=0.05)
    assert (np.nan_to_num(before.difference(before)) == 0.0).all()
    assert before.difference(after, points[:7]) == pytest.approx(after(points[:7]) - before(points[:7]), abs=1e-9)
    with pytest.raises(surfel.InputError, match="direction"):
        before.difference(surfel.bound(points, (1, 0, 0)))


def test_bad_changes_are_refused():
    points = cloud(300, 6)
    lid = surfel.bound(points, shape=(6, 6))
    with pytest.raises(surfel.InputError, match="not finite"):
        lid.inserted([[0.0, 0.0, np.nan]])
    with pytest.raises(surfel.InputError, match="fit a new surface"):
        lid.inserted([[1e9, 0.0, 0.0]])
    with pytest.raises(surfel.InputError, match="not among"):
        lid.removed([[5.0, 5.0, 0.0]])
    with pytest.raises(surfel.InputError, match="at least one"):
        lid.removed(points)
    with pytest.raises(surfel.InputError, match="SafeSpline"):
        lid.difference(3)


def test_memory_travels_as_arrays():
    memory = surfel.bound(cloud(200, 7), shape=(5, 6)).memory
    copy = Memory.from_arrays(memory.to_arrays())
    assert (copy.largest == memory.largest).all() and copy.total == memory.total and copy.points == 200
    with pytest.raises(surfel.InputError):
        Memory.from_arrays({"split": 4})
    with pytest.raises(surfel.InputError):
        Memory.from_arrays(memory.to_arrays() | {"count": np.zeros((3, 3), np.int64)})
