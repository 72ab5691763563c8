"""Splats: a cloud as disks that cover its surface, made once for each cloud and kept while it lives."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.index.neighbours import PointIndex
from surfel.inside.spacings import WIDE
from surfel.rendering.bends import bends_of
from surfel.rendering.cover import covering_radii
from surfel.rendering.creases import crease_planes
from surfel.rendering.rims import rim_planes
from surfel.shapes.judged import outward_normals
from surfel.shapes.surfels import Surfels

NEIGHBOUR = 6
"""A disk reaches to the sixth neighbour, or beyond."""

BESIDE = 16  # neighbours whose cells may bound that of a surfel
AROUND = 10  # neighbours that tell bends and creases
_LARGEST = 8.0  # medians: strays shall not hide what is behind them
_ALL = slice(None)


@dataclass(frozen=True, eq=False)
class Splats:
    """The disks of a cloud, sorted along a curve; of several points at one place there is one disk.

    A cloud that was turned and shifted shares all but ``pose`` with the cloud that it was: all coordinates here are
    those of that one, less the ``origin`` of the index.

    Parameters
    ----------
    index : PointIndex
        Of the points; its rows are the rows of all arrays here.
    rows : NDArray[np.int32], shape (n,)
        Of the cloud, one for each disk.
    normals : Floats, shape (n, 3)
        Unit normals.
    radii : Floats, shape (n,)
        Of the disks; of ellipses the longer semi-axis.
    bends : Floats, shape (n,)
        The larger principal curvature, where it is convex.
    colors : NDArray[np.uint8], shape (n, 3), or None
        As given.
    axes : Floats, shape (n, 6), or None
        Semi-axes of ellipses.
    creased : Booleans, shape (n,)
        Whether the normals of the neighbours spread.
    clips, planes : NDArray[np.int32], shape (n + 1,), and Floats, shape (k, 4)
        Compressed rows of planes ``n . (x - centre) <= d`` that cut the disks, those at creases included.
    pose : Floats, shape (3, 4)
        From the coordinates here to the world.
    """

    index: PointIndex
    rows: NDArray[np.int32]
    normals: Floats
    radii: Floats
    bends: Floats
    colors: NDArray[np.uint8] | None
    axes: Floats | None
    creased: Booleans
    clips: NDArray[np.int32]
    planes: Floats
    pose: Floats

    def __len__(self) -> int:
        return len(self.radii)

    def places(self, rows: NDArray[np.integer[Any]] | slice = _ALL) -> Floats:
        """Return where some surfels lie in the world."""
        return np.asarray(self.index.points[rows] @ self.pose[:, :3].T + self.pose[:, 3])

    def upright(self, rows: NDArray[np.integer[Any]] | slice = _ALL) -> Floats:
        """Return their normals in the world."""
        return np.asarray(self.normals[rows] @ self.pose[:, :3].T)

    def near(self, points: Floats, number: int) -> tuple[Floats, NDArray[np.int32]]:
        """Return the squared distances and the rows of the surfels nearest to places of the world."""
        there = (points - self.pose[:, 3]) @ self.pose[:, :3]
        return self.index.knn_of(there + self.index.origin, min(number, len(self)))


_made: WeakKeyDictionary[Surfels, Splats | None] = WeakKeyDictionary()
_lock = threading.RLock()


def splats_of(cloud: Surfels) -> Splats | None:
    """Return the disks of a cloud; None of one without points."""
    with _lock:
        if cloud not in _made:
            rest, motion = cloud._at_rest
            if rest is cloud:
                _made[cloud] = _splats_of(cloud) if len(cloud) else None
            else:
                same = splats_of(rest)
                _made[cloud] = None if same is None else replace(same, pose=motion[:3] @ _whole(same.pose))
        return _made[cloud]


def _whole(pose: Floats) -> Floats:
    return np.concatenate([pose, [[0.0, 0.0, 0.0, 1.0]]])


def eight_bit(colors: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colors of any type as bytes, without their opacity."""
    rgb = colors[:, :3]
    if rgb.dtype == np.uint8:
        return np.ascontiguousarray(rgb)
    small = rgb.dtype.kind in "iu" and int(rgb.max(initial=0)) <= 255  # many scanners write bytes into 16-bit words
    full = 1.0 / 255.0 if rgb.dtype.kind == "f" else 1.0 if small or rgb.dtype != np.uint16 else 257.0
    scaled = np.nan_to_num(np.asarray(rgb, np.float64)) / full
    return np.clip(np.rint(scaled), 0.0, 255.0).astype(np.uint8)


def _splats_of(cloud: Surfels) -> Splats:
    index = cloud.operand.index if cloud.clips is None else PointIndex(cloud.points)
    order, found = index.order, outward_normals(cloud)
    squares, near = _neighbours(index)
    again = squares[:, :1].ravel() == 0.0
    if again.any() and cloud.clips is None and cloud.axes is None:  # clipped surfels share places by intention
        order, found = one_of_each(cloud.points, np.sort(order[again]), found)
        index = PointIndex(cloud.points[order])
        order = order[index.order]
        squares, near = _neighbours(index)
    normals = found[order]
    normals[~normals.any(axis=1)] = [0.0, 0.0, 1.0]  # any, where none is known
    axes, opened = None, np.zeros(len(order), np.bool_)
    if cloud.axes is None:
        radii, opened = covering_radii(index, normals, near, _radii(cloud, order, squares))
    else:
        axes = cloud.axes[order].reshape(-1, 6)
        radii = np.sqrt(np.maximum((axes[:, :3] ** 2).sum(axis=1), (axes[:, 3:] ** 2).sum(axis=1)))
    creased, own_clips, own_planes = crease_planes(index.points, normals, radii, near, _kept(squares))
    rims = rim_planes(index, normals, radii, near, opened)
    near = np.ascontiguousarray(near[:, :AROUND])
    rounded = creased & (np.diff(own_clips) == 0)
    bends = np.zeros(len(order)) if axes is not None else bends_of(index.points, normals, radii, near, rounded)
    ends = _given_clips(cloud, order) if cloud.clips is not None else rims
    clips, planes = _joined(own_clips, own_planes, *ends)
    colors = None if cloud.colors is None else eight_bit(cloud.colors)[order]
    pose = np.column_stack([np.eye(3), index.origin])
    return Splats(index, order, normals, radii, bends, colors, axes, creased, clips, planes, pose)


def _neighbours(index: PointIndex) -> tuple[Floats, NDArray[np.int32]]:
    """Return the squared distances and the rows of the neighbours that bound the cells; none of a single point."""
    if len(index) == 1:
        return np.empty((1, 0)), np.empty((1, 0), np.int32)
    return index.knn(min(BESIDE, len(index) - 1))


def one_of_each(points: Floats, doubled: NDArray[np.int32], normals: Floats) -> tuple[NDArray[np.int32], Floats]:
    """Return the rows of a cloud that are left when of several points at one place the first is kept, and normals.

    Points that repeat would be their own neighbours, and their disks would reach no farther than themselves.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        The cloud.
    doubled : NDArray[np.int32], shape (m,)
        Rows that may repeat a place, ascending.
    normals : Floats, shape (n, 3)
        Zero where not known. Of those returned the first of a place has the first that is known there.
    """
    x, y, z = points[doubled].T
    order = np.lexsort((z, y, x))  # stable: rows ascend within a place
    places = points[doubled[order]]
    new = np.concatenate([[True], (places[1:] != places[:-1]).any(axis=1)])
    first = doubled[order[new]]
    knowing = doubled[np.lexsort((~normals[doubled].any(axis=1), z, y, x))[new]]
    normals = normals.copy()
    normals[first] = normals[knowing]
    left = np.ones(len(points), np.bool_)
    left[doubled], left[first] = False, True
    return np.flatnonzero(left).astype(np.int32), normals


def _radii(cloud: Surfels, order: NDArray[np.int32], squares: Floats) -> Floats:
    """Return how far disks reach: to the sixth neighbour at least, for those of a surfel's share leave holes."""
    if len(order) == 1:
        reach = np.array([1e-3 * max(1.0, float(np.abs(cloud.points).max()))])
    else:
        squares = squares[:, :NEIGHBOUR]
        reach = _reach(squares) * np.sqrt(squares[:, -1])
        some = reach[reach > 0.0]
        usual = float(np.median(some)) if len(some) else 1e-3 * max(1.0, float(np.abs(cloud.points).max()))
        reach = np.minimum(np.where(reach > 0.0, reach, usual), _LARGEST * usual)
        if (reach > WIDE * usual).any():  # no smaller ones are strays
            lone = np.zeros(len(cloud), np.bool_)
            lone[cloud.operand.order] = cloud.operand.strays
            reach[lone[order]] = usual
    if cloud.radii is None:
        return reach
    given = cloud.radii[order]
    return np.where(np.isfinite(given), np.maximum(given, reach), reach)


def _reach(squares: Floats) -> float:
    """Return how far beyond the sixth neighbour disks reach: points at random leave holes where even ones do not."""
    return float(np.interp(_evenness(squares), [0.4, 0.8], [1.3, 1.0]))


def _kept(squares: Floats) -> float:
    """Return how much of the radius of a disk is kept where a sheet bends, so that no holes are left."""
    return float(np.interp(_evenness(squares[:, :NEIGHBOUR]), [0.4, 0.5], [0.7, 0.0])) if squares.shape[1] else 0.0


def _evenness(squares: Floats) -> float:
    """Return how much nearer the nearest neighbour is than the sixth: 0.4 times as far of points at random."""
    with np.errstate(invalid="ignore", divide="ignore"):
        even = np.sqrt(squares[:, 0] / squares[:, -1])
    return float(np.median(even[np.isfinite(even)])) if np.isfinite(even).any() else 0.0


def _given_clips(cloud: Surfels, order: NDArray[np.int32]) -> tuple[NDArray[np.int64], Floats]:
    """Return the clip planes that a cloud carries from a Boolean operation, in sorted rows."""
    if cloud.clips is None:
        return np.zeros(len(order) + 1, np.int64), np.empty((0, 4))
    sorted_ones = cloud.clips[order]
    return sorted_ones.offsets, sorted_ones.planes


def _joined(
    a_offsets: NDArray[np.int64], a: Floats, b_offsets: NDArray[np.int64], b: Floats
) -> tuple[NDArray[np.int32], Floats]:
    """Join two sets of compressed rows, row by row."""
    rows = np.concatenate([np.repeat(np.arange(len(o) - 1), np.diff(o)) for o in (a_offsets, b_offsets)])
    order = np.argsort(rows, kind="stable")
    return (a_offsets + b_offsets).astype(np.int32), np.concatenate([a, b])[order]
