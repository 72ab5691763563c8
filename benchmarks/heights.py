"""Clouds over a plane: what safe splines are fitted to in the benchmarks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.shapes import DATA, NoDataError

Points = np.ndarray
CONFIGURATIONS = 10


def smooth(n: int, rng: np.random.Generator) -> Points:
    """Return a wavy surface without noise."""
    x, y = rng.random((2, n))
    return np.column_stack([x, y, np.sin(6.0 * x) * np.cos(5.0 * y) + 0.5 * x])


def balls(n: int, rng: np.random.Generator, step: int = 4) -> Points:
    """Return two moving balls of scattered points, as in sec. 7: one in the other at step 0, apart at step 9."""
    points = rng.normal(size=(n, 3))
    points *= (rng.random(n) ** (1.0 / 3.0) / np.linalg.norm(points, axis=1))[:, None]
    points[: n // 2] += 2.4 * step / (CONFIGURATIONS - 1) * np.array([0.7, 0.5, -0.6])
    return points


def terrain(n: int, rng: np.random.Generator) -> Points:
    """Return a fractal surface: random waves whose amplitude falls with their number to the power of 1.6."""
    size = 512
    k = np.fft.fftfreq(size) * size
    wave = np.hypot(k[:, None], k)
    wave[0, 0] = 1.0
    grid = np.fft.ifft2(np.fft.fft2(rng.normal(size=(size, size))) / wave**1.6).real
    grid /= grid.std()
    place = rng.random((n, 2))
    cell = np.minimum((place * (size - 1)).astype(int), size - 2)
    (a, b), (i, j) = (place * (size - 1) - cell).T, cell.T
    low = grid[i, j] * (1 - a) + grid[i + 1, j] * a
    high = grid[i, j + 1] * (1 - a) + grid[i + 1, j + 1] * a
    return np.column_stack([place, low * (1 - b) + high * b])


def cliff(n: int, rng: np.random.Generator) -> Points:
    """Return a step across the grid, with noise."""
    x, y = rng.random((2, n))
    return np.column_stack([x, y, (0.7 * x + 0.4 * y > 0.55) + 0.02 * rng.normal(size=n)])


def clumps(n: int, rng: np.random.Generator) -> Points:
    """Return five clumps of points with nothing between them."""
    place = rng.random((5, 2))[rng.integers(0, 5, n)] + 0.04 * rng.normal(size=(n, 2))
    return np.column_stack([place, np.sin(5.0 * place[:, 0]) * np.cos(4.0 * place[:, 1])])


RANDOM: dict[str, Callable[[int, np.random.Generator], Points]] = {
    "smooth": smooth, "balls": balls, "terrain": terrain, "cliff": cliff, "clumps": clumps,
}  # fmt: skip


def bunny() -> Points:
    """Return the range scan of the paper, 40,256 points seen along z."""
    return real("range/bun000.ply")


def real(name: str) -> Points:
    """Return the points of a file of the data folder."""
    import surfel

    path = DATA / name
    if not path.exists():
        raise NoDataError(f"no {name} in the data folder (set SURFEL_DATA)")
    found = surfel.read(path, as_="points")
    return np.asarray(found.points)
