"""The one rule of trees: sort what a line meets, flip one bit an event, and keep what changes the value of the tree.

Events at one place (within rounding) are taken together, and the tree is asked before and after them. That makes
Booleans regularised: a face that two solids share and that parts nothing is no boundary, and equal faces count once,
for the leaf that comes first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel._numba import inner, rows
from surfel.core.cast import Floats
from surfel.index.box_tree import STACK, BoxTree, boxes_on_line, boxes_round_point
from surfel.shapes.convex import ConvexLeaves, convex_cosine, convex_piece
from surfel.shapes.logic import TABLED, Logic, keeps_sheet, set_leaf

BOUNDARY = 0
"""An event of a solid: flips its bit, and is kept where that changes the tree."""
FLIP = 1
"""An event that only flips a bit: where a line passes a sheet of a closed cloud."""
SHARE = 2
"""A weighted hit of a closed cloud: kept where the tree depends on the cloud."""
SHEET = 3
"""A hit of a sheet: kept where the tree keeps the sheet."""

SLOTS = 6
"""Room for kept events, a line on average; where a run of lines has more, the rest of it is swept again."""

_TIE = 64.0 * 2.0**-52
"""Two events are at one place within this share of the tree's size, over the cosines: rounding moves a hit so far."""
_GRAZING = 1e-7


class Solids(NamedTuple):
    """All that a tree is made of, for the kernels."""

    logic: Logic
    convex: ConvexLeaves
    boxes: BoxTree  # round the convex leaves, where each can matter
    size: float  # the largest coordinate that matters


class Others(NamedTuple):
    """Crossings of the leaves that are not convex, by source."""

    offsets: NDArray[np.int64]  # (sources, m + 1): rows of t
    t: Floats
    cosine: Floats
    weight: Floats
    leaf: NDArray[np.int32]  # (sources,)
    mode: NDArray[np.int8]  # (sources,)


@inner
def _sort(count, t, leaf, what):
    """Sort by t in place: Shell's sort, which is insertion sort for the few events that most lines have."""
    gap = 1
    while gap < count // 9:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            key, own, side = t[i], leaf[i], what[i]
            j = i
            while j >= gap and t[j - gap] > key:
                t[j], leaf[j], what[j] = t[j - gap], leaf[j - gap], what[j - gap]
                j -= gap
            t[j], leaf[j], what[j] = key, own, side
        gap //= 3


@inner
def _cosine_of(inverse, form, cosines, k, what, t, ox, oy, oz, dx, dy, dz):
    if what < 0:
        return cosines[-1 - what]
    return convex_cosine(inverse, form, k, what, t, ox, oy, oz, dx, dy, dz)


@inner
def _same_place(inverse, form, cosines, size, a, b, t, leaf, what, ox, oy, oz, dx, dy, dz):
    """Tell whether two events of a line differ by no more than rounding may have moved them along it."""
    gap = t[b] - t[a]
    if gap <= 0.0 or gap != gap:
        return True
    if gap > 2.0 * _TIE / _GRAZING * size:
        return False
    one = _cosine_of(inverse, form, cosines, leaf[a], what[a], t[a], ox, oy, oz, dx, dy, dz)
    other = _cosine_of(inverse, form, cosines, leaf[b], what[b], t[b], ox, oy, oz, dx, dy, dz)
    return gap <= _TIE * size * (1.0 / max(abs(one), _GRAZING) + 1.0 / max(abs(other), _GRAZING))


@inner
def _set_all(wires, node, negated, need, leaves, mask, bit, state, climb, climbing):
    """Set the bits of all leaves as a mask has them."""
    for of in range(leaves):
        on = (mask >> np.uint64(of)) & np.uint64(1) != np.uint64(0)
        if on != bit[of]:
            bit[of] = on
            set_leaf(wires, node, negated, need, leaves, of, on, state, climb, climbing)


@rows
def sweep_lines(
    first, last, solids, others, most, origins, directions, which, starts, counts, out_t, out_cosine, out_weight,
    out_leaf,
):  # fmt: skip
    """Sweep lines ``which[first:last]``, none with more than ``most`` events, and note what is kept.

    ``starts`` tells from which row on. Where it is negative, the events of the run follow each other from row
    ``SLOTS * first`` on, which is written there; it stays negative for lines that find no more room.
    """
    inverse, form, parts, convex_leaf = solids.convex
    boxes, item, always = solids.boxes
    wires, node, negated, need, inputs, start, leaves, table = solids.logic
    offsets, other_t, cosines, weights, other_leaf, modes = others
    size, root, tabled = solids.size, len(need) - 1, leaves <= TABLED
    one, zero, near = np.uint64(1), np.uint64(0), 2.0 * _TIE / _GRAZING * size
    t, leaf, what = np.empty(most), np.empty(most, np.int32), np.empty(most, np.int64)
    stack, found = np.empty(STACK, np.int32), np.empty(len(convex_leaf) + 1, np.int32)
    climb, climbing = np.empty(len(node) + 2, np.int32), np.empty(len(node) + 2, np.bool_)
    bit, state = np.zeros(leaves, np.bool_), start.copy()
    found[: len(always)] = always
    free = SLOTS * first
    for r in range(first, last):
        line = which[r]
        begin = starts[r] if starts[r] >= 0 else free
        room = 1 << 62 if starts[r] >= 0 else SLOTS * last - free
        dx, dy, dz = directions[line, 0], directions[line, 1], directions[line, 2]
        ox, oy, oz = origins[line, 0], origins[line, 1], origins[line, 2]
        n, convexes = 0, len(always)
        if item[0] >= 0:
            convexes = boxes_on_line(boxes, item, always, ox, oy, oz, dx, dy, dz, stack, found)
        # of each event: t, the row of its leaf or source, and the side of a convex leaf or -1 - row of another
        for c in range(convexes):
            k = found[c]
            t0, t1, side0, side1 = convex_piece(inverse, form, parts, k, ox, oy, oz, dx, dy, dz)
            if t0 < t1:
                t[n], leaf[n], what[n] = t0, k, side0
                t[n + 1], leaf[n + 1], what[n + 1] = t1, k, side1
                n += 2
        for source in range(len(offsets)):
            for row in range(offsets[source, line], offsets[source, line + 1]):
                t[n], leaf[n], what[n] = other_t[row], source, -1 - row
                n += 1
        _sort(n, t, leaf, what)
        kept, i, mask, value = 0, 0, zero, False
        while i < n:
            j = i + 1  # the group of events at one place
            while j < n and (
                not t[j] - t[j - 1] > near
                and _same_place(inverse, form, cosines, size, j - 1, j, t, leaf, what, ox, oy, oz, dx, dy, dz)
            ):
                j += 1
            before, owner, own_leaf = value, -1, 0
            for e in range(i, j):
                mode = BOUNDARY if what[e] >= 0 else modes[leaf[e]]
                of = convex_leaf[leaf[e]] if what[e] >= 0 else other_leaf[leaf[e]]
                if mode <= FLIP:
                    if tabled:
                        mask ^= one << np.uint64(of)
                        value = (table >> mask) & one != zero
                    else:
                        bit[of] = not bit[of]
                        set_leaf(wires, node, negated, need, leaves, of, bit[of], state, climb, climbing)
                        value = state[root] >= need[root]
                    if mode == BOUNDARY and (owner < 0 or of < own_leaf):
                        owner, own_leaf = e, of
                    continue
                if tabled and mode == SHEET:  # the nodes were not kept up to date
                    _set_all(wires, node, negated, need, leaves, mask, bit, state, climb, climbing)
                if mode == SHEET:
                    keep, sense = keeps_sheet(wires, node, need, inputs, leaves, of, state, climb), 1.0
                else:
                    own = mask >> np.uint64(of) & one != zero if tabled else bit[of]
                    if tabled:
                        keep = ((table >> (mask ^ one << np.uint64(of))) & one != zero) != value
                    else:
                        set_leaf(wires, node, negated, need, leaves, of, not own, state, climb, climbing)
                        keep = (state[root] >= need[root]) != value
                        set_leaf(wires, node, negated, need, leaves, of, own, state, climb, climbing)
                    sense = 1.0 if value == own else -1.0
                if keep:
                    if kept < room:
                        at, row = begin + kept, -1 - what[e]
                        out_t[at], out_cosine[at] = t[e], sense * cosines[row]
                        out_weight[at], out_leaf[at] = weights[row], of
                    kept += 1
            if owner >= 0 and before != value and abs(t[owner]) < np.inf:
                if kept < room:
                    at = begin + kept
                    side, out_t[at], out_leaf[at] = what[owner], t[owner], own_leaf
                    if side >= 0:
                        cosine, out_weight[at] = (
                            convex_cosine(inverse, form, leaf[owner], side, t[owner], ox, oy, oz, dx, dy, dz), 1.0
                        )  # fmt: skip
                    else:
                        cosine, out_weight[at] = cosines[-1 - side], weights[-1 - side]
                    out_cosine[at] = -abs(cosine) if value else abs(cosine)
                kept += 1
            i = j
        counts[r] = kept
        if starts[r] < 0 and kept <= room:
            starts[r], free = begin, begin + kept
        if tabled:
            continue
        for e in range(n):  # bits of unbounded leaves may be left on
            of = convex_leaf[leaf[e]] if what[e] >= 0 else other_leaf[leaf[e]]
            if bit[of]:
                bit[of] = False
                set_leaf(wires, node, negated, need, leaves, of, False, state, climb, climbing)


@rows
def judge_points(first, last, solids, others, points, normals, own, own_mode, inner_side, outer_side):
    """Ask the tree just below and just above points of a surface, with ``own`` true below and false above.

    A leaf whose own face lies at a point flips between the two, as events at one place of a line do; where such a leaf
    comes before ``own``, the face belongs to it, and both answers are the same. With ``own`` = -1 points are asked that
    lie on no leaf's surface. Only bits at the point matter, so leaves whose box does not hold it are not asked. With a
    sheet as ``own`` the answers are whether it is kept, and no.
    """
    inverse, form, parts, convex_leaf = solids.convex
    boxes, item, always = solids.boxes
    wires, node, negated, need, inputs, start, leaves, table = solids.logic
    offsets, other_t, cosines, _, other_leaf, modes = others
    root, tabled, one, zero = len(need) - 1, leaves <= TABLED, np.uint64(1), np.uint64(0)
    tie = 4.0 * _TIE * solids.size
    stack, found = np.empty(STACK, np.int32), np.empty(len(convex_leaf) + 1, np.int32)
    climb, climbing = np.empty(len(node) + 2, np.int32), np.empty(len(node) + 2, np.bool_)
    state, bit = start.copy(), np.zeros(leaves, np.bool_)
    behind, here = np.zeros(2 * leaves + len(modes), np.int32), np.zeros(2 * leaves + len(modes), np.int32)
    found[: len(always)] = always
    for p in range(first, last):
        ox, oy, oz = points[p, 0], points[p, 1], points[p, 2]
        dx, dy, dz = normals[p, 0], normals[p, 1], normals[p, 2]
        n, faces, convexes = 0, 0, len(always)
        if item[0] >= 0:
            convexes = boxes_round_point(boxes, item, always, ox, oy, oz, stack, found)
        for c in range(convexes):
            k = found[c]
            of = convex_leaf[k]
            if of == own:
                continue
            t0, t1, side0, side1 = convex_piece(inverse, form, parts, k, ox, oy, oz, dx, dy, dz)
            if not (t0 < t1 and t0 <= tie / _GRAZING and t1 >= -tie / _GRAZING):
                continue
            passed = 0
            for end in range(2):
                at, side = (t0, side0) if end == 0 else (t1, side1)
                slack = 0.0
                if abs(at) <= tie / _GRAZING:
                    cosine = convex_cosine(inverse, form, k, side, at, ox, oy, oz, dx, dy, dz)
                    slack = tie / max(abs(cosine), _GRAZING)
                if at < -slack:
                    passed += 1
                elif at <= slack:
                    here[faces], faces = of, faces + 1
            if passed == 1:
                behind[n], n = of, n + 1
        for source in range(len(offsets)):
            passed, met = 0, 0
            for row in range(offsets[source, p], offsets[source, p + 1]):
                slack = tie / max(abs(cosines[row]), _GRAZING) if modes[source] == BOUNDARY else 0.0
                if other_t[row] < -slack:
                    passed += 1
                elif other_t[row] <= slack:
                    met += 1
            if passed % 2 == 1:
                behind[n], n = other_leaf[source], n + 1
            if met % 2 == 1:
                here[faces], faces = other_leaf[source], faces + 1
        if tabled and own_mode != SHEET:
            mask = zero
            for e in range(n):
                mask |= one << np.uint64(behind[e])
            if own >= 0:
                mask |= one << np.uint64(own)
            inner_side[p], lost = (table >> mask) & one != zero, False
            for e in range(faces):
                lost = lost or here[e] < own
                mask ^= one << np.uint64(here[e])
            if own >= 0:
                mask ^= one << np.uint64(own)
            outer_side[p] = inner_side[p] if lost else (table >> mask) & one != zero
            continue
        for e in range(n):
            bit[behind[e]] = True
            set_leaf(wires, node, negated, need, leaves, behind[e], True, state, climb, climbing)
        if own_mode == SHEET:
            inner_side[p] = keeps_sheet(wires, node, need, inputs, leaves, own, state, climb)
            outer_side[p] = False
        else:
            if own >= 0:
                set_leaf(wires, node, negated, need, leaves, own, True, state, climb, climbing)
            inner_side[p] = state[root] >= need[root]
            lost = False
            for e in range(faces):
                of = here[e]
                lost = lost or of < own
                bit[of] = not bit[of]
                set_leaf(wires, node, negated, need, leaves, of, bit[of], state, climb, climbing)
            if own >= 0:
                set_leaf(wires, node, negated, need, leaves, own, False, state, climb, climbing)
            outer_side[p] = inner_side[p] if lost else state[root] >= need[root]
        for e in range(n + faces):
            of = behind[e] if e < n else here[e - n]
            if bit[of]:
                bit[of] = False
                set_leaf(wires, node, negated, need, leaves, of, False, state, climb, climbing)
