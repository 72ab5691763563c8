"""Large grids without factors, whole-vector sums, and the box of the points."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from naive import dense
from surfel._numba import kernel
from surfel.bounding.candidates import Rows
from surfel.bounding.energy import Tether, bending_times, energy
from surfel.bounding.evaluate import values
from surfel.bounding.frame import rotation_onto
from surfel.bounding.interior import Walk
from surfel.bounding.iterated import Steps, start_coarse, upper_by_steps
from surfel.bounding.normal import unknowns_of
from surfel.bounding.passes import survey
from surfel.bounding.products import Products
from surfel.bounding.reference import least_squares
from surfel.bounding.runs import dot_run

RNG = np.random.default_rng(8)


@kernel
def _dot(x, at, y, start, count):
    return dot_run(x, at, y, start, count)


def test_runs_of_any_length_are_multiplied():
    x, y = RNG.standard_normal((2, 60))
    for count in range(0, 41):
        expected = x[3 : 3 + count] @ y[7 : 7 + count]
        assert _dot(x, np.int64(3), y, np.int64(7), np.int64(count)) == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0), (1, 2, 3)])
def test_the_box_and_what_is_not_finite(direction):
    rotation = rotation_onto(np.asarray(direction) / np.linalg.norm(direction))
    for count in (1, 7, 8, 9, 23, 24, 100, 121):
        points = RNG.standard_normal((count, 3)) * [1.0, 50.0, 3.0]
        turned = points @ rotation.T
        usable, low, high = survey(points, rotation)
        assert usable
        assert np.allclose(low, turned.min(axis=0), rtol=0, atol=1e-13)
        assert np.allclose(high, turned.max(axis=0), rtol=0, atol=1e-13)
        for bad in (np.nan, np.inf, -np.inf, 1e301):
            for row in {0, count // 2, count - 1}:
                spoilt = points.copy()
                spoilt[row, row % 3] = bad
                assert not survey(spoilt, rotation)[0]


@pytest.mark.parametrize("boundary", ["open", "clamped"])
def test_the_products_are_integrals_over_the_domain(boundary):
    unknowns = unknowns_of((6, 8), boundary)
    products = Products.of(unknowns)
    nodes, weight = np.polynomial.legendre.leggauss(4)
    lines = [(np.arange(n)[:, None] + 0.5 * (nodes + 1.0)).ravel() for n in (5, 7)]
    uv = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    area = np.outer(*(np.tile(0.5 * weight, n) for n in (5, 7))).ravel()
    rows = np.stack([values(unknowns.spread(unit), uv) for unit in np.eye(unknowns.size)], axis=1)
    x = RNG.standard_normal(products.shape)
    turned = unknowns.step_u == 1
    times = rows.T @ (area * (rows @ (x.T if turned else x).ravel()))
    found = products.solve(times.reshape(products.shape[::-1]).T if turned else times.reshape(products.shape))
    assert np.abs(found - x).max() < 1e-4  # a trace of a unit matrix keeps it positive


@pytest.mark.parametrize(("shape", "boundary"), [((6, 9), "open"), ((9, 6), "open"), ((7, 5), "clamped")])
def test_the_energy_without_a_matrix_is_that_of_the_matrix(shape, boundary):
    unknowns = unknowns_of(shape, boundary)
    x = RNG.standard_normal(unknowns.size)
    full = dense(energy(unknowns, 0.3, 0.0))
    assert np.abs(bending_times(unknowns, x, 0.3) - full @ x).max() < 1e-10
    pull = RNG.standard_normal(unknowns.size)
    tether = Tether(unknowns, 0.3, 0.5, pull)
    assert np.abs(dense(tether.matrix()) - full - 0.5 * np.eye(unknowns.size)).max() < 1e-13
    assert np.abs(tether.force(x) - (pull - 0.5 * x - full @ x)).max() < 1e-10
    loose = tether.loosened(0.1, x)
    assert np.abs(loose.force(x)).max() < 1e-14 and (loose.bending, loose.price) == (0.1 * 0.3, 0.1 * 0.5)


def hilly(uv, size):
    return np.sin(5.0 * uv[:, 0] / size[0]) * np.cos(4.0 * uv[:, 1] / size[1])


@pytest.mark.parametrize("boundary", ["open", "clamped"])
@pytest.mark.parametrize("shape", [(30, 44), (44, 30)])
def test_steps_come_as_close_as_factors(shape, boundary):
    size = np.array(shape) - 1.0
    uv = RNG.random((12 * shape[0] * shape[1], 2)) * size
    cells = np.minimum(uv.astype(int), size.astype(int) - 1)
    uv = uv[np.lexsort((cells[:, 1], cells[:, 0]))]
    z = hilly(uv, size) + 0.02 * RNG.standard_normal(len(uv))
    unknowns = unknowns_of(shape, boundary)
    rows, weight = Rows.of(uv, unknowns), np.full(len(z), 1.0 / len(z))
    exact = values(unknowns.spread(least_squares(rows, z, bending=1e-9)), uv)
    start = start_coarse(uv, z, unknowns, boundary, 1e-9)
    plain = start_coarse(uv, hilly(uv, size), unknowns, boundary, 1e-9)
    assert np.abs(values(unknowns.spread(plain), uv) - hilly(uv, size)).max() < (0.02 if boundary == "open" else 0.2)
    x = Steps.of(uv, z, unknowns, 1e-9).from_(start, weight)
    reached, best = ((v - z) @ (v - z) for v in (rows.times(x), exact))
    assert best <= reached <= 1.05 * best


def test_holes_of_a_large_grid_are_filled_tamely():
    shape = (40, 40)
    uv = RNG.random((20000, 2)) * 39.0
    uv = uv[np.hypot(uv[:, 0] - 15.0, uv[:, 1] - 22.0) > 12.0]
    z = hilly(uv, (39.0, 39.0))
    c = upper_by_steps(uv, z, unknowns_of(shape, "open"), "open", 1e-9, 0.05)
    assert np.abs(c).max() < 3.0
    points = np.column_stack([uv, z])
    lid = surfel.bound(points, shape=shape)
    assert lid.verify(points) == (0, 0.0)
    assert np.abs(lid.coefficients).max() < 10.0 * np.ptp(z)
    assert lid.report.gap_mean < 1e-3


def test_constraints_may_join_and_leave_on_the_way():
    from scipy.optimize import linprog

    unknowns = unknowns_of((5, 5), "open")
    uv = RNG.random((600, 2)) * 4.0
    uv = uv[np.lexsort((uv[:, 1].astype(int), uv[:, 0].astype(int)))]
    z = RNG.uniform(-1.0, 1.0, 600)
    rows = Rows.of(uv, unknowns)
    dense = np.stack([rows.times(unit) for unit in np.eye(unknowns.size)], axis=1)
    cost, level = dense.mean(axis=0), float(z.mean())
    least = linprog(cost, A_ub=-dense, b_ub=-z, bounds=(-30.0, 30.0), method="highs").fun
    tether = Tether(unknowns, 0.0, 1e-9, np.zeros(unknowns.size))
    some = np.arange(600) % 3 > 0
    center = np.full(unknowns.size, 1.0)
    walk = Walk(rows.chosen(some), z[some], cost, level, tether, center, np.full(400, 1 / 400))
    while walk.left() > 0.05:
        assert walk.step()
    walk.drop(0.05)
    assert len(walk.z) < 400
    beyond = z - rows.times(walk.x) > 0.0
    walk.admit(rows.chosen(beyond), z[beyond], walk.x)
    while walk.left() > 1e-3:
        assert walk.step() and walk.steps < 60
    joined = linprog(cost, A_ub=-dense, b_ub=-z, bounds=(-30.0, 30.0), method="highs")
    assert walk.gap <= (least - level) * 1.01
    assert (walk.y @ walk.z - level) <= (joined.fun - level) * 1.01


@pytest.mark.parametrize("seed", range(3))
def test_tight_is_close_where_points_come_in_clumps(seed):
    from scipy.optimize import linprog

    rng = np.random.default_rng(seed)
    place = rng.random((4, 2))[rng.integers(0, 4, 2500)] + 0.05 * rng.standard_normal((2500, 2))
    points = np.column_stack([place, np.sin(5.0 * place[:, 0]) * np.cos(4.0 * place[:, 1])])
    lid = surfel.bound(points, shape=(9, 9), mode="tight")
    assert lid.verify(points) == (0, 0.0)
    uv, heights = lid.to_domain(points)
    unknowns = unknowns_of((9, 9), "open")
    rows = np.stack([values(unknowns.spread(unit), uv) for unit in np.eye(unknowns.size)], axis=1)
    middle, reach = 0.5 * (heights.max() + heights.min()), np.ptp(heights)
    done = linprog(
        rows.mean(axis=0), A_ub=-rows, b_ub=-(heights - middle) / reach, bounds=(-10.0, 10.0), method="highs"
    )
    least = done.fun * reach + middle - heights.mean()
    assert lid.report.gap_mean <= 1.2 * least
    assert lid.report.dual_bound <= least * (1.0 + 1e-3)
