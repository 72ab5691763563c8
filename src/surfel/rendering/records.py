"""Records: what is known of each disk of a tile before it is drawn, eight disks at once."""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined
from surfel.rendering.disks import EDGE
from surfel.rendering.eights import LANES, load, pick, root, store
from surfel.rendering.places import touched
from surfel.rendering.placing import PIXEL
from surfel.rendering.projection import turned

AT_COLUMN, AT_ROW, SIZE, DEPTH, NX, NY, NZ, INVERSE, RADIUS, COSINE, BEND = (np.uint64(k) for k in range(11))
"""Rows: where a disk falls in the picture, the size of a pixel there, its depth and normal, one over the square of its
radius, the radius, how squarely it is seen, and its bend where that is felt."""
CUT_X, CUT_Y, CUT_Z, CUT, CUT_OFF = (np.uint64(k) for k in range(11, 16))
"""Rows of disks that a cut passes: its plane, and how far that may be off."""
ROWS = 16

FAR = np.float32(1e30)
"""How far the plane of a cut may be off where nothing is known: smaller disks are drawn beyond their rims."""

BEYOND = np.float32(2.0)
"""Places of a disk that lie so many times that beyond the plane, and twice what the surface bends, are not drawn."""

_EIGHT = np.uint64(LANES)
_ZERO, _ONE, _TWO, _THREE = (np.float32(v) for v in (0.0, 1.0, 2.0, 3.0))


@inlined
def recorded(
    start, first, last, farthest, whole, reach, left, right, top, bottom, entries, disks, box, sums, motions, m, view,
    who, record,
):  # fmt: skip
    """Record those disks of a sheet that may be seen, from a column on; return the column after the last.

    What lies behind ``farthest`` is passed over, and, where places are chosen, what falls on none of them.
    """
    points, normals, radii, bends = disks.points, disks.normals, disks.radii, disks.bends
    slope, middle, cx, cy = view.slope, view.depth, view.cx, view.cy
    a00, a01, a02, a03 = motions[m, 0, 0], motions[m, 0, 1], motions[m, 0, 2], motions[m, 0, 3]
    a10, a11, a12, a13 = motions[m, 1, 0], motions[m, 1, 1], motions[m, 1, 2], motions[m, 1, 3]
    a20, a21, a22, a23 = motions[m, 2, 0], motions[m, 2, 1], motions[m, 2, 2], motions[m, 2, 3]
    wide, k = np.uint64(record.shape[1]), np.uint64(start)
    for entry in range(first, last):
        i = np.uint64(entries[entry])
        if not whole and touched(i, box, reach, left, right, top, bottom, sums)[4] == 0:
            continue
        x, y, z, r = points[0, i], points[1, i], points[2, i], radii[i]
        depth = a20 * x + a21 * y + a22 * z + a23
        who[k], record[AT_COLUMN, k], record[AT_ROW, k], record[SIZE, k] = i, x, y, z
        record[DEPTH, k], record[RADIUS, k] = depth, r
        k += np.uint64(depth - r <= farthest)
    end = k
    for k in range(np.uint64(start), end):
        i = np.uint64(who[k])
        record[NX, k], record[NY, k], record[NZ, k] = normals[0, i], normals[1, i], normals[2, i]
        record[BEND, k] = bends[i]
    for k in range(np.uint64(start), end, _EIGHT):
        x, y, z = load(record, AT_COLUMN * wide + k), load(record, AT_ROW * wide + k), load(record, SIZE * wide + k)
        a, b, c = load(record, NX * wide + k), load(record, NY * wide + k), load(record, NZ * wide + k)
        r, bend = load(record, RADIUS * wide + k), load(record, BEND * wide + k)
        nx, ny, nz = a00 * a + a01 * b + a02 * c, a10 * a + a11 * b + a12 * c, a20 * a + a21 * b + a22 * c
        ex, ey = a00 * x + a01 * y + a02 * z + a03, a10 * x + a11 * y + a12 * z + a13
        pixel = z * _ZERO + view.size
        if slope > _ZERO:
            pixel = (middle + load(record, DEPTH * wide + k)) * slope
        over = _ONE / pixel
        ax, ay = ex * over, ey * over
        tx, ty = ax * slope, ay * slope
        cosine = nx * tx + ny * ty + nz
        cosine = pick(cosine < _ZERO, -cosine, cosine) / root(_ONE + tx * tx + ty * ty)
        felt = pick(cosine < _THREE * bend * r + _TWO * r * slope / pixel, bend, _ZERO)
        store(record, AT_COLUMN * wide + k, cx + ax)
        store(record, AT_ROW * wide + k, cy + ay)
        store(record, SIZE * wide + k, pixel)
        store(record, NX * wide + k, nx)
        store(record, NY * wide + k, ny)
        store(record, NZ * wide + k, nz)
        store(record, INVERSE * wide + k, _ONE / (r * r))
        store(record, COSINE * wide + k, cosine)
        store(record, BEND * wide + k, felt)
    if len(disks.cuts) > 0:
        for k in range(np.uint64(start), end):
            _record_cut(k, np.uint64(who[k]), m, disks.flags, disks.cuts, motions, record)
    return np.int64(end)


@inlined
def _record_cut(k, i, m, flags, cuts, motions, record):
    if flags[i] & EDGE:
        record[CUT_X, k], record[CUT_Y, k], record[CUT_Z, k] = turned(m, cuts[i, 0], cuts[i, 1], cuts[i, 2], motions)
        record[CUT, k] = cuts[i, 3]
        record[CUT_OFF, k] = cuts[i, 4] if record[RADIUS, k] >= PIXEL * record[SIZE, k] else FAR
