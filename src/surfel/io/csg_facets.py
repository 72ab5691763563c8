"""The facets that OpenSCAD gives to spheres, cylinders and polyhedra: vertices at the same places."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from surfel.core.cast import Floats, Integers
from surfel.core.errors import InputError
from surfel.shapes.mesh import Mesh

MOST_VERTICES = 4_000_000
_FINE = 2.0**-20  # radii below this have three fragments
_LEAST_STEP = 0.01  # of $fa and $fs
_MOST_CORNERS = 4_000  # of a face that is not convex


def fragments(radius: float, fn: float, fa: float, fs: float) -> int:
    """Return how many edges a circle has: OpenSCAD's rule for ``$fn``, ``$fa`` (degrees) and ``$fs`` (length)."""
    if radius < _FINE:
        return 3
    if fn > 0.0:
        return int(max(fn, 3.0))
    return math.ceil(max(min(360.0 / max(fa, _LEAST_STEP), 2.0 * math.pi * radius / max(fs, _LEAST_STEP)), 5.0))


def faceted_sphere(radius: float, edges: int) -> Mesh:
    """Return OpenSCAD's sphere: rings of ``edges`` vertices, none of them at a pole."""
    rings = (edges + 1) // 2
    _check(rings * edges)
    polar = math.pi * (np.arange(rings) + 0.5) / rings
    rows = [_ring(radius * math.sin(angle), edges, radius * math.cos(angle)) for angle in polar]
    return _stacked(rows, edges)


def faceted_cylinder(bottom: float, top: float, height: float, edges: int) -> Mesh:
    """Return OpenSCAD's cylinder or cone, centred: a prism, a frustum or a pyramid."""
    _check(2 * edges)
    if top == 0.0:
        return _pyramid(_ring(bottom, edges, -0.5 * height), np.array([0.0, 0.0, 0.5 * height]))
    if bottom == 0.0:
        return _pyramid(_ring(top, edges, 0.5 * height)[::-1], np.array([0.0, 0.0, -0.5 * height]))
    return _stacked([_ring(top, edges, 0.5 * height), _ring(bottom, edges, -0.5 * height)], edges)


def polyhedron(points: Floats, faces: list[Integers]) -> Mesh:
    """Return a mesh of polygons that are clockwise seen from outside, as OpenSCAD has them."""
    triangles = [triangle for face in faces for triangle in _triangles(points, face[::-1])]
    return Mesh(points, np.array(triangles, np.int64).reshape(-1, 3))


def _check(vertices: int) -> None:
    if vertices > MOST_VERTICES:
        raise InputError(f"it would have {vertices:,} vertices; read it with facets='exact'")


def _ring(radius: float, edges: int, z: float) -> Floats:
    angle = 2.0 * math.pi * np.arange(edges) / edges
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(edges, z)], axis=1)


def _stacked(rings: list[Floats], edges: int) -> Mesh:
    """Return the solid between rings that are counterclockwise seen from above, the topmost first."""
    i, after = np.arange(edges), (np.arange(edges) + 1) % edges
    parts = [_fan(i)]
    for upper, lower in pairwise(range(0, len(rings) * edges, edges)):
        parts.append(np.stack([upper + i, lower + i, lower + after], axis=1))
        parts.append(np.stack([upper + i, lower + after, upper + after], axis=1))
    parts.append(_fan((len(rings) - 1) * edges + i)[:, ::-1])
    return Mesh(np.concatenate(rings), np.concatenate(parts))


def _pyramid(base: Floats, apex: Floats) -> Mesh:
    """Return the pyramid over a ring that is counterclockwise seen from the apex."""
    edges = len(base)
    i = np.arange(edges)
    sides = np.stack([i, (i + 1) % edges, np.full(edges, edges)], axis=1)
    return Mesh(np.vstack([base, apex]), np.concatenate([sides, _fan(i)[:, ::-1]]))


def _fan(corners: Integers) -> Integers:
    return np.stack([np.full(len(corners) - 2, corners[0]), corners[1:-1], corners[2:]], axis=1)


def _triangles(points: Floats, face: Integers) -> list[tuple[int, int, int]]:
    """Cut one polygon into triangles: a fan where it is convex, else ears."""
    corners = [int(corner) for corner in face]
    if len(corners) > 3:
        flat = _seen_along_its_normal(points[face])
        if flat is not None and (_turns(flat) < -1e-12 * np.ptp(flat, axis=0).max() ** 2).any():
            return _ears(flat, corners)
    return [(corners[0], b, c) for b, c in pairwise(corners[1:])]


def _seen_along_its_normal(corners: Floats) -> Floats | None:
    """Return the corners in the plane across the polygon's vector area, counterclockwise; None without an area."""
    local = corners - corners.mean(axis=0)
    normal = np.cross(local, np.roll(local, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(normal))
    if length == 0.0:
        return None
    normal /= length
    first = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    first /= np.linalg.norm(first)
    return np.asarray(local @ np.stack([first, np.cross(normal, first)]).T)


def _turns(flat: Floats) -> Floats:
    """Return at each corner the cross product of the edges before and behind it."""
    into, out = flat - np.roll(flat, 1, axis=0), np.roll(flat, -1, axis=0) - flat
    return np.asarray(into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0])


def _ears(flat: Floats, corners: list[int]) -> list[tuple[int, int, int]]:
    """Cut off one ear after another: a convex corner whose triangle holds no other corner (Meisters, 1975)."""
    if len(corners) > _MOST_CORNERS:
        raise InputError(f"a face that is not convex has {len(corners)} corners; at most {_MOST_CORNERS} are cut")
    left, found = list(range(len(corners))), []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k)), 1)  # a crooked face is cut somehow
        a, b, c = left[ear - 1], left[ear], left[(ear + 1) % len(left)]
        found.append((corners[a], corners[b], corners[c]))
        del left[ear]
    a, b, c = left
    return [*found, (corners[a], corners[b], corners[c])]


def _is_ear(flat: Floats, left: list[int], k: int) -> bool:
    a, b, c = flat[left[k - 1]], flat[left[k]], flat[left[(k + 1) % len(left)]]
    if _side(a, b, c[None, :])[0] <= 0.0:
        return False
    others = flat[[i for j, i in enumerate(left) if j not in (k, (k - 1) % len(left), (k + 1) % len(left))]]
    inside = (_side(a, b, others) >= 0.0) & (_side(b, c, others) >= 0.0) & (_side(c, a, others) >= 0.0)
    return not bool(inside.any())


def _side(a: Floats, b: Floats, points: Floats) -> Floats:
    """Tell on which side of the line from a to b points lie: positive on its left."""
    return np.asarray((b[0] - a[0]) * (points[:, 1] - a[1]) - (b[1] - a[1]) * (points[:, 0] - a[0]))
