"""Morton order of lines: lines that follow each other cross the same parts of an index."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import inlined, rows, threads_for
from surfel._vec import tangent_frame
from surfel.core.box import corners
from surfel.core.cast import Floats, as_points, as_positive, as_rows, as_vector
from surfel.core.errors import InputError
from surfel.index.radix import index_bits, sort_packed


def morton_order_lines(
    origins: ArrayLike, directions: ArrayLike, center: ArrayLike | None = None, radius: float | None = None
) -> NDArray[np.int32]:
    """Return the permutation that sorts lines by direction and offset at once.

    A line has four coordinates: its direction, up to sign, by the octahedral map of a half-sphere to a square, and
    where it meets the plane through ``center`` across it. They are rounded to up to 12 bits each, by the number of
    lines, and interleaved.

    Parameters
    ----------
    origins : array_like, shape (m, 3)
        A point on each line.
    directions : array_like, shape (m, 3)
        Unit vectors; opposite ones make the same line.
    center : array_like, shape (3,), optional
        The middle of what the lines cross; by default that of the box of the origins.
    radius : float, optional
        How far from the center lines matter; those beyond share the outermost cells. By default half the box of the
        origins.

    Returns
    -------
    NDArray[np.int32], shape (m,)
        ``origins[order], directions[order]`` are sorted; lines of the same cell keep their order.

    Raises
    ------
    InputError
        If a shape does not fit, a coordinate is not finite or the radius is not positive.

    Examples
    --------
    >>> from surfel.index.morton import morton_order_lines
    >>> morton_order_lines([[0, 0, 0], [5, 0, 0], [0.1, 0, 0]], [[0, 0, 1], [0, 0, 1], [0, 0, -1]]).tolist()
    [0, 2, 1]
    """
    start = as_points(origins, "origins")
    along = as_rows(directions, "directions", len(start))
    if not np.isfinite(along).all():
        raise InputError("directions must be finite")
    if len(start) >= 2**31:
        raise InputError(f"lines must be fewer than 2**31; got {len(start)}")
    if not len(start):
        return np.empty(0, np.int32)
    if center is None or radius is None:
        low, high = corners(start)
    middle = low * 0.5 + high * 0.5 if center is None else as_vector(center, "center")
    reach = float((high * 0.5 - low * 0.5).max()) * math.sqrt(3.0) if radius is None else as_positive(radius, "radius")
    return order_lines(start, along, middle, max(reach, np.finfo(np.float64).tiny))


def order_lines(origins: Floats, directions: Floats, center: Floats, radius: float) -> NDArray[np.int32]:
    """Do what :func:`morton_order_lines` does, for arguments that are known to be right."""
    shift = index_bits(len(origins))
    bits = min(
        12, (shift + 7) // 4, (63 - shift) // 4
    )  # a cell or two a line: finer ones cost passes and change little
    packed = np.empty(len(origins), np.int64)
    with threads_for(len(origins)):
        _key_lines(len(origins), origins, directions, center, radius, bits, shift, packed)
    return (sort_packed(packed, shift, 4 * bits) & ((1 << shift) - 1)).astype(np.int32)


@rows
def _key_lines(first, last, origins, directions, center, radius, bits, shift, packed):
    for i in range(first, last):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        if z < 0.0 or (z == 0.0 and (y < 0.0 or (y == 0.0 and x < 0.0))):
            x, y, z = -x, -y, -z
        scale = abs(x) + abs(y) + z
        scale = 1.0 / scale if scale > 0.0 else 0.0
        # the octahedral map sends the upper half-sphere to |a| + |b| <= 1: turned by 45 degrees, the square [-1, 1]^2
        a, b = (x + y) * scale, (x - y) * scale
        ux, uy, uz, vx, vy, vz = tangent_frame(x, y, z)
        px = (origins[i, 0] - center[0]) / radius
        py = (origins[i, 1] - center[1]) / radius
        pz = (origins[i, 2] - center[2]) / radius
        u = px * ux + py * uy + pz * uz
        v = px * vx + py * vy + pz * vz
        key = _spread4(_cell(a, bits)) | _spread4(_cell(b, bits)) << 1
        key |= _spread4(_cell(u, bits)) << 2 | _spread4(_cell(v, bits)) << 3
        packed[i] = (key << shift) | i


@inlined
def _cell(x, bits):
    """Return which of 2^bits cells of [-1, 1] holds x; what lies outside belongs to the outermost."""
    cells = 1 << bits
    inside = min(max(x, -1.0), 1.0) * 0.5 + 0.5
    return min(int(inside * cells), cells - 1)


@inlined
def _spread4(x):
    """Put three zeros between the 16 low bits of x."""
    x &= 0xFFFF
    x = (x | (x << 24)) & 0x000000FF000000FF
    x = (x | (x << 12)) & 0x000F000F000F000F
    x = (x | (x << 6)) & 0x0303030303030303
    return (x | (x << 3)) & 0x1111111111111111
