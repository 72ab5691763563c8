"""The curve in which surfaces meet: seeds from the cut surfels, brought onto both surfaces, linked to polylines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.linking import linked
from surfel.booleans.seam import Seam
from surfel.booleans.surfaces import Surface
from surfel.core.cast import Floats

STEPS = 4
"""Newton steps onto both surfaces; each is a query of the nearest surfels."""

_CROWDED = 0.3  # points nearer than this to one before, in spacings, are left out
_GAP = 0.8  # and where two follow each other farther apart, one is put between them
_ROUNDS = 3
_KINK = 0.92  # a smaller cosine between the normals of one surface shows a corner of the curve
_MOST = 1.0  # spacings that a point may be moved from where the surfels are cut


class Seeds(NamedTuple):
    """Places near the curve of two leaves: with the normals of the first and of the second surface."""

    points: Floats
    first: Floats
    second: Floats

    def chosen(self, rows: NDArray[np.generic]) -> Seeds:
        """Return some of them."""
        return Seeds(self.points[rows], self.first[rows], self.second[rows])


def traced(seams: dict[int, Seam], surfaces: dict[int, Surface], spacings: dict[int, float]) -> list[Floats]:
    """Return the curve of every pair of leaves as ordered polylines.

    Parameters
    ----------
    seams : dict of int to Seam
        Of each leaf.
    surfaces : dict of int to Surface
        Of each leaf.
    spacings : dict of int to float
        Of each leaf's surfels.
    """
    pairs: dict[tuple[int, int], list[Seeds]] = {}
    for leaf, seam in seams.items():
        points, normals, towards, owners = seam.middles()
        for other in np.unique(owners).tolist():
            rows = owners == other
            found = Seeds(points[rows], normals[rows], towards[rows])
            if other < leaf:
                found = Seeds(found.points, found.second, found.first)
            pairs.setdefault((min(leaf, other), max(leaf, other)), []).append(found)
    curves: list[Floats] = []
    for (a, b), parts in sorted(pairs.items()):
        seeds = Seeds(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        spacing = min(spacings[a], spacings[b])
        coarse = max(spacings[a], spacings[b])
        on = _sifted(brought_onto(seeds, surfaces[a], surfaces[b], _MOST * coarse), _CROWDED * spacing)
        for line, closed in linked(on.points, _along(on), coarse):
            curves.append(_completed(on.chosen(line), closed, surfaces[a], surfaces[b], spacing))
    return curves


def brought_onto(seeds: Seeds, one: Surface, other: Surface, most: float) -> Seeds:
    """Bring places onto both surfaces by Newton's method, and leave out what strays.

    Each step is the shortest that ends on both tangent planes.
    """
    points, first, second = seeds
    for _ in range(STEPS):
        height_a, first = one.over(points, first)
        height_b, second = other.over(points, second)
        cosine = np.einsum("ij,ij->i", first, second)
        square = np.maximum(1.0 - cosine * cosine, 0.02)
        u = -(height_a - cosine * height_b) / square
        v = -(height_b - cosine * height_a) / square
        points = points + u[:, None] * first + v[:, None] * second
    far = np.linalg.norm(points - seeds.points, axis=1)
    return Seeds(points, first, second).chosen((far <= most) & np.isfinite(points).all(axis=1))


def _along(on: Seeds) -> Floats:
    """Return the direction of the curve, the same way round all along it."""
    along = np.cross(on.first, on.second)
    return np.asarray(along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300))


def _sifted(on: Seeds, least: float) -> Seeds:
    """Leave out points that crowd one before."""
    from scipy.spatial import cKDTree

    if len(on.points) < 2:
        return on
    stays = np.ones(len(on.points), bool)
    for a, b in sorted(cKDTree(on.points).query_pairs(least)):
        if stays[a] and stays[b]:
            stays[b] = False
    return on.chosen(stays)


def _completed(on: Seeds, closed: bool, one: Surface, other: Surface, spacing: float) -> Floats:
    """Put points into gaps and into corners, and close the line."""
    if closed:
        on = on.chosen(np.append(np.arange(len(on.points)), 0))
    for _ in range(_ROUNDS):
        step = np.linalg.norm(np.diff(on.points, axis=0), axis=1)
        gaps = np.flatnonzero(step > _GAP * spacing)
        if not len(gaps):
            break
        start, end = on.chosen(gaps), on.chosen(gaps + 1)
        middle = Seeds(*(0.5 * (a + b) for a, b in zip(start, end, strict=True)))
        unit = Seeds(middle.points, _unit(middle.first), _unit(middle.second))
        keep, found = _brought(unit, one, other, 0.5 * step[gaps])
        on = Seeds(*(np.insert(a, gaps[keep] + 1, b, axis=0) for a, b in zip(on, found, strict=True)))
    return _with_corners(on).points


def _brought(seeds: Seeds, one: Surface, other: Surface, most: Floats) -> tuple[NDArray[np.bool_], Seeds]:
    """Bring places onto both surfaces; return which of them stay near, and these."""
    found = brought_onto(seeds, one, other, np.inf)
    if len(found.points) < len(seeds.points):  # some ran away altogether
        return np.zeros(len(seeds.points), bool), seeds.chosen(np.zeros(len(seeds.points), bool))
    keep = np.linalg.norm(found.points - seeds.points, axis=1) <= most
    return keep, found.chosen(keep)


def _with_corners(on: Seeds) -> Seeds:
    """Put a point where the curve passes a sharp edge of one of the surfaces: where three planes meet."""
    places, rows, firsts, seconds = [], [], [], []
    for smooth, sharp in ((on.first, on.second), (on.second, on.first)):
        cosine = np.einsum("ij,ij->i", sharp[:-1], sharp[1:])
        for i in np.flatnonzero(cosine < _KINK):
            normals = np.stack([_unit(smooth[i : i + 1] + smooth[i + 1 : i + 2])[0], sharp[i], sharp[i + 1]])
            middle = 0.5 * (on.points[i] + on.points[i + 1])
            offsets = [normals[0] @ middle, sharp[i] @ on.points[i], sharp[i + 1] @ on.points[i + 1]]
            if abs(np.linalg.det(normals)) < 0.05:
                continue
            corner = np.linalg.solve(normals, offsets)
            if np.linalg.norm(corner - middle) <= 1.5 * np.linalg.norm(on.points[i + 1] - on.points[i]):
                places.append(corner)
                rows.append(i + 1)
                firsts.append(on.first[i])
                seconds.append(on.second[i])
    if not rows:
        return on
    return Seeds(*(np.insert(a, rows, b, axis=0) for a, b in zip(on, (places, firsts, seconds), strict=True)))


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))
