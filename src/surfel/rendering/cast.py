"""Lines of sight through whatever is crossed exactly: primitives, meshes, polynomials, splines and trees of these."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.crossings import Crossings
from surfel.core.execute import blocks
from surfel.core.lines import Lines
from surfel.rendering.camera import Camera
from surfel.rendering.splats import eight_bit, splats_of
from surfel.shapes.base import CORNERS, Shape
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels

FARTHEST = 1e30
"""Hits at more than this are not seen: their squares fit no float32, and scenes are far smaller."""

_BLOCK = 1 << 17
_NEAR = 8  # surfels that tell the normal of a cloud
_TILT = 1e-3  # of the lines that tell a normal, against the line of sight


class Sight(NamedTuple):
    """Lines of sight that begin at the depth of the scene's middle, so that t keeps its digits in far cameras."""

    lines: Lines
    ahead: Floats  # (m,): depth that a unit of t gains
    start: Floats  # (m,): t of the near plane

    def __getitem__(self, rows: NDArray[np.int64]) -> Sight:  # type: ignore[override]
        lines = Lines(self.lines.origins[rows], self.lines.directions[rows], self.lines.weights[rows])
        return Sight(lines, self.ahead[rows], self.start[rows])

    @property
    def number(self) -> int:
        """How many there are."""
        return len(self.lines)


class Hits(NamedTuple):
    """What each line of sight meets first; rows that meet nothing have an infinite t and leaf -1."""

    t: Floats
    cosine: Floats
    leaf: NDArray[np.int32]

    @classmethod
    def none(cls, count: int) -> Hits:
        """Return that nothing is met."""
        return cls(np.full(count, np.inf), np.zeros(count), np.full(count, -1, np.int32))


def sight(camera: Camera, size: tuple[int, int], x: Floats, y: Floats, middle: float, near: float) -> Sight:
    """Return lines of sight through places of a picture.

    Parameters
    ----------
    camera, size : Camera, tuple of int
        The picture.
    x, y : Floats, shape (m,)
        Columns and rows.
    middle : float
        Depth at which the lines begin.
    near : float
        Least depth that is seen, relative to ``middle``.
    """
    lines = camera.rays(x, y, size)
    ahead = lines.directions @ camera.frame[2]
    origins = lines.origins + (middle / ahead)[:, None] * lines.directions
    return Sight(Lines(origins, lines.directions, lines.weights), ahead, np.maximum(near / ahead, -FARTHEST))


def first_hits(shape: Shape, sight: Sight) -> Hits:
    """Return the first crossing of each line with a shape, beyond the near plane."""
    found = Hits.none(sight.number)
    for first, last in blocks(sight.number, _BLOCK):
        run = slice(first, last)
        lines = Lines(sight.lines.origins[run], sight.lines.directions[run], sight.lines.weights[run])
        hits = shape._cross(lines)
        line, row = first_rows(hits, sight.start[run])
        found.t[first + line], found.cosine[first + line] = hits.t[row], hits.cosine[row]
        found.leaf[first + line] = hits.leaf[row]
    return found


def first_rows(hits: Crossings, start: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return which lines have a crossing beyond a t, and not too far, and the row of the first."""
    line = hits.lines
    seen = np.flatnonzero((hits.t > start[line]) & (hits.t < FARTHEST))
    new = np.ones(len(seen), np.bool_)
    new[1:] = line[seen[1:]] != line[seen[:-1]]
    rows = seen[new]
    return line[rows], rows


def normals_at(leaf: Shape, points: Floats, directions: Floats) -> Floats:
    """Return the unit normals of a leaf where lines meet it, shape (m, 3), towards where the lines come from.

    Three lines through one point of a surface, of known cosines with its normal, tell that normal: the leaf is crossed
    with the line of sight and with two more, a little tilted.
    """
    cosine = _cosine_here(leaf, points, directions)
    side = _sideways(directions)
    other = np.cross(directions, side)
    parts = []
    for tilt in (side, other):
        turned = directions + _TILT * tilt
        length = np.sqrt(1.0 + _TILT * _TILT)
        found = _cosine_here(leaf, points, turned / length)
        parts.append((length * found - cosine) / _TILT)
    normal = cosine[:, None] * directions + parts[0][:, None] * side + parts[1][:, None] * other
    size = np.linalg.norm(normal, axis=1)
    with np.errstate(invalid="ignore"):
        good = np.abs(size - 1.0) < 0.2
    normal = np.where(good[:, None], normal, -directions) / np.where(good, size, 1.0)[:, None]
    return facing(normal, directions)


def mesh_at(mesh: Mesh, points: Floats, directions: Floats) -> tuple[Floats, Floats | None]:
    """Return the normals of a mesh where lines meet it, and its colors; smooth where the triangles nearly agree."""
    hits = mesh.bvh.cross(points, directions, barycentric=True)
    row, lost = _nearest_row(hits.offsets, hits.t)
    triangle, bary = hits.triangle[row], hits.bary[row]
    corners = mesh.triangles[triangle]
    weights = np.column_stack([1.0 - bary.sum(axis=1), bary])
    flat = mesh.face_normals[triangle]
    at = mesh.vertex_normals[corners]
    smooth = np.einsum("ij,ijk->ik", weights, at)
    size = np.linalg.norm(smooth, axis=1)
    bent = (np.einsum("ijk,ik->ij", at, flat) < 0.8).any(axis=1) | (size < 0.5)
    normal = np.where(bent[:, None], flat, smooth / np.where(size > 0.0, size, 1.0)[:, None])
    normal[lost] = -directions[lost]
    colors = None
    if mesh.colors is not None:
        colors = np.einsum("ij,ijk->ik", weights, eight_bit(mesh.colors)[corners].astype(np.float64))
    return facing(normal, directions), colors


def cloud_at(cloud: Surfels, points: Floats, directions: Floats) -> tuple[Floats, Floats | None, NDArray[np.int32]]:
    """Return the normals of a cloud at places on its surface, its colors, and the row of the nearest surfel."""
    splats = splats_of(cloud)
    assert splats is not None  # a line has met it
    squares, near = splats.near(points, _NEAR)
    lead = near[:, 0]
    weights = np.exp(-3.0 * squares / np.maximum(squares[:, -1:], 1e-300))
    across = np.einsum("ijk,ik->ij", splats.normals[near], splats.normals[lead])
    weights = np.where(np.abs(across) > 0.7, weights, 0.0) * np.sign(across)
    normal = np.einsum("ij,ijk->ik", weights, splats.normals[near]) @ splats.pose[:, :3].T
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    colors = None
    if splats.colors is not None:
        share = np.abs(weights)
        colors = np.einsum("ij,ijk->ik", share, splats.colors[near].astype(np.float64)) / share.sum(axis=1)[:, None]
    return facing(normal, directions), colors, splats.rows[lead]


def facing(normals: Floats, directions: Floats) -> Floats:
    """Turn normals to where lines come from."""
    away = np.einsum("ij,ij->i", normals, directions) > 0.0
    return np.where(away[:, None], -normals, normals)


def window(box: Floats, camera: Camera, size: tuple[int, int]) -> tuple[int, int, int, int] | None:
    """Return the first and the last column and row that a box can fall on; None where it is out of sight."""
    width, height = size
    everything = (0, width - 1, 0, height - 1)
    if not np.isfinite(box).all():
        return None if (box[0] > box[1]).any() else everything
    x, y, depth = camera.project(box[CORNERS, range(3)], size)
    if not camera.orthographic:
        if (depth <= 0.0).all():
            return None
        if (depth <= 1e-6 * camera.distance).any():
            return everything
    low_x, high_x = int(max(np.floor(x.min()) - 1, 0)), int(min(np.ceil(x.max()) + 1, width - 1))
    low_y, high_y = int(max(np.floor(y.min()) - 1, 0)), int(min(np.ceil(y.max()) + 1, height - 1))
    return (low_x, high_x, low_y, high_y) if low_x <= high_x and low_y <= high_y else None


def _sideways(directions: Floats) -> Floats:
    """Return a unit vector across each direction."""
    axis = np.zeros_like(directions)
    axis[np.arange(len(directions)), np.argmin(np.abs(directions), axis=1)] = 1.0
    side = np.cross(directions, axis)
    return np.asarray(side / np.linalg.norm(side, axis=1, keepdims=True))


def _cosine_here(leaf: Shape, points: Floats, directions: Floats) -> Floats:
    """Return the cosine of the crossing nearest to each point, NaN where there is none."""
    hits = leaf._cross(Lines(points, directions, np.ones(len(points))))
    row, lost = _nearest_row(hits.offsets, hits.t)
    cosine = np.full(len(points), np.nan)
    cosine[~lost] = hits.cosine[row[~lost]]
    return cosine


def _nearest_row(offsets: NDArray[np.int64], t: Floats) -> tuple[NDArray[np.int64], Booleans]:
    """Return the row of the hit with the least |t| of each line, and which lines have none."""
    count = len(offsets) - 1
    line = np.repeat(np.arange(count), np.diff(offsets))
    order = np.lexsort((np.abs(t), line))
    lost = np.diff(offsets) == 0
    row = np.zeros(count, np.int64)
    row[~lost] = order[offsets[:-1][~lost]]
    return row, lost
