"""Lines through the tree, a chunk of them at a time, each step for all lines of the chunk before the next.

Nodes wait in a queue with the line that meets them. Whatever is in the queue does not depend on what else is in it,
so the processor works on several at once and seldom guesses a branch wrong; neighbouring lines meet the same nodes
while these are in its cache.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined, rows
from surfel.index.bvh_build import REACH
from surfel.index.bvh_exact import cross_triangle, line_frame
from surfel.index.bvh_simd import COUNT_OF, LANES, append, append_same, boxes_hit, triangles_hit

COUNT, WEIGH, STORE = 0, 1, 2
CHUNK = 256
"""How many lines are followed together; they share a region of the store."""
_QUEUE = 16_384  # when this many wait, the last comes first, which adds at most 7 nodes a level
_ROOM = 256
_LEAVES = 2048
_LEAST_SLOPE = 1e-10


@rows
def trace(
    first, last, tree, origins, directions, order, mode, weights, counts, sums, regions, places, store_t, store_triangle
):
    """Cross each line with the tree, in ``order``; what is written depends on ``mode``.

    COUNT and STORE write ``counts``, WEIGH writes ``sums``. STORE also writes the sorted hits of each line to
    ``store_t`` and ``store_triangle``, from its place of ``places`` on. A chunk of lines shares the region from
    ``regions[chunk]`` to ``regions[chunk + 1]``; where that is too small, the places of its lines are -1.
    """
    m = len(order)
    local = np.empty((CHUNK, 6))
    exact, near, sides = np.empty((CHUNK, 7)), np.empty((CHUNK, 8), np.float32), np.empty((CHUNK, 8), np.int32)
    nodes, of_nodes = np.empty(_QUEUE + _ROOM, np.int32), np.empty(_QUEUE + _ROOM, np.int32)
    leaves, of_leaves = np.empty(_LEAVES + LANES, np.int32), np.empty(_LEAVES + LANES, np.int32)
    doubts, of_doubts = np.empty(LANES * (_LEAVES + LANES), np.int32), np.empty(LANES * (_LEAVES + LANES), np.int32)
    count, total = np.empty(CHUNK, np.int32), np.empty(CHUNK)
    most = 0
    for chunk in range(first, last):
        most = max(most, regions[chunk + 1] - regions[chunk])
    hit_line, hit_triangle, hit_t = np.empty(most, np.int32), np.empty(most, np.int32), np.empty(most)
    for chunk in range(first, last):
        lines = order[chunk * CHUNK : min(m, (chunk + 1) * CHUNK)]
        room = regions[chunk + 1] - regions[chunk]
        count[:], total[:] = 0, 0.0
        for i in range(len(lines)):  # a loop of its own: these reads from all over memory do not wait for each other
            for axis in range(3):
                local[i, axis], local[i, 3 + axis] = origins[lines[i], axis], directions[lines[i], axis]
        tail = _prepare(tree, local, len(lines), exact, near, sides, nodes, of_nodes)
        head, hits = np.int64(0), np.int64(0)  # not literals, for which numba would compile what is called once more
        while head < tail:
            head, tail, found = _descend(tree, near, sides, nodes, of_nodes, head, tail, leaves, of_leaves)
            doubtful = np.int64(0)
            for k in range(found):
                leaf, line = leaves[k], of_leaves[k]
                axes = sides[line, 6], sides[line, 7], sides[line, 4]
                shear = near[line, 4], near[line, 5], near[line, 6], near[line, 7]
                mask = triangles_hit(tree.leaves, leaf, axes, shear, tree.slack[leaf])
                if mode == COUNT:
                    sure = mask >> 8
                    count[line] += COUNT_OF[sure]
                    mask ^= sure
                append_same(of_doubts, doubtful, line)
                doubtful = append(doubts, doubtful, np.int32(leaf * LANES), mask & 255)
            for k in range(doubtful):
                i, line = doubts[k], of_doubts[k]
                axes = sides[line, 6] // LANES, sides[line, 7] // LANES, sides[line, 4] // LANES
                shear, start = (exact[line, 0], exact[line, 1]), (exact[line, 2], exact[line, 3], exact[line, 4])
                a, b, c = tree.corners[i, 0], tree.corners[i, 1], tree.corners[i, 2]
                hit, z, _, _ = cross_triangle(tree.vertices, a, b, c, axes, shear, start)
                count[line] += hit
                if mode == STORE:
                    if hits < room:  # the next hit takes this place if this is none
                        hit_line[hits], hit_triangle[hits] = line, i
                        hit_t[hits] = (z + exact[line, 5]) * exact[line, 6]
                    hits += hit
                elif mode == WEIGH and hit:
                    total[line] += weights[tree.order[i]]
        write = regions[chunk]
        for i in range(len(lines)):
            if mode == WEIGH:
                sums[lines[i]] = total[i]
            else:
                counts[lines[i]] = count[i]
            if mode == STORE:
                places[lines[i]] = write if hits <= room else -1
                hits_of, count[i] = count[i], write - regions[chunk]
                write += hits_of
        if mode == STORE and hits <= room:
            _scatter(hit_line, hit_t, hit_triangle, hits, count, regions[chunk], store_t, store_triangle)
            for i in range(len(lines)):
                _sort_hits(store_t, store_triangle, places[lines[i]], places[lines[i]] + counts[lines[i]])


@rows
def place_hits(
    first, last, tree, origins, directions, counts, offsets, places, store_t, store_triangle, t, triangle, bary
):
    """Copy stored hits to the caller's order, and compute their barycentric coordinates where ``bary`` has room."""
    for line in range(first, last):
        if places[line] < 0:
            continue
        for k in range(counts[line]):
            source, target = places[line] + k, offsets[line] + k
            t[target] = store_t[source]
            found = store_triangle[source]
            triangle[target] = tree.order[found]
            if len(bary):
                origin = origins[line, 0], origins[line, 1], origins[line, 2]
                direction = directions[line, 0], directions[line, 1], directions[line, 2]
                axes, shear, start, _ = line_frame(origin, direction, tree.scale, tree.middle, tree.size)
                a, b, c = tree.corners[found, 0], tree.corners[found, 1], tree.corners[found, 2]
                _, _, v, w = cross_triangle(tree.vertices, a, b, c, axes, shear, start)
                bary[target, 0] = v
                bary[target, 1] = w


@inlined
def _prepare(tree, lines, count, exact, near, sides, nodes, of_nodes):
    """Write down each line for the exact test, the boxes and the triangles; queue the root for those that may meet it.

    ``exact``: shear, origin, move, 1 / (scale d). ``near``: 1 / slope and offset / slope for the boxes, twice; shear
    and offset for the triangles. ``sides``: where a node keeps the near and far sides along x, y and z; where a leaf
    keeps x and y.
    """
    shrink = 1.0 / tree.size
    tail = 0
    for i in range(count):
        origin, direction = (lines[i, 0], lines[i, 1], lines[i, 2]), (lines[i, 3], lines[i, 4], lines[i, 5])
        axes, shear, start, moved = line_frame(origin, direction, tree.scale, tree.middle, tree.size)
        kx, ky, kz = axes
        sx, sy = shear
        exact[i, 0], exact[i, 1] = sx, sy
        exact[i, 2], exact[i, 3], exact[i, 4] = start
        exact[i, 5], exact[i, 6] = moved, 1.0 / (direction[kz] * tree.scale)
        z = start[2] - tree.middle[kz]
        cx = ((start[0] - tree.middle[kx]) - sx * z) * shrink
        cy = ((start[1] - tree.middle[ky]) - sy * z) * shrink
        near[i, 4], near[i, 5], near[i, 6], near[i, 7] = sx, sy, cx, cy
        ix = 1.0 / (sx if abs(sx) > _LEAST_SLOPE else _LEAST_SLOPE)
        iy = 1.0 / (sy if abs(sy) > _LEAST_SLOPE else _LEAST_SLOPE)
        near[i, 0], near[i, 1], near[i, 2], near[i, 3] = ix, cx * ix, iy, cy * iy
        x, y = (0 if ix > 0.0 else 3 * LANES), (0 if iy > 0.0 else 3 * LANES)
        sides[i, 0], sides[i, 1] = LANES * kx + x, LANES * (kx + 3) - x
        sides[i, 2], sides[i, 3] = LANES * ky + y, LANES * (ky + 3) - y
        sides[i, 4], sides[i, 5] = LANES * kz, LANES * (kz + 3)
        sides[i, 6], sides[i, 7] = LANES * kx, LANES * ky
        nodes[tail], of_nodes[tail] = 0, i
        tail += max(abs(cx), abs(cy)) <= REACH
    return tail


@inlined
def _descend(tree, near, sides, nodes, of_nodes, head, tail, leaves, of_leaves):
    """Replace nodes of the queue by their children, until it is empty or there are enough leaves."""
    found = np.int64(0)
    while head < tail and found < _LEAVES:
        if tail >= _QUEUE and head >= _QUEUE // 2:
            for k in range(tail - head):
                nodes[k], of_nodes[k] = nodes[head + k], of_nodes[head + k]
            head, tail = 0, tail - head
        if tail < _QUEUE:
            node, line = nodes[head], of_nodes[head]
            head += 1
        else:
            tail -= 1
            node, line = nodes[tail], of_nodes[tail]
        places = sides[line, 0], sides[line, 1], sides[line, 2], sides[line, 3], sides[line, 4], sides[line, 5]
        frame = near[line, 0], near[line, 1], near[line, 2], near[line, 3]
        mask = boxes_hit(tree.nodes, node, places, frame)
        if node < tree.bottom:
            append_same(of_nodes, tail, line)
            tail = append(nodes, tail, tree.first[node], mask)
        else:
            append_same(of_leaves, found, line)
            found = append(leaves, found, tree.first[node], mask)
    return head, tail, found


@inlined
def _scatter(hit_line, hit_t, hit_triangle, hits, slots, start, store_t, store_triangle):
    """Move the hits of a chunk to the places of their lines."""
    for k in range(hits):
        line = hit_line[k]
        target = start + slots[line]
        slots[line] += 1
        store_t[target], store_triangle[target] = hit_t[k], hit_triangle[k]


@inlined
def _sort_hits(t, triangle, start, stop):
    """Sort hits by t, equal ones by triangle; Shell's sort, with insertion for the few hits that are the rule."""
    gap = 1
    while 9 * gap < stop - start:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(start + gap, stop):
            value, number = t[i], triangle[i]
            j = i - gap
            while j >= start and (t[j] > value or (t[j] == value and triangle[j] > number)):
                t[j + gap], triangle[j + gap] = t[j], triangle[j]
                j -= gap
            t[j + gap], triangle[j + gap] = value, number
        gap //= 3
