"""Clip planes as plain columns, so that every format which keeps attributes keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from surfel.shapes.clips import Clips

AREA = "clip_area"
"""What part of the surface each surfel stands for after it was cut."""

PLACE = ("clip_x", "clip_y", "clip_z")
"""From the centre of each surfel to the middle of what is left of its cell."""

_PLANE = ("clip_nx_{}", "clip_ny_{}", "clip_nz_{}", "clip_d_{}")


def plane_names(number: int) -> tuple[str, ...]:
    """Return the names of the columns of one plane: its normal and its distance from the centre, zero for none."""
    return tuple(name.format(number) for name in _PLANE)


def columns_of(clips: Clips) -> dict[str, NDArray[Any]]:
    """Return clips as columns of one row a surfel: area, place, and as many planes as any surfel has."""
    count = len(clips)
    areas = clips.areas
    columns: dict[str, NDArray[Any]] = {AREA: np.full(count, np.nan) if areas is None else np.asarray(areas)}
    columns |= {name: np.ascontiguousarray(clips.places[:, i]) for i, name in enumerate(PLACE)}
    owner = np.repeat(np.arange(count), clips.counts)
    turn = np.arange(len(clips.planes)) - clips.offsets[owner]
    for number in range(int(clips.counts.max(initial=0))):
        table = np.zeros((count, 4))
        table[owner[turn == number]] = clips.planes[turn == number]
        columns |= {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(plane_names(number))}
    return columns


def clips_from(attributes: Mapping[str, NDArray[Any]]) -> tuple[Clips | None, dict[str, NDArray[Any]]]:
    """Return the clips that columns tell of, and the other attributes; None where columns are missing or no numbers."""
    from surfel.shapes.clips import Clips

    mine = [AREA, *PLACE]
    number = 0
    while all(name in attributes for name in plane_names(number)):
        mine += plane_names(number)
        number += 1
    if not all(_is_column(attributes.get(name)) for name in mine):
        return None, dict(attributes)
    area = np.asarray(attributes[AREA], np.float64)
    place = np.stack([np.asarray(attributes[name], np.float64) for name in PLACE], axis=1)
    planes = np.stack(
        [np.stack([np.asarray(attributes[n], np.float64) for n in plane_names(k)], axis=1) for k in range(number)]
        or [np.zeros((len(area), 4))],
        axis=1,
    )
    length = np.sqrt(np.einsum("nki,nki->nk", planes[:, :, :3], planes[:, :, :3]))
    there = np.isfinite(planes).all(axis=2) & (length > 0.0)
    chosen = planes[there] / length[there][:, None]
    offsets = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    known = np.isfinite(area).all() and (area >= 0.0).all()
    clips = Clips(offsets, chosen, np.where(np.isfinite(place), place, 0.0), area if known else None)
    return clips, {name: values for name, values in attributes.items() if name not in mine}


def _is_column(values: NDArray[Any] | None) -> bool:
    return values is not None and values.ndim == 1 and values.dtype.kind in "fiu"
