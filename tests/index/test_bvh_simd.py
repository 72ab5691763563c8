"""The vector forms of the filters against the plain ones, and the whole on a processor without extensions."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from surfel._numba import kernel
from surfel.index import bvh_simd
from surfel.index.bvh import TriangleBvh
from surfel.index.bvh_exact import cross_triangle, line_frame

boxes_plain, boxes_vector = bvh_simd.boxes_plain, bvh_simd.boxes_vector
triangles_plain, triangles_vector = bvh_simd.triangles_plain, bvh_simd.triangles_vector
append_plain, append_vector = bvh_simd.append_plain, bvh_simd.append_vector


@kernel
def both_boxes(nodes, node, rows, frame):
    return boxes_plain(nodes, node, rows, frame), boxes_vector(nodes, node, rows, frame)


@kernel
def both_triangles(corners, leaf, axes, shear, slack):
    return triangles_plain(corners, leaf, axes, shear, slack), triangles_vector(corners, leaf, axes, shear, slack)


@kernel
def both_appends(one, two, tail, first, mask):
    return append_plain(one, tail, first, mask), append_vector(two, tail, first, mask)


@kernel
def exact_count(tree, origin, direction):
    axes, shear, start, _ = line_frame(origin, direction, tree.scale, tree.middle, tree.size)
    count = 0
    for a, b, c in tree.corners:
        count += cross_triangle(tree.vertices, a, b, c, axes, shear, start)[0]
    return count


def floats(*values):
    return tuple(np.float32(v) for v in values)


def test_boxes():
    rng = np.random.default_rng(0)
    centers = rng.integers(-4, 5, (50, 3, 8)) / 8.0  # eighths: both forms are exact, whatever is fused
    nodes = np.concatenate([centers - 0.25, centers + 0.25], axis=1).astype(np.float32)
    nodes[::7, :, 5:] = np.nan
    seen = set()
    for node in range(50):
        for _ in range(20):
            ix, iy = rng.choice([-4.0, -2.0, 2.0, 4.0], 2)
            x, y = (0 if ix > 0 else 3), (0 if iy > 0 else 3)
            rows = tuple(8 * r for r in (x, 3 - x, 1 + y, 4 - y, 2, 5))
            plain, vector = both_boxes(
                nodes, node, rows, floats(ix, rng.integers(-8, 9) / 4, iy, rng.integers(-8, 9) / 4)
            )
            assert plain == vector
            seen.add(plain)
            assert node % 7 or plain < 32
    assert len(seen) > 20


def test_triangles():
    rng = np.random.default_rng(1)
    corners = (rng.integers(-8, 9, (50, 9, 8)) / 8.0).astype(np.float32)
    corners[::7, :, 6:] = np.nan
    seen = set()
    for leaf in range(50):
        for axes in ((0, 8, 16), (8, 16, 0), (16, 0, 8)):
            shear = floats(*rng.integers(-4, 5, 4) / 4.0)
            plain, vector = both_triangles(corners, leaf, axes, shear, np.float32(rng.integers(0, 3) / 16.0))
            assert plain == vector
            maybe, sure = plain & 255, plain >> 8
            assert sure & ~maybe == 0
            assert leaf % 7 or maybe < 64
            seen.add(maybe)
    assert len(seen) > 10


def test_append():
    for mask in range(256):
        one, two = np.full(32, -1, np.int32), np.full(32, -1, np.int32)
        plain, vector = both_appends(one, two, 3, 40, mask)
        assert plain == vector == 3 + mask.bit_count()
        assert one[:plain].tolist() == two[:plain].tolist()
        assert one[3:plain].tolist() == [40 + lane for lane in range(8) if mask >> lane & 1]


SCRIPT = """
import hashlib, numpy as np
from surfel.index.bvh import TriangleBvh
rng = np.random.default_rng(0)
vertices = rng.standard_normal((3000, 3))
faces = (rng.integers(0, 3000, (20000, 1)) + [[0, 7, 19]]) % 3000
bvh = TriangleBvh(vertices, faces)
lines = rng.standard_normal((2000, 3)), rng.standard_normal((2000, 3))
digest = hashlib.sha256()
for array in (*bvh.cross(*lines, barycentric=True), bvh.count(*lines)):
    digest.update(np.ascontiguousarray(array).tobytes())
print(digest.hexdigest())
"""


@pytest.mark.slow
def test_a_processor_without_extensions_gives_the_same_bits():
    def digest(**settings):
        run = subprocess.run(
            [sys.executable, "-c", SCRIPT], env={**os.environ, **settings}, capture_output=True, text=True
        )
        assert run.returncode == 0, run.stderr
        return run.stdout.strip()

    assert digest(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == digest()


def test_the_filters_lose_nothing_that_the_exact_test_accepts():
    rng = np.random.default_rng(0)
    soup, origins, directions = (rng.standard_normal((rows, 3)) for rows in (900, 300, 300))
    bvh = TriangleBvh(soup, np.arange(900).reshape(-1, 3))
    counts = bvh.count(origins, directions)
    exact = [exact_count(bvh._tree, tuple(o), tuple(d)) for o, d in zip(origins, directions, strict=True)]
    assert counts.tolist() == exact
    assert counts.sum() > 1000
