"""Eight boxes or eight triangles against one line at once, and the same two tests in plain kernels.

The vector forms are written in LLVM's generic vector operations, which every CPU lowers to what it has (AVX, SSE,
NEON). They are filters: their rounding differs from CPU to CPU, within a bound that the caller allows for, so that no
answer depends on which form ran.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from surfel._numba import inlined

LANES = 8


def _lanes_of(mask: int) -> list[int]:
    return ([lane for lane in range(LANES) if mask >> lane & 1] + [0] * LANES)[:LANES]


LANES_OF = np.array([_lanes_of(mask) for mask in range(256)], np.uint8)
"""The lanes that are set in each mask, lowest first, shape (256, 8)."""
COUNT_OF = np.array([mask.bit_count() for mask in range(256)], np.uint8)
"""How many lanes are set in each mask."""

_F32, _I1, _I8, _I32, _I64 = ir.FloatType(), ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
_FLOATS, _LANES32, _BYTES = ir.VectorType(_F32, LANES), ir.VectorType(_I32, LANES), ir.VectorType(_I8, LANES)
_FUSE = ("contract",)


def _splat(builder: Any, value: Any, kind: Any) -> Any:
    """Return the vector whose lanes all hold ``value``."""
    nothing = ir.Constant(kind, ir.Undefined)
    one = builder.insert_element(nothing, value, _I32(0))
    return builder.shuffle_vector(one, nothing, ir.Constant(_LANES32, [_I32(0)] * LANES))


def _address(context: Any, builder: Any, kind: Any, array: Any, offset: Any, vector: Any) -> Any:
    """Return a pointer to the vector that starts at element ``offset`` of a contiguous array."""
    base = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(base, [offset]), vector.as_pointer())


def _least(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


def _most(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _mask(builder: Any, lanes: Any) -> Any:
    """Return the bits of a vector of truth values as an integer, lane 0 lowest."""
    return builder.zext(builder.bitcast(lanes, _I8), _I64)


@intrinsic
def _box_mask(typing, nodes, node, nx, fx, ny, fy, nz, fz, ix, cx, iy, cy):
    """Return which of a node's eight boxes overlap the line."""
    f, i = types.float32, types.int64
    signature = i(nodes, i, i, i, i, i, i, i, f, f, f, f)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        rows, (ix, cx, iy, cy) = values[2:8], values[8:12]
        start = builder.mul(values[1], _I64(6 * LANES))

        def side(row: Any) -> Any:
            place = builder.add(start, row)
            return builder.load(_address(context, builder, signature.args[0], values[0], place, _FLOATS), align=4)

        def along(row: Any, inverse: Any, offset: Any) -> Any:
            product = builder.fmul(side(row), _splat(builder, inverse, _FLOATS), flags=_FUSE)
            return builder.fsub(product, _splat(builder, offset, _FLOATS), flags=_FUSE)

        near = _most(builder, along(rows[0], ix, cx), along(rows[2], iy, cy))
        far = _least(builder, along(rows[1], ix, cx), along(rows[3], iy, cy))
        near = _most(builder, near, side(rows[4]))
        far = _least(builder, far, side(rows[5]))
        return _mask(builder, builder.fcmp_ordered("<=", near, far))

    return signature, generate


@intrinsic
def _triangle_masks(typing, corners, leaf, kx, ky, kz, sx, sy, cx, cy, slack):
    """Return which of a leaf's eight triangles the line may hit, and 8 bits higher, which it surely hits."""
    f, i = types.float32, types.int64
    signature = i(corners, i, i, i, i, f, f, f, f, f)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        start = builder.mul(values[1], _I64(9 * LANES))
        sx, sy, cx, cy, slack = (_splat(builder, value, _FLOATS) for value in values[5:10])

        def coordinate(vertex: int, axis: Any) -> Any:
            place = builder.add(start, builder.add(axis, _I64(3 * LANES * vertex)))
            return builder.load(_address(context, builder, signature.args[0], values[0], place, _FLOATS), align=4)

        def sheared(vertex: int) -> Any:
            x, y, z = (coordinate(vertex, axis) for axis in values[2:5])
            u = builder.fsub(x, builder.fmul(sx, z, flags=_FUSE), flags=_FUSE)
            v = builder.fsub(y, builder.fmul(sy, z, flags=_FUSE), flags=_FUSE)
            return builder.fsub(u, cx), builder.fsub(v, cy)

        def edge(a: Any, b: Any) -> Any:
            positive = builder.fmul(a[0], b[1], flags=_FUSE)
            return builder.fsub(positive, builder.fmul(b[0], a[1], flags=_FUSE), flags=_FUSE)

        a, b, c = sheared(0), sheared(1), sheared(2)
        edges = edge(a, b), edge(b, c), edge(c, a)
        low = _least(builder, _least(builder, edges[0], edges[1]), edges[2])
        high = _most(builder, _most(builder, edges[0], edges[1]), edges[2])
        minus = builder.fneg(slack)
        maybe = builder.or_(builder.fcmp_ordered(">=", low, minus), builder.fcmp_ordered("<=", high, slack))
        sure = builder.or_(builder.fcmp_ordered(">", low, slack), builder.fcmp_ordered("<", high, minus))
        return builder.or_(_mask(builder, maybe), builder.shl(_mask(builder, sure), _I64(8)))

    return signature, generate


@intrinsic
def _store_lanes(typing, queue, tail, first, mask, lanes_of):
    """Write ``first`` plus the lanes of the mask to eight places of the queue, from ``tail`` on."""
    signature = types.void(queue, types.int64, types.int32, types.int64, lanes_of)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        row = builder.mul(values[3], _I64(LANES))
        lanes = builder.load(_address(context, builder, signature.args[4], values[4], row, _BYTES), align=1)
        numbers = builder.add(builder.zext(lanes, _LANES32), _splat(builder, values[2], _LANES32))
        builder.store(numbers, _address(context, builder, signature.args[0], values[0], values[1], _LANES32), align=4)
        return context.get_dummy_value()

    return signature, generate


@intrinsic
def _store_same(typing, queue, tail, value):
    """Write one value to eight places of the queue, from ``tail`` on."""
    signature = types.void(queue, types.int64, types.int32)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = _address(context, builder, signature.args[0], values[0], values[1], _LANES32)
        builder.store(_splat(builder, values[2], _LANES32), place, align=4)
        return context.get_dummy_value()

    return signature, generate


@inlined
def boxes_vector(nodes, node, rows, frame):
    """Do what :func:`boxes_plain` does, eight boxes at a time."""
    nx, fx, ny, fy, nz, fz = rows
    ix, cx, iy, cy = frame
    return _box_mask(nodes, node, nx, fx, ny, fy, nz, fz, ix, cx, iy, cy)


@inlined
def triangles_vector(corners, leaf, axes, shear, slack):
    """Do what :func:`triangles_plain` does, eight triangles at a time."""
    kx, ky, kz = axes
    sx, sy, cx, cy = shear
    return _triangle_masks(corners, leaf, kx, ky, kz, sx, sy, cx, cy, slack)


@inlined
def append_vector(queue, tail, first, mask):
    """Do what :func:`append_plain` does, without a branch; eight places after the tail are overwritten."""
    _store_lanes(queue, tail, np.int32(first), mask, LANES_OF)
    return tail + COUNT_OF[mask]


@inlined
def append_same_vector(queue, tail, value):
    """Do what :func:`append_same_plain` does."""
    _store_same(queue, tail, np.int32(value))


@inlined
def boxes_plain(nodes, node, rows, frame):
    """Return which of the boxes of ``node`` the line meets, as bits.

    The line is (cx, cy) / (ix, iy) + z (1/ix, 1/iy): it meets a box where its passages through the three slabs
    overlap in z. ``rows`` are the places of the near and far sides of the slabs along x, y, z among a node's 48
    floats.
    """
    nx, fx, ny, fy, nz, fz = rows
    ix, cx, iy, cy = frame
    box = nodes[node].ravel()
    mask = 0
    for lane in range(LANES):
        near = max(max(box[nx + lane] * ix - cx, box[ny + lane] * iy - cy), box[nz + lane])
        far = min(min(box[fx + lane] * ix - cx, box[fy + lane] * iy - cy), box[fz + lane])
        mask |= (near <= far) << lane
    return mask


@inlined
def triangles_plain(corners, leaf, axes, shear, slack):
    """Return which triangles of ``leaf`` the line may hit (bits 0 to 7) and which it surely hits (bits 8 to 15).

    Corners are sheared along the line to points of a plane in which the line is the origin; the line hits where the
    three edge functions have one sign. ``slack`` bounds their rounding. ``axes`` are the places of the sheared axes
    and of the line's main axis among the 24 floats of eight corners.
    """
    kx, ky, kz = axes
    sx, sy, cx, cy = shear
    corner = corners[leaf].ravel()
    mask = 0
    for lane in range(LANES):
        z = corner[kz + lane]
        ax, ay = corner[kx + lane] - sx * z - cx, corner[ky + lane] - sy * z - cy
        z = corner[3 * LANES + kz + lane]
        bx, by = corner[3 * LANES + kx + lane] - sx * z - cx, corner[3 * LANES + ky + lane] - sy * z - cy
        z = corner[6 * LANES + kz + lane]
        gx, gy = corner[6 * LANES + kx + lane] - sx * z - cx, corner[6 * LANES + ky + lane] - sy * z - cy
        ab, bc, ca = ax * by - bx * ay, bx * gy - gx * by, gx * ay - ax * gy
        low, high = min(min(ab, bc), ca), max(max(ab, bc), ca)
        mask |= (low >= -slack or high <= slack) << lane
        mask |= (low > slack or high < -slack) << (8 + lane)
    return mask


@inlined
def append_plain(queue, tail, first, mask):
    """Append ``first`` plus the number of each bit that is set in the mask; return the new tail."""
    for lane in range(LANES):
        if mask >> lane & 1:
            queue[tail] = first + lane
            tail += 1
    return tail


@inlined
def append_same_plain(queue, tail, value):
    """Write ``value`` to eight places of the queue from ``tail`` on: as many as may be appended beside."""
    for lane in range(LANES):
        queue[tail + lane] = value


VECTOR = sys.byteorder == "little"  # the bits of a mask stand in the order of its lanes
boxes_hit = boxes_vector if VECTOR else boxes_plain
triangles_hit = triangles_vector if VECTOR else triangles_plain
append = append_vector if VECTOR else append_plain
append_same = append_same_vector if VECTOR else append_same_plain
