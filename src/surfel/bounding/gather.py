"""The first pass over points that come in chunks: their box and their highest points, before the box is known.

A grid of micro-cells is laid over the first chunk. Where a later chunk reaches beyond it, cells are joined two by two
until it fits, so the grid is always finer than the final one needs, and memory does not depend on the number of points.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel, rows, threads_for
from surfel.bounding.evaluate import cell_of
from surfel.bounding.frame import Frame, project
from surfel.bounding.passes import HALVED, LARGEST, no_points, survey
from surfel.bounding.records import micro_cells_of_eight
from surfel.bounding.reference import by_cells
from surfel.bounding.source import Source
from surfel.core.cast import Floats, as_points
from surfel.core.errors import InputError


class Gathered:
    """The highest points on a grid that grows, in rotated coordinates.

    Parameters
    ----------
    rotation : Floats, shape (3, 3)
        Rows u, v and the direction.
    size : tuple of int
        Cells along u and v.
    sign : float
        1 keeps the highest points, -1 the lowest.
    """

    def __init__(self, rotation: Floats, size: tuple[int, int], sign: float) -> None:
        self.rotation = rotation
        self.sign = sign
        self.lowest = np.full(3, np.inf)
        self.highest = np.full(3, -np.inf)
        self.points = 0
        self._low = np.zeros(2)
        self._step = np.zeros(2)
        self._place = np.zeros((*size, 2))
        self._height = np.full(size, -np.inf)
        self._count = np.zeros(size)

    def add(self, chunk: Floats, lowest: Floats, highest: Floats) -> None:
        """Keep the highest points of a chunk whose box is given."""
        first = self.points == 0
        self.lowest, self.highest = np.minimum(self.lowest, lowest), np.maximum(self.highest, highest)
        self.points += len(chunk)
        if first:
            self._begin()
        while not self._fits():
            self._double()
        grid = Frame(self.rotation, self._low, 1.0 / self._step, np.array(self._height.shape)).numbers()
        parts = 2 if len(chunk) >= HALVED else 1  # wherever there are threads or not
        place, count = (np.zeros((parts, *a.shape)) for a in (self._place, self._count))
        height = np.repeat(self._height[None], parts, axis=0)
        with threads_for(len(chunk)):
            _keep(parts, chunk, grid, self.sign, place, height, count)
        for part in range(parts):
            higher = height[part] > self._height
            np.copyto(self._height, height[part], where=higher)
            np.copyto(self._place, place[part], where=higher[..., None])
            self._count += count[part]

    def over(self, frame: Frame, split: int) -> tuple[Floats, Floats, Floats]:
        """Return the highest points of the micro-cells of a frame, sorted by cell: ``uv (k, 2)``, heights, counts."""
        filled = self._height > -np.inf
        place, height, count = self._place[filled], self._height[filled], self._count[filled]
        kept, counts = no_points(frame, split), np.zeros((int(frame.cells[0]) * split, int(frame.cells[1]) * split))
        uv = (place - frame.low) * frame.scale
        _keep_placed(uv, height, count, np.int64(split), kept.uv, kept.height, counts)
        uv, height = by_cells(kept.uv, kept.height, split)
        return uv, height, by_cells(kept.uv, np.where(counts > 0.0, counts, -np.inf), split)[1]

    def _begin(self) -> None:
        size = np.array(self._height.shape)
        width = self.highest[:2] - self.lowest[:2]
        tiny = np.maximum(np.abs(self.lowest[:2]), np.abs(self.highest[:2])) * 1e-12 + 1e-290
        self._step = np.maximum(width, tiny) / (size - 1)
        self._low = self.lowest[:2].copy()

    def _fits(self) -> bool:
        size = np.array(self._height.shape)
        return bool(
            (self.lowest[:2] >= self._low).all() and (self.highest[:2] <= self._low + self._step * (size - 0.5)).all()
        )

    def _double(self) -> None:
        """Join cells two by two; the old grid becomes the half or quarter of the new one where there was need."""
        for axis in range(2):
            size = self._height.shape[axis]
            before = self.lowest[axis] < self._low[axis]
            if not before and self.highest[axis] <= self._low[axis] + self._step[axis] * (size - 0.5):
                continue
            shift = size // 2 if before else 0
            if before:
                self._low[axis] -= self._step[axis] * size
            self._step[axis] *= 2.0
            self._place, self._height, self._count = _joined(self._place, self._height, self._count, axis, shift)


def gather(source: Source, rotation: Floats, shape: tuple[int, int], sign: float, split: int) -> Gathered:
    """Pass over all chunks once and keep their highest points.

    Raises
    ------
    InputError
        If a chunk holds points that are not finite.
    """
    size = 2 * split * (shape[0] - 1), 2 * split * (shape[1] - 1)
    kept = Gathered(rotation, size, sign)
    for chunk in source:
        if len(chunk) == 0:
            continue
        usable, lowest, highest = survey(chunk, rotation)
        if not usable:
            as_points(chunk)
            raise InputError(f"a chunk of points has coordinates beyond {LARGEST:g}; scale them down")
        kept.add(chunk, lowest, highest)
    return kept


def _joined(place: Floats, height: Floats, count: Floats, axis: int, shift: int) -> tuple[Floats, Floats, Floats]:
    place, height, count = (np.moveaxis(array, axis, 0) for array in (place, height, count))
    half = len(height) // 2
    new = slice(shift, shift + half)
    upper = height[1::2] > height[0::2]
    new_place, new_height, new_count = np.zeros(place.shape), np.full(height.shape, -np.inf), np.zeros(count.shape)
    new_height[new] = np.where(upper, height[1::2], height[0::2])
    new_place[new] = np.where(upper[..., None], place[1::2], place[0::2])
    new_count[new] = count[1::2] + count[0::2]
    first, second, third = (np.ascontiguousarray(np.moveaxis(a, 0, axis)) for a in (new_place, new_height, new_count))
    return first, second, third


@rows
def _keep(begin, end, p, f, sign, place, height, count):
    flat, z, cells = p.ravel(), np.empty(8), np.empty(8, np.int32)
    n, m = np.int64(f[13]), np.int64(f[14])
    for part in range(begin, end):
        where, high, many = place[part].ravel(), height[part].ravel(), count[part].ravel()
        last = p.shape[0] * (part + 1) // len(height)
        for first in range(p.shape[0] * part // len(height), last, 8):
            here = min(8, last - first)
            if here == 8:
                micro_cells_of_eight(flat, 3 * first, f, 1.0, cells, z, 0)
            else:
                for i in range(here):
                    q = 3 * (first + i)
                    u, v, z[i] = project(f, flat[q], flat[q + 1], flat[q + 2])
                    cells[i] = np.int32(cell_of(u, n) * m + cell_of(v, m))
            for i in range(here):
                cell = np.int64(cells[i])
                many[cell] += 1.0
                if sign * z[i] > high[cell]:
                    high[cell] = sign * z[i]
                    q = 3 * (first + i)
                    where[2 * cell] = f[0] * flat[q] + f[1] * flat[q + 1] + f[2] * flat[q + 2]
                    where[2 * cell + 1] = f[3] * flat[q] + f[4] * flat[q + 1] + f[5] * flat[q + 2]


@kernel
def _keep_placed(uv, z, count, split, kept_uv, kept_z, counts):
    last_a, last_b = kept_z.shape[0] - 1, kept_z.shape[1] - 1
    for i in range(z.shape[0]):
        a = min(max(np.int64(uv[i, 0] * split), 0), last_a)
        b = min(max(np.int64(uv[i, 1] * split), 0), last_b)
        counts[a, b] += count[i]
        if z[i] > kept_z[a, b]:
            kept_z[a, b] = z[i]
            kept_uv[a, b, 0], kept_uv[a, b, 1] = uv[i, 0], uv[i, 1]
