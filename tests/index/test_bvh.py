"""The crossings of lines with triangles, against slow and exact oracles."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numba
import numpy as np
import pytest

from surfel import InputError
from surfel.index import bvh as bvh_module
from surfel.index.bvh import TriangleBvh

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
CUBE_FACES = np.array([row for a, b, c, d in QUADS for row in ([a, b, c], [a, c, d])])


def sphere(levels):
    """An octahedron whose triangles are divided and pushed out to the unit sphere."""
    vertices = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    vertices = [np.array(v, float) for v in vertices]
    for _ in range(levels):
        middles, finer = {}, []
        for a, b, c in faces:
            rows = []
            for i, j in ((a, b), (b, c), (c, a)):
                key = min(i, j), max(i, j)
                if key not in middles:
                    middles[key] = len(vertices)
                    middle = vertices[i] + vertices[j]
                    vertices.append(middle / np.linalg.norm(middle))
                rows.append(middles[key])
            ab, bc, ca = rows
            finer += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
        faces = finer
    return np.array(vertices), np.array(faces)


def random_lines(count, seed=0, radius=1.0, center=(0.0, 0.0, 0.0)):
    """Uniform directions, and uniform offsets in the disk across them."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(directions, rng.standard_normal((count, 3)))
    across *= (radius * np.sqrt(rng.random(count)) / np.linalg.norm(across, axis=1))[:, None]
    return center + across + directions * rng.uniform(-1, 1, (count, 1)) * radius, directions


def main_axes(d):
    """The axes of the shear: the last is that of the largest component, z before x before y."""
    size = [abs(x) for x in d]
    if size[2] >= size[0] and size[2] >= size[1]:
        return 0, 1, 2
    return (1, 2, 0) if size[0] >= size[1] else (2, 0, 1)


def exact_hits(vertices, faces, origin, direction, shift=(0, 0)):
    """The triangles that a line hits, in whole or rational numbers; the line may be shifted across its main axis."""
    kx, ky, kz = main_axes(direction)
    d = direction

    def flat(v):
        p = [x - y for x, y in zip(v, origin, strict=True)]
        return p[kx] * d[kz] - d[kx] * p[kz] - shift[0] * d[kz], p[ky] * d[kz] - d[ky] * p[kz] - shift[1] * d[kz]

    points = [flat(v) for v in vertices]
    hits = []
    for number, (a, b, c) in enumerate(faces):
        sides = [points[i][0] * points[j][1] - points[j][0] * points[i][1] for i, j in ((a, b), (b, c), (c, a))]
        if min(sides) > 0 or max(sides) < 0:
            hits.append(number)
        # without a shift a line may meet an edge: then no answer is known
        elif shift == (0, 0) and (min(sides) == 0 <= max(sides) or max(sides) == 0 >= min(sides)):
            return None
    return hits


def integer_cases(rng, count, size):
    """Integer lines for which the shear is exact: the largest component of the direction is a power of two."""
    directions = rng.integers(-4, 5, (20 * count, 3))
    directions = directions[np.isin(np.abs(directions).max(axis=1), [1, 2, 4])][:count]
    return rng.integers(-size, size + 1, directions.shape), directions


@pytest.mark.parametrize("solid", ["cube", "tangle"])
def test_degenerate_lines_are_decided_as_for_a_line_moved_a_little(solid):
    rng = np.random.default_rng(5)
    if solid == "cube":
        vertices, faces, count = CUBE.astype(int), CUBE_FACES, 1500
    else:  # a closed surface whose corners are thrown about a small lattice: all kinds of coincidences
        _, faces = sphere(1)
        vertices, count = rng.integers(-3, 4, (faces.max() + 1, 3)), 500
    origins, directions = integer_cases(rng, count, 3)
    hits = TriangleBvh(vertices, faces).cross(origins, directions)
    unit = 10**8  # the shift is (1, 1/unit) in units of 1/unit^2, as e and e^2
    for line in range(len(origins)):
        found = hits.triangle[hits.offsets[line] : hits.offsets[line + 1]]
        large = [[int(x) * unit**2 for x in row] for row in vertices]
        origin = [int(x) * unit**2 for x in origins[line]]
        wanted = exact_hits(large, faces.tolist(), origin, [int(x) for x in directions[line]], (unit, 1))
        assert sorted(found) == wanted
        assert len(wanted) % 2 == 0


def test_general_lines_hit_what_rational_numbers_say():
    rng = np.random.default_rng(1)
    vertices, faces = sphere(2)
    vertices = vertices + 0.4 * rng.standard_normal(vertices.shape)
    origins, directions = random_lines(60, 2)
    hits = TriangleBvh(vertices, faces).cross(origins, directions)
    rational = [[Fraction(x) for x in row] for row in vertices]
    for line in range(len(origins)):
        o, d = ([Fraction(x) for x in row[line]] for row in (origins, directions))
        assert sorted(hits.triangle[hits.offsets[line] : hits.offsets[line + 1]]) == exact_hits(rational, faces, o, d)


def test_lines_through_corners_edges_and_along_faces_cross_an_even_number_of_times():
    rng = np.random.default_rng(3)
    vertices, faces = sphere(4)
    pairs = rng.integers(0, len(vertices), (60_000, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    edges = vertices[faces[:, 0]] * 0.5 + vertices[faces[:, 1]] * 0.5
    weights = rng.dirichlet([1, 1, 1], len(faces))
    inside = np.einsum("ij,ijk->ik", weights, vertices[faces])
    cases = [
        (vertices[pairs[:, 0]], vertices[pairs[:, 1]] - vertices[pairs[:, 0]]),
        (np.repeat(edges, 20, 0), rng.standard_normal((20 * len(edges), 3))),
        (edges, vertices[faces[:, 1]] - vertices[faces[:, 0]]),
        (inside, vertices[faces[:, 2]] - inside),
    ]
    bvh = TriangleBvh(vertices, faces)
    for origins, directions in cases:
        counts = bvh.count(origins, directions)
        assert (counts % 2 == 0).all()
        assert (np.diff(bvh.cross(origins, directions).offsets) == counts).all()
        assert counts.max() > 0


def test_soups_with_unmerged_corners_are_as_tight_as_meshes():
    vertices, faces = sphere(3)
    soup = vertices[faces].reshape(-1, 3)
    rng = np.random.default_rng(0)
    origins, directions = soup[rng.integers(0, len(soup), 20_000)], rng.standard_normal((20_000, 3))
    of_soup = TriangleBvh(soup, np.arange(len(soup)).reshape(-1, 3)).count(origins, directions)
    assert (of_soup == TriangleBvh(vertices, faces).count(origins, directions)).all()
    assert (of_soup % 2 == 0).all()


@pytest.mark.parametrize("scale", [1e-300, 1e-12, 1.0, 1e12, 3.4e38, 1e300])
def test_scale_does_not_matter(scale):
    vertices, faces = sphere(3)
    origins, directions = random_lines(5000, 4)
    counts = TriangleBvh(vertices, faces).count(origins, directions)
    hits = TriangleBvh(vertices * scale, faces).cross(origins * scale, directions)
    assert (np.diff(hits.offsets) == counts).all()
    lengths = np.diff(hits.t.reshape(-1, 2), axis=1)[:, 0] / scale
    assert lengths.min() >= 0.0 and 1.99 < lengths.max() <= 2.0


def test_large_offsets_and_far_origins_keep_surfaces_tight():
    vertices, faces = sphere(4)
    place = np.array([500_000.0, 4_200_000.0, 300.0])
    origins, directions = random_lines(20_000, 6)
    near = TriangleBvh(vertices, faces).cross(origins, directions)
    moved = TriangleBvh(vertices + place, faces)
    far = moved.cross(origins + place - 1e7 * directions, directions)
    assert (np.diff(far.offsets) % 2 == 0).all()
    same = np.diff(far.offsets) == np.diff(near.offsets)
    assert same.mean() > 0.9999
    rows = np.repeat(same, np.diff(near.offsets)), np.repeat(same, np.diff(far.offsets))
    # the lattice of numbers near 1e7 is 2e-9 wide, and a line that grazes the sphere moves by its root
    assert np.median(np.abs(far.t[rows[1]] - 1e7 - near.t[rows[0]])) < 1e-8


def test_t_and_barycentric_coordinates_name_the_same_point():
    rng = np.random.default_rng(8)
    vertices, faces = rng.standard_normal((60, 3)), rng.integers(0, 60, (500, 3))
    origins, directions = rng.standard_normal((400, 3)), 3.0 * rng.standard_normal((400, 3))
    offsets, t, triangle, bary = TriangleBvh(vertices, faces).cross(origins, directions, barycentric=True)
    line = np.repeat(np.arange(400), np.diff(offsets))
    weights = np.column_stack([1.0 - bary.sum(axis=1), bary])
    assert weights.min() >= -1e-15
    on_triangle = np.einsum("ij,ijk->ik", weights, vertices[faces[triangle]])
    np.testing.assert_allclose(on_triangle, origins[line] + t[:, None] * directions[line], atol=1e-12)
    assert all((np.diff(t[a:b]) >= 0).all() for a, b in pairwise(offsets))


def test_counts_and_weighted_counts_agree_with_the_hits():
    vertices, faces = sphere(4)
    rng = np.random.default_rng(0)
    weights = rng.standard_normal(len(faces))
    origins, directions = random_lines(10_000, 1, 1.2)
    bvh = TriangleBvh(vertices, faces)
    offsets, _, triangle, _ = bvh.cross(origins, directions)
    line = np.repeat(np.arange(len(origins)), np.diff(offsets))
    assert (bvh.count(origins, directions) == np.diff(offsets)).all()
    sums = bvh.weighted_count(origins, directions, weights)
    np.testing.assert_allclose(sums, np.bincount(line, weights[triangle], len(origins)), atol=1e-12)


def test_area_and_volume_of_a_ball_from_its_chords():
    vertices, faces = sphere(5)
    origins, directions = random_lines(200_000, 7, 1.0)
    hits = TriangleBvh(vertices, faces).cross(origins, directions)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    # the mean over lines through the ball of radius 1: 2 pi s / (4 pi pi) crossings, pi v / (pi pi) of length (Crofton)
    counts = np.diff(hits.offsets)
    assert counts.mean() == pytest.approx(area / (2.0 * np.pi), abs=5.0 * counts.std() / len(counts) ** 0.5)
    lengths = np.add.reduceat(np.append(np.diff(hits.t.reshape(-1, 2), axis=1), 0.0), hits.offsets[:-1] // 2)
    lengths[counts == 0] = 0.0
    assert lengths.mean() == pytest.approx(volume / np.pi, abs=5.0 * lengths.std() / len(counts) ** 0.5)


def test_a_line_through_a_hundred_thousand_triangles_loses_none():
    rng = np.random.default_rng(0)
    heights = rng.permutation(100_000).astype(float)
    corners = np.array([[-1.0, -1.0], [3.0, -1.0], [-1.0, 3.0]])
    soup = np.empty((len(heights), 3, 3))
    soup[:, :, :2], soup[:, :, 2] = corners, heights[:, None]
    bvh = TriangleBvh(soup.reshape(-1, 3), np.arange(3 * len(heights)).reshape(-1, 3))
    origins = np.array([[0.0, 0.0, 0.0], [5.0, 5.0, 0.0], [0.1, 0.2, 7.0]])
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -2.0]])
    offsets, t, triangle, _ = bvh.cross(origins, directions)
    assert offsets.tolist() == [0, 100_000, 100_000, 200_000]
    np.testing.assert_allclose(t[:100_000], np.arange(100_000), atol=1e-9)
    assert (heights[triangle[:100_000]] == np.arange(100_000)).all()
    assert (np.diff(t) >= 0).sum() >= 199_998


def test_where_the_store_is_too_small_lines_are_followed_again(monkeypatch):
    vertices, faces = sphere(3)
    origins, directions = random_lines(5000, 3)
    bvh = TriangleBvh(vertices, faces)
    whole = bvh.cross(origins, directions, barycentric=True)
    monkeypatch.setattr(TriangleBvh, "_room", lambda self, s, d, order: np.full(-(-len(order) // 256), 7))
    for one, other in zip(whole, bvh.cross(origins, directions, barycentric=True), strict=True):
        assert np.array_equal(one, other)


def test_neither_threads_nor_the_order_of_lines_or_triangles_change_a_bit():
    vertices, faces = sphere(5)
    origins, directions = random_lines(20_000, 9)
    weights = np.random.default_rng(1).random(len(faces))
    results = []
    threads = numba.get_num_threads()
    for number in (1, threads):
        numba.set_num_threads(number)
        try:
            bvh = TriangleBvh(vertices, faces)
            results.append((*bvh.cross(origins, directions), bvh.weighted_count(origins, directions, weights)))
        finally:
            numba.set_num_threads(threads)
    assert all(np.array_equal(a, b) for a, b in zip(*results, strict=True))

    back = np.arange(len(origins))[::-1]
    turned = TriangleBvh(vertices, faces).cross(origins[back], directions[back])
    t = [turned.t[a:b] for a, b in pairwise(turned.offsets)]
    assert np.array_equal(np.concatenate(t[::-1]), results[0][1])
    shuffle = np.random.default_rng(2).permutation(len(faces))
    assert np.array_equal(TriangleBvh(vertices, faces[shuffle]).cross(origins, directions).t, results[0][1])


def test_sorting_the_lines_changes_nothing(monkeypatch):
    vertices, faces = sphere(4)
    origins, directions = random_lines(6000, 2)
    bvh = TriangleBvh(vertices, faces)
    sorted_ = bvh.cross(origins, directions)
    monkeypatch.setattr(bvh_module, "_SORT_FROM", 10**9)
    assert all(np.array_equal(a, b) for a, b in zip(sorted_, bvh.cross(origins, directions), strict=True))


def test_rigid_motion_moves_the_hits_along():
    vertices, faces = sphere(4)
    origins, directions = random_lines(5000, 2)
    q, _ = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))
    one = TriangleBvh(vertices, faces).cross(origins, directions)
    two = TriangleBvh(vertices @ q.T + 2.0, faces).cross(origins @ q.T + 2.0, directions @ q.T)
    assert np.array_equal(one.offsets, two.offsets)
    np.testing.assert_allclose(one.t, two.t, atol=1e-9)


def test_triangles_with_equal_corners_are_never_hit():
    vertices = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 0]]
    bvh = TriangleBvh(vertices, [[0, 0, 1], [3, 0, 2], [1, 1, 1], [0, 1, 3]])
    rng = np.random.default_rng(0)
    origins = np.column_stack([rng.random(1000), np.zeros((1000, 2))])
    assert bvh.count(origins, rng.standard_normal((1000, 3))).sum() == 0
    assert bvh.count([[0.5, 0, 0]], [[1, 0, 0]]).sum() == 0


def test_flat_triangles_between_others_keep_a_surface_tight():
    # an edge of the cube is divided on one side only; the flat triangle between the two is part of the surface
    rng = np.random.default_rng(0)
    vertices = np.vstack([CUBE, [CUBE[0] * 0.3 + CUBE[3] * 0.7]])
    vertices = vertices @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    vertices[8] = vertices[0] * 0.3 + vertices[3] * 0.7
    faces = np.vstack([CUBE_FACES[1:], [[0, 1, 8], [1, 3, 8], [0, 8, 3]]])
    along = rng.random((20_000, 1))
    origins = vertices[0] * along + vertices[3] * (1.0 - along)
    counts = TriangleBvh(vertices, faces).count(origins, rng.standard_normal(origins.shape))
    assert (counts % 2 == 0).all() and counts.max() >= 2


def test_nothing_to_cross_and_nothing_to_cross_with():
    empty = TriangleBvh(np.empty((0, 3)), np.empty((0, 3), int))
    assert len(empty) == 0 and len(empty.order) == 0
    offsets, t, triangle, bary = empty.cross([[0, 0, 0]], [[1, 0, 0]])
    assert offsets.tolist() == [0, 0] and len(t) == len(triangle) == len(bary) == 0
    assert empty.count([[0, 0, 0]], [[1, 0, 0]]).tolist() == [0]
    assert empty.weighted_count([[0, 0, 0]], [[1, 0, 0]], []).tolist() == [0.0]
    full = TriangleBvh(CUBE, CUBE_FACES)
    assert full.cross([], []).offsets.tolist() == [0]
    assert len(full.count([], [])) == 0
    assert sorted(full.order) == list(range(12))


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        ([[0, 0]], [[0, 0, 0]], r"vertices must have shape"),
        ([[0, 0, np.nan]], [[0, 0, 0]], r"not finite"),
        (CUBE, [[0, 1, 8]], r"from 0 to 7; got 0 to 8"),
        (CUBE, [[0, 1, -1]], r"from 0 to 7; got -1"),
        (CUBE, [[0.0, 1.0, 2.0]], r"integers of shape \(f, 3\); got float64"),
        (CUBE, [[0, 1, 2, 3]], r"shape \(1, 4\)"),
    ],
)
def test_bad_triangles_are_refused(vertices, faces, said):
    with pytest.raises(InputError, match=said):
        TriangleBvh(vertices, faces)


def test_as_many_origins_as_directions():
    with pytest.raises(InputError, match="got 2 and 1"):
        TriangleBvh(CUBE, CUBE_FACES).count([[0, 0, 0], [0, 0, 0]], [[1, 0, 0]])


@pytest.mark.parametrize("direction", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 1]])
def test_bad_directions_are_refused(direction):
    bvh = TriangleBvh(CUBE, CUBE_FACES)
    for call in (bvh.cross, bvh.count):
        with pytest.raises(InputError, match="directions must be finite and none of them zero"):
            call([[0, 0, 0], [0, 0, 0]], [[1, 0, 0], direction])


def test_one_weight_for_each_triangle():
    with pytest.raises(InputError, match=r"weights must have shape \(12,\)"):
        TriangleBvh(CUBE, CUBE_FACES).weighted_count([[0, 0, 0]], [[1, 0, 0]], [1.0])
