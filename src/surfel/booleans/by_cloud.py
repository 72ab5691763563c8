"""Where the surface of a cloud cuts surfels: the sheets near each, met with its tangent plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from surfel._numba import rows, threads_for
from surfel._vec import dot, tangent_frame
from surfel.booleans.beside import Nearest, nearest_to
from surfel.booleans.model import MOST, Model
from surfel.booleans.sides import IN, OPPOSED, OUT, SAME
from surfel.core.cast import Floats
from surfel.inside.coincidence import ALIGNED, DISTANCE, lies_along
from surfel.inside.operand import Operand
from surfel.inside.sheets import side_of_sheets

_SLACK = (1.5, 1.2, 1.0)
"""So often is the cut looked for, each time from where it was found; what is farther off, in reaches, is let go."""

VOID = 1.5
"""No place of a surface is farther than this from the nearest surfel, in spacings; so what is farther is not cut."""

_FLAT = 1e-3  # square of the sine below which a sheet and a tangent plane do not meet near by
_BENT = 0.8  # least cosine with the tangent plane of a sheet that goes on from a coincident one
_IN, _OUT, _SAME, _OPPOSED = np.int64(IN), np.int64(OUT), np.int64(SAME), np.int64(OPPOSED)


def cut_by_cloud(
    operand: Operand,
    points: Floats,
    normals: Floats,
    reach: Floats,
    chosen: NDArray[np.int64],
    sides: NDArray[np.uint8],
    around: Nearest,
) -> Model:
    """Return where the surface of a cloud cuts some surfels.

    From the place where the last step found the cut, the nearest surfels of the cloud are taken as one curved sheet or
    two (:mod:`surfel.inside.sheets`). Where a sheet meets the tangent plane is a line. Of two sheets the inside is
    below both where they meet in a convex edge, else below either. A sheet that lies in the tangent plane is no line:
    there the surfel is on the surface.

    Parameters
    ----------
    operand : Operand
        The cloud; its normals point outward.
    points, normals : Floats, shape (n, 3)
        Surfels, in the coordinates of the cloud.
    reach : Floats, shape (n,)
        How far from its centre each may be cut.
    chosen : NDArray[np.int64], shape (m,)
        Which of them may be cut at all, ascending: none farther from the cloud than its reach and :data:`VOID`.
    sides : NDArray[np.uint8], shape (n,)
        Those of their centres. Where one is on the surface, the sheet that lies as the surfel does is that surface.
    around : Floats, NDArray[np.int32], shape (m, k)
        What :func:`surfel.booleans.beside.nearest_to` says of the chosen ones.
    """
    if not len(chosen) or not len(operand):
        return Model.none()
    squares, near = around
    centres = operand.local(points.take(chosen, axis=0))
    upright, far = normals.take(chosen, axis=0), reach[chosen]
    places = centres.copy()
    here = sides[chosen].astype(np.int64)
    met = np.empty(0, np.int64)
    for step, slack in enumerate(_SLACK):
        m = len(chosen)
        lines, count, table = np.zeros((m, MOST, 3)), np.zeros(m, np.int64), np.zeros((m, 1 << MOST), np.uint8)
        if step:
            squares, near = nearest_to(operand, places)
        with threads_for(16 * m):
            _meet(
                m, operand.points, operand.normals, operand.spacings, squares, near, centres, upright, far, here, slack,
                places, lines, count, table,
            )  # fmt: skip
        met = np.flatnonzero(count > 0)
        chosen, here = chosen[met], here[met]
        centres, upright, places = (each.take(met, axis=0) for each in (centres, upright, places))
        far = far[met]
    return Model(chosen, lines[met], count[met], table[met])


@rows
def _meet(
    first, last, points, normals, spacings, squares, near, centres, upright, far, whole, slack, places,
    lines, count, table,
):  # fmt: skip
    sums, weights = np.empty((2, 8)), np.empty(near.shape[1])
    height, steep, slope, state = np.empty(2), np.empty(2), np.empty((2, 3)), np.empty(2, np.int64)
    for i in range(first, last):
        nx, ny, nz = upright[i, 0], upright[i, 1], upright[i, 2]
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        px, py, pz = places[i, 0], places[i, 1], places[i, 2]
        h = spacings[near[i, 0]]
        value, _ = side_of_sheets(points, normals, px, py, pz, squares, near, i, sums, weights)
        clusters = 2 if sums[1, 6] > 0.0 else 1
        u0, v0 = (
            dot(px - centres[i, 0], py - centres[i, 1], pz - centres[i, 2], ex, ey, ez),
            dot(px - centres[i, 0], py - centres[i, 1], pz - centres[i, 2], fx, fy, fz),
        )
        deciding = -1
        coincident = -1
        for c in range(clusters):
            mx, my, mz = sums[c, 0], sums[c, 1], sums[c, 2]
            mean = sums[c, 7] / sums[c, 6]
            height[c] = 0.5 * (mean - dot(mx, my, mz, sums[c, 3], sums[c, 4], sums[c, 5]))
            if deciding < 0 or abs(height[c] - value) < abs(height[deciding] - value):
                deciding = c
            a, b, along = dot(mx, my, mz, ex, ey, ez), dot(mx, my, mz, fx, fy, fz), dot(mx, my, mz, nx, ny, nz)
            square = a * a + b * b
            slope[c, 0], slope[c, 1], slope[c, 2], steep[c] = a, b, along, math.sqrt(square)
            same_way = along if whole[i] == _SAME else -along
            if whole[i] in (_SAME, _OPPOSED) and same_way > _BENT:
                state[c] = whole[i]
                coincident = c
            elif (
                abs(along) > ALIGNED
                and abs(height[c]) < DISTANCE * h
                and lies_along(normals, near[i], mx, my, mz, abs(along))
            ):
                state[c] = _SAME if along > 0.0 else _OPPOSED
                coincident = c
            elif square < _FLAT:
                state[c] = _IN if height[c] < 0.0 else _OUT
            else:
                state[c] = -1
        found = 0
        for c in range(clusters):
            if state[c] >= 0:
                continue
            if coincident >= 0 and slope[c, 2] * (1.0 if state[coincident] == _SAME else -1.0) > _BENT:
                state[c] = state[coincident]  # the surface bends, and the surfel's own with it
                continue
            inverse = 1.0 / steep[c]
            lines[i, found, 0], lines[i, found, 1] = slope[c, 0] * inverse, slope[c, 1] * inverse
            lines[i, found, 2] = (slope[c, 0] * u0 + slope[c, 1] * v0 - height[c]) * inverse
            found += 1
        convex = 0.0
        if clusters == 2:
            for t in range(3):
                convex += (sums[1, t] - sums[0, t]) * (sums[1, 3 + t] - sums[0, 3 + t])
        for cell in range(1 << found):
            bit, total = 0, -1
            for c in range(clusters):
                if state[c] >= 0:
                    here = state[c]
                else:
                    here = _OUT if (cell >> bit) & 1 else _IN
                    bit += 1
                if total < 0:
                    total = here
                elif convex > 0.0:
                    total &= here
                else:
                    total |= here
            table[i, cell] = total
        count[i] = found
        # the next place is where the line of the deciding sheet comes nearest to the centre
        line = -1
        if found == 1:
            line = 0
        elif found == 2:
            line = deciding
        if line >= 0:
            d = min(max(lines[i, line, 2], -far[i]), far[i])
            u, v = d * lines[i, line, 0], d * lines[i, line, 1]
            places[i, 0] = centres[i, 0] + u * ex + v * fx
            places[i, 1] = centres[i, 1] + u * ey + v * fy
            places[i, 2] = centres[i, 2] + u * ez + v * fz
        nearest = far[i] * 2.0
        for c in range(found):
            nearest = min(nearest, abs(lines[i, c, 2]))
        if nearest > slack * far[i]:
            count[i] = 0
