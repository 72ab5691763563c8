"""Joining: one cloud from what is left of the operands, with all that they know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import frames_of
from surfel.booleans.interpolate import Blend
from surfel.booleans.kept import Born, Kept
from surfel.booleans.part import Part
from surfel.core.cast import Floats, read_only
from surfel.core.together import together
from surfel.shapes.clips import Clips
from surfel.shapes.columns import full_brightness
from surfel.shapes.surfels import Surfels

LEAF = "leaf"
"""The attribute that tells which operand a surfel comes from."""

_HEAVY = 4  # a surfel takes the time of so many of the items that threads are started for


def joined(parts: list[Part], kept: list[Kept], solid: bool | None) -> Surfels:
    """Return the result as one cloud, operand after operand."""
    if not parts:
        return Surfels(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), solid=solid)
    sizes = [_HEAVY * len(left.rows) for left in kept]
    pieces = together(lambda k: _surfels(parts[k], kept[k]), range(len(parts)), sizes)
    points = np.concatenate([piece.points for piece in pieces])
    normals = np.concatenate([piece.normals for piece in pieces])
    radii = np.concatenate([piece.radii for piece in pieces])
    cloud = Surfels._adopted(points, normals, radii, _colors(pieces), _attributes(pieces), {})
    if any(piece.axes is not None for piece in pieces):
        cloud._axes = read_only(np.concatenate([_axes_of(piece) for piece in pieces]))
    cloud._solid = solid
    cloud._clips = _clips(parts, kept)
    return cloud


@dataclass
class _Piece:
    """What one operand gives to the result."""

    points: Floats
    normals: Floats
    radii: Floats
    colors: NDArray[Any] | None
    attributes: dict[str, NDArray[Any]]
    axes: Floats | None


def _surfels(part: Part, left: Kept) -> _Piece:
    cloud = part.cloud
    row = part.order[left.rows]
    piece = _Piece(
        cloud.points.take(row, axis=0),  # of many rows it is faster than an index
        part.normals.take(left.rows, axis=0),
        part.radii[left.rows],
        None if cloud.colors is None else cloud.colors[row],
        {name: value[row] for name, value in cloud.attributes.items()},
        None if cloud.axes is None else cloud.axes[row],
    )
    if left.born is not None and len(left.born.rows):
        _interpolate(piece, part, left, left.born)
    piece.normals[left.turned] *= -1.0
    piece.attributes[LEAF] = np.full(len(row), part.leaf, np.int32)
    return piece


def _interpolate(piece: _Piece, part: Part, left: Kept, born: Born) -> None:
    """Give surfels that were split off places on the surface, and what those round them have."""
    blend = Blend(part, born.centres, left.rows[born.rows])
    piece.points[born.rows], piece.normals[born.rows] = blend.lifted(), blend.normals()
    piece.radii[born.rows] = born.radii
    if piece.colors is not None and part.cloud.colors is not None:
        piece.colors[born.rows] = blend.colors(part.cloud.colors)
    for name, value in blend.attributes(part.cloud.attributes).items():
        piece.attributes[name][born.rows] = value
    if piece.axes is not None:
        piece.axes[born.rows] = _round_axes(piece.normals[born.rows], born.radii)


def _axes_of(piece: _Piece) -> Floats:
    """Return the half axes of ellipses; those of disks are equal."""
    return _round_axes(piece.normals, piece.radii) if piece.axes is None else piece.axes


def _round_axes(normals: Floats, radii: Floats) -> Floats:
    return np.asarray(np.stack(frames_of(normals), axis=1) * radii[:, None, None])


def _clips(parts: list[Part], kept: list[Kept]) -> Clips:
    """Return the clips of the result: those that surfels had, and those of the cut."""
    every = [_clips_of(part, left) for part, left in zip(parts, kept, strict=True)]
    starts = np.cumsum([0, *(len(planes) for _, planes, _ in every)])
    offsets = [np.zeros(1, np.int64), *(start + one[0][1:] for start, one in zip(starts, every, strict=False))]
    return Clips._adopted(
        np.concatenate(offsets),
        np.concatenate([planes for _, planes, _ in every]),
        np.concatenate([places for _, _, places in every]),
        lambda: np.concatenate([_areas_of(part, left) for part, left in zip(parts, kept, strict=True)]),
    )


def _clips_of(part: Part, left: Kept) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return where the planes of each kept surfel of a part start, the planes, and the places."""
    old = part.cloud.clips
    if old is None:
        return left.offsets, left.planes, left.places
    before = old[part.order[left.rows]]
    stays = np.ones(len(left.rows), bool)
    if left.born is not None:  # what was split off needs no planes: it lies on this side of all of them
        stays[left.born.rows] = False
    here = np.repeat(stays, before.counts)
    counts, places = np.where(stays, before.counts, 0), np.where(stays[:, None], before.places, 0.0)
    planes = left.planes.copy()
    which = np.repeat(np.arange(len(stays)), np.diff(left.offsets))
    planes[:, 3] += np.einsum("ij,ij->i", planes[:, :3], places[which])
    owner = np.concatenate([np.repeat(np.arange(len(stays)), counts), which])
    order = np.argsort(owner, kind="stable")
    offsets = np.concatenate([[0], np.cumsum(counts + np.diff(left.offsets))])
    return offsets, np.concatenate([before.planes[here], planes])[order], places + left.places


def _areas_of(part: Part, left: Kept) -> Floats:
    return np.asarray(part.areas[left.rows] * left.shares if len(left.rows) else np.empty(0))


def _attributes(pieces: list[_Piece]) -> dict[str, NDArray[Any]]:
    """Return all attributes; where an operand lacks one, NaN, zero or empty text stands for it."""
    names = dict.fromkeys(name for piece in pieces for name in piece.attributes)
    found: dict[str, NDArray[Any]] = {}
    for name in names:
        known = [piece.attributes[name] for piece in pieces if name in piece.attributes]
        if len({value.shape[1:] for value in known}) > 1 or len({value.dtype.kind in "US" for value in known}) > 1:
            continue  # the operands mean different things by it
        kind = np.result_type(*known)
        filler = np.full((), np.nan, kind) if kind.kind == "f" else np.zeros((), kind)
        shape = known[0].shape[1:]
        found[name] = np.concatenate(
            [
                piece.attributes[name].astype(kind)
                if name in piece.attributes
                else np.full((len(piece.points), *shape), filler)
                for piece in pieces
            ]
        )
    return found


def _colors(pieces: list[_Piece]) -> NDArray[Any] | None:
    """Return all colors on one scale; operands without any are gray."""
    known = [piece.colors for piece in pieces if piece.colors is not None]
    if not known:
        return None
    channels = max(colors.shape[1] for colors in known)
    mixed = len({full_brightness(colors) for colors in known}) > 1 or len({colors.dtype for colors in known}) > 1
    kind = np.dtype(np.float64) if mixed else known[0].dtype
    top = 1.0 if kind.kind == "f" else full_brightness(known[0])
    parts = []
    for piece in pieces:
        part = np.full((len(piece.points), channels), top if kind.kind == "f" else int(top), kind)
        if piece.colors is None:
            part[:, :3] = 0.5 * top if kind.kind == "f" else int(top) // 2
        else:
            part[:, : piece.colors.shape[1]] = piece.colors / full_brightness(piece.colors) if mixed else piece.colors
        parts.append(part)
    return np.concatenate(parts)
