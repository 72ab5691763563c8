"""Slow and obvious versions of what the kernels do: oracles, written for reading and not for speed."""

from __future__ import annotations

import itertools
import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, Delaunay, Voronoi

Floats = NDArray[np.float64]


def nearest(points: Floats, k: int) -> tuple[Floats, NDArray[np.int32]]:
    """Return squared distances and rows of the k nearest others of every point, by comparing all with all."""
    square = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    np.fill_diagonal(square, np.inf)
    rows = np.argsort(square, axis=1, kind="stable")[:, :k].astype(np.int32)
    return np.take_along_axis(square, rows.astype(np.int64), axis=1), rows


def plane(points: Floats) -> tuple[Floats, float, Floats]:
    """Return normal, root mean square distance and centroid of the least-squares plane."""
    centre = points.mean(axis=0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    return vectors[:, 0], math.sqrt(max(values[0], 0.0) / len(points)), centre


def frame(normal: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors across a unit vector."""
    helper = np.eye(3)[np.abs(normal).argmin()]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def voronoi_areas(flat: Floats) -> Floats:
    """Return the areas of the Voronoi cells of points in the plane; infinite for those that are open."""
    diagram = Voronoi(flat)
    areas = np.full(len(flat), np.inf)
    for point, region in enumerate(diagram.point_region):
        corners = diagram.regions[region]
        if corners and -1 not in corners:
            areas[point] = ConvexHull(diagram.vertices[corners]).volume
    return areas


def clipped_cell(neighbours: Floats, half: float) -> Floats:
    """Return the corners of the Voronoi cell of the origin within a square of half-side ``half``."""
    normals = np.concatenate([neighbours, [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]])
    limits = np.concatenate([0.5 * (neighbours**2).sum(axis=1), np.full(4, half)])
    corners = []
    for a, b in itertools.combinations(range(len(normals)), 2):
        matrix = normals[[a, b]]
        if abs(np.linalg.det(matrix)) < 1e-14:
            continue
        corner = np.linalg.solve(matrix, limits[[a, b]])
        if (normals @ corner <= limits + 1e-12).all():
            corners.append(corner)
    return np.array(corners)


def covered(flat: Floats, diagram: Delaunay, place: Floats, cap2: float) -> bool:
    """Tell whether a place lies in a Delaunay triangle of a squared circumradius of at most ``cap2``."""
    triangle = int(diagram.find_simplex(place))
    if triangle < 0:
        return False
    a, b, c = flat[diagram.simplices[triangle]]
    centre = np.linalg.solve(2.0 * np.array([b - a, c - a]), [b @ b - a @ a, c @ c - a @ a])
    return bool(((centre - a) ** 2).sum() <= cap2)


def quadric(u: Floats, v: Floats, w: Floats, weights: Floats) -> Floats:
    """Return the coefficients of 1, u, v, uu, uv, vv of the weighted least-squares height over a plane."""
    rows = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    root = np.sqrt(weights)
    return np.asarray(np.linalg.lstsq(rows * root[:, None], w * root, rcond=None)[0])


def triangle_votes(star: NDArray[np.int32], joined: NDArray[np.int32]) -> Counter[tuple[int, int, int]]:
    """Return how many stars have each triangle, as a sorted triple of rows."""
    votes: Counter[tuple[int, int, int]] = Counter()
    for i in range(len(star)):
        ring = [int(j) for j in star[i] if j >= 0]
        for c, j in enumerate(ring):
            if joined[i] >> c & 1:
                a, b, d = sorted((i, j, ring[(c + 1) % len(ring)]))
                votes[a, b, d] += 1
    return votes


def triangle_area(corners: Floats) -> float:
    """Return the area of a triangle in space."""
    return 0.5 * float(np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])))


def triangle_hit(origin: Floats, direction: Floats, corners: Floats) -> float | None:
    """Return where along a line it crosses a triangle, or None."""
    a, b, c = corners
    try:
        t, s, r = np.linalg.solve(np.column_stack([-direction, b - a, c - a]), origin - a)
    except np.linalg.LinAlgError:
        return None
    return float(t) if s >= 0.0 and r >= 0.0 and s + r <= 1.0 else None


def sheet_events(t: list[float], share: list[float], gap: list[float]) -> list[float]:
    """Return the middles of the sheets of one line whose groups stand for at most one sheet each.

    Hits belong together while the step to the next is within both gaps and not both are whole sheets; a group whose
    shares add up to half a sheet or more is one.
    """
    events, group = [], [0]
    for i in range(1, len(t) + 1):
        apart = i == len(t) or t[i] - t[i - 1] > min(gap[i], gap[i - 1]) or (share[i] > 0.99 and share[i - 1] > 0.99)
        if not apart:
            group.append(i)
            continue
        total = sum(share[g] for g in group)
        if total >= 0.5:
            events.append(sum(share[g] * t[g] for g in group) / total)
        group = [i]
    return events


def moments_along(origin: Floats, direction: Floats, pieces: list[tuple[float, float]]) -> Floats:
    """Return length, first and second moments of pieces of a line, by Gauss-Legendre quadrature (exact to degree 9)."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    total = np.zeros(10)
    for a, b in pieces:
        for node, weight in zip(nodes, weights, strict=True):
            x, y, z = origin + direction * (0.5 * (a + b) + 0.5 * (b - a) * node)
            total += 0.5 * (b - a) * weight * np.array([1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z])
    return total


def sphere_hits(origins: Floats, directions: Floats, radius: float = 1.0) -> list[list[float]]:
    """Return where lines enter and leave a sphere round the origin."""
    found = []
    for o, d in zip(origins, directions, strict=True):
        middle, square = -float(o @ d), radius**2 - float(o @ o) + float(o @ d) ** 2
        found.append([middle - math.sqrt(square), middle + math.sqrt(square)] if square > 0.0 else [])
    return found


def dense(band):
    """Return the symmetric matrix of a padded band of its lower half, as the bounds store it."""
    from surfel.bounding.normal import PAD

    size, width = band.shape[0], band.shape[1] - 1 - PAD
    full = np.zeros((size, size))
    for i in range(size):
        for c in range(max(0, width - i), width + 1):
            full[i, i - width + c] = full[i - width + c, i] = band[i, c]
    return full
