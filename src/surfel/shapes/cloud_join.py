"""Two clouds as one: what both know."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.shapes.columns import on_one_scale

if TYPE_CHECKING:
    from surfel.shapes.clips import Clips
    from surfel.shapes.surfels import Surfels


def both_of(one: Surfels, other: Surfels) -> Surfels:
    """Concatenate two clouds; see :meth:`Surfels.__add__`."""
    from surfel.shapes.surfels import Surfels

    clips = None if one.clips is None and other.clips is None else _clips(one).joined(_clips(other))
    attributes = {name: _joined(value, other.attributes.get(name)) for name, value in one.attributes.items()}
    return Surfels(
        np.concatenate([one.points, other.points]),
        _joined(one.normals, other.normals),
        _joined(one.radii, other.radii),
        _joined(*on_one_scale(one.colors, other.colors)),
        {name: value for name, value in attributes.items() if value is not None},
        one.solid if one.solid == other.solid else None,
        axes=_joined(one.axes, other.axes),
        clips=clips,
        judge=one.judge if one.judge == other.judge else None,
    )


def _joined(a: NDArray[Any] | None, b: NDArray[Any] | None) -> NDArray[Any] | None:
    """Return the rows of both; None where one lacks them, or means something else by them."""
    if a is None or b is None or a.shape[1:] != b.shape[1:] or (a.dtype.kind in "US") != (b.dtype.kind in "US"):
        return None
    return np.concatenate([a, b])


def _clips(cloud: Surfels) -> Clips:
    """Return the clips of a cloud; of one that was not cut, none for each surfel, and its whole patches."""
    from surfel.shapes.clips import Clips

    if cloud.clips is not None:
        return cloud.clips
    return Clips(np.zeros(len(cloud) + 1, np.int64), np.empty((0, 4)), areas=lambda: cloud.surface.patches.areas)
