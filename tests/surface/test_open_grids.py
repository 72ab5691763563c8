"""Open grids: heights over a raster, the commonest open clouds. Their area ends at the outermost points, or half a cell
beyond; the value is the former, and the interval holds both and little more."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import surfel

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]

HEIGHTS: dict[str, Heights] = {
    "flat": lambda x, y: 0.0 * (x + y),
    "bowl": lambda x, y: 0.4 * ((x - 0.5) ** 2 + (y - 0.5) ** 2),
    "waves": lambda x, y: 0.05 * np.sin(9.0 * x) * np.cos(7.0 * y + 1.0),
}


def area_over(height: Heights, low: tuple[float, float], high: tuple[float, float], n: int = 1500) -> float:
    """Return the area over a rectangle, by the midpoint rule."""
    size = np.subtract(high, low) / n
    x, y = (low[k] + size[k] * (np.arange(n) + 0.5) for k in (0, 1))
    x, y, step = x[:, None], y[None, :], 1e-5
    slope_x = (height(x + step, y) - height(x - step, y)) / (2.0 * step)
    slope_y = (height(x, y + step) - height(x, y - step)) / (2.0 * step)
    return float(np.sqrt(1.0 + slope_x**2 + slope_y**2).sum() * size[0] * size[1])


def raster(height: Heights, columns: int, lines: int) -> np.ndarray:
    """Return points over the unit square, the outermost ones on its border, turned in space."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, lines)))
    return np.column_stack([x, y, height(x, y)])


def turned(points: np.ndarray) -> np.ndarray:
    return points @ np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0].T


def interval(points: np.ndarray) -> tuple[float, float, float]:
    found = surfel.Surfels(points).surface
    local, error = found.known
    square = found.scale**2
    return local.area * square, (local.area - error.half_width) * square, (local.area + error.half_width) * square


@pytest.mark.parametrize("n", [20, 40, 100])
@pytest.mark.parametrize("name", list(HEIGHTS))
def test_the_area_ends_at_the_outermost_points_and_the_interval_half_a_cell_beyond(name, n):
    height, step = HEIGHTS[name], 1.0 / (n - 1)
    inner = area_over(height, (0.0, 0.0), (1.0, 1.0))
    outer = area_over(height, (-0.5 * step, -0.5 * step), (1.0 + 0.5 * step, 1.0 + 0.5 * step))
    value, low, high = interval(turned(raster(height, n, n)))
    assert value == pytest.approx(inner, rel=4e-4)
    assert low < inner < high
    assert high > outer
    assert high - value < 1.15 * (outer - inner)  # it was four times as much


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.25, 0.5])
@pytest.mark.parametrize("upright", [True, False])
@pytest.mark.parametrize("name", list(HEIGHTS))
def test_noise_changes_neither_reading(name, upright, noise):
    n, height = 60, HEIGHTS[name]
    points = raster(height, n, n)
    off = noise / (n - 1) * np.random.default_rng(1).standard_normal(points.shape)
    if upright:
        off[:, :2] = 0.0
    value, low, high = interval(turned(points + off))
    inner = area_over(height, (0.0, 0.0), (1.0, 1.0))
    assert low < inner < high
    assert high - value < 4.5 / n  # half a cell beyond is 2 / n
    if upright or noise < 0.1:
        assert value == pytest.approx(inner, rel=0.7 / n)


@pytest.mark.parametrize("jitter", [0.05, 0.2, 0.5])
def test_a_little_disorder_does_not_move_the_border(jitter):
    n = 60
    points = raster(HEIGHTS["waves"], n, n)
    points[:, :2] += jitter / (n - 1) * (np.random.default_rng(2).random((n * n, 2)) - 0.5)
    points[:, 2] = HEIGHTS["waves"](points[:, 0], points[:, 1])
    inner = area_over(HEIGHTS["waves"], (0.0, 0.0), (1.0, 1.0))
    value, low, high = interval(points)
    assert low < inner < high
    assert high - value < 2.5 / n
    if jitter <= 0.2:
        assert value == pytest.approx(inner, rel=0.3 / n)


@pytest.mark.parametrize("stretch", [2, 4, 8])
@pytest.mark.parametrize("name", ["flat", "waves"])
def test_rows_that_lie_apart_have_normals_and_an_area(name, stretch):
    """Along such rows the nearest neighbours lie on one or two of them, which show no slope across."""
    lines = 40
    points = raster(HEIGHTS[name], stretch * lines, lines)
    inner = area_over(HEIGHTS[name], (0.0, 0.0), (1.0, 1.0))
    value, low, high = interval(turned(points))
    assert value == pytest.approx(inner, rel=2e-3)
    assert low < inner < high


def test_a_hole_and_a_missing_corner_are_left_out():
    n = 60
    points = raster(HEIGHTS["bowl"], n, n)
    x, y = points[:, 0], points[:, 1]
    points = points[((x - 0.5) ** 2 + (y - 0.4) ** 2 > 0.15**2) & (x + y > 0.35)]
    side = (np.arange(2000) + 0.5) / 2000
    x, y = side[:, None], side[None, :]
    slope = np.sqrt(1.0 + 0.64 * ((x - 0.5) ** 2 + (y - 0.5) ** 2))
    there = ((x - 0.5) ** 2 + (y - 0.4) ** 2 > 0.15**2) & (x + y > 0.35)
    truth = float((slope * there).mean())
    value, low, high = interval(points)
    assert value == pytest.approx(truth, rel=0.015)
    assert low < truth < high
    assert high - value < 2.8 / n
