"""Which steps whole numbers are to be of, so that coordinates come back from a file of whole numbers."""

from __future__ import annotations

import numpy as np

from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.io.content import Frame

_MOST = 2**31 - 1
_SAMPLE = 2000
_RUN = 1 << 18


def lattice_of(points: Floats, frame: Frame | None) -> tuple[Floats, Floats]:
    """Return scale and offset for these points: those of their file if they lie on its lattice, else decimal ones.

    Decimal scales are tried from coarse to fine; the first on which every point lies is taken, and where there is none
    (noise, single precision) the finest that 32 bits can hold.

    Parameters
    ----------
    points : ndarray of float64, shape (n, 3)
        Finite coordinates.
    frame : Frame or None
        How the coordinates were stored before.
    """
    if len(points) == 0:
        return _of(frame) or (np.full(3, 0.001), np.zeros(3))
    box = corners(points)
    given = _of(frame)
    if given is not None and _holds(box, *given) and _lie_on(points, *given):
        return given
    finest, offset = lattice_within(box)
    scale = np.empty(3)
    sample = points[:: max(1, len(points) // _SAMPLE)]
    for axis in range(3):
        scale[axis] = _coarsest(points[:, axis], sample[:, axis], float(finest[axis]), float(offset[axis]))
    return scale, offset


def lattice_within(box: Floats, frame: Frame | None = None) -> tuple[Floats, Floats]:
    """Return scale and offset for points within a box: the given ones if they hold it, else the finest decimals."""
    given = _of(frame)
    if given is not None and _holds(box, *given):
        return given
    half = box[1] / 2.0 - box[0] / 2.0  # halves first, because the difference may overflow
    unit = np.where(half > 0.0, 10.0 ** np.floor(np.log10(np.maximum(half, 1e-290))), 1.0)
    with np.errstate(over="ignore"):
        middle = np.round((box[0] / 2.0 + box[1] / 2.0) / unit) * unit
    near = np.abs(box).max(axis=0) <= 10.0 * half
    offset = np.where(near | ~np.isfinite(middle), 0.0, middle)
    reach = np.maximum(np.abs(box - offset).max(axis=0), 1e-280)
    digits = np.log10(np.maximum(np.abs(offset), 1e-280)) - 17.0  # beyond them doubles have none
    exponent = np.ceil(np.maximum(np.log10(reach / _MOST), digits))
    return np.array([float(f"1e{int(e)}") for e in exponent]), offset


def lies_on(points: Floats, scale: Floats, offset: Floats) -> bool:
    """Tell whether coordinates come back from whole numbers as they were, but for the last bits of a double."""
    return _lie_on(points, scale, offset)


def _of(frame: Frame | None) -> tuple[Floats, Floats] | None:
    if frame is None or frame.scale is None:
        return None
    scale = np.array(frame.scale, float)
    offset = np.zeros(3) if frame.offset is None else np.array(frame.offset, float)
    usable = np.isfinite(scale).all() and np.isfinite(offset).all() and (scale != 0.0).all()
    return (scale, offset) if usable else None


def _holds(box: Floats, scale: Floats, offset: Floats) -> bool:
    with np.errstate(over="ignore"):
        return bool((np.abs(np.rint((box - offset) / scale)) <= _MOST).all())


def _lie_on(points: Floats, scale: Floats, offset: Floats) -> bool:
    return all(
        _column_lies_on(points[first : first + _RUN, axis], float(scale[axis]), float(offset[axis]))
        for first in range(0, len(points), _RUN)
        for axis in range(3)
    )


def _column_lies_on(values: Floats, scale: float, offset: float) -> bool:
    back = np.rint((values - offset) / scale) * scale + offset
    few_bits = 8.0 * np.spacing(np.maximum(np.abs(values), abs(offset)))
    return bool((np.abs(back - values) <= np.minimum(few_bits, 1e-3 * abs(scale) + np.spacing(np.abs(values)))).all())


def _coarsest(values: Floats, sample: Floats, finest: float, offset: float) -> float:
    """Return the coarsest of the scales 1, 0.1, ... down to the finest on which all values lie; else the finest."""
    exponent = round(np.log10(finest))
    for e in range(max(0, exponent), exponent - 1, -1):
        scale = float(f"1e{e}")
        if _column_lies_on(sample, scale, offset) and _column_lies_on(values, scale, offset):
            return scale
    return finest
