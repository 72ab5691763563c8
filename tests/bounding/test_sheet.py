"""A safe spline as a shape: normals, bounds, areas, patches and crossings agree with each other and with formulas."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel import InputError, Lines
from surfel.bounding.sheet import SplineSheet

PLACED = {"direction": (0.3, -0.5, 0.8), "low": (-3.0, 2.0), "scale": (2.0, 0.5)}
RAGGED = np.random.default_rng(8).integers(0, 16, (8, 6)) * (np.random.default_rng(9).random((8, 6)) < 0.7)


def plane(n, m, slope_u, slope_v):
    """Return coefficients of the plane 1 + slope_u u + slope_v v over cells."""
    return 1.0 + slope_u * (np.arange(n + 2)[:, None] - 1.0) + slope_v * (np.arange(m + 2) - 1.0)


@pytest.mark.parametrize("side", ["above", "below"])
def test_derivatives_and_normals_are_those_of_differences(make_spline, side):
    spline = make_spline(side=side, **PLACED)
    uv = np.random.default_rng(1).uniform(0.1, 5.9, (300, 2))
    step = 1e-5
    ahead, behind = ([spline(uv + s * step * e) for e in np.eye(2)] for s in (1.0, -1.0))
    np.testing.assert_allclose(spline.gradient(uv), (np.array(ahead) - behind).T / (2 * step), atol=1e-8)
    bends = [(spline.gradient(uv + step * e) - spline.gradient(uv - step * e)) / (2 * step) for e in np.eye(2)]
    np.testing.assert_allclose(spline.hessian(uv), np.stack(bends, axis=1), atol=1e-7)
    points = [spline.frame.to_world(uv + d, spline(uv + d)) for d in ([step, 0], [-step, 0], [0, step], [0, -step])]
    cross = np.cross(points[0] - points[1], points[2] - points[3])
    cross /= np.linalg.norm(cross, axis=1)[:, None]
    np.testing.assert_allclose(spline.normal(uv), cross if side == "above" else -cross, atol=1e-8)


def test_outside_the_trim_everything_is_nan(make_spline):
    occupancy = np.zeros((8, 6), np.uint8)
    occupancy[0, 0] = 15
    spline = make_spline(occupancy=occupancy)
    uv = np.array([[0.5, 0.5], [5.0, 5.0], [-1.0, 0.5]])
    for answer in (spline.gradient, spline.hessian, spline.normal):
        flat = answer(uv).reshape(3, -1)
        assert np.isfinite(flat[0]).all() and np.isnan(flat[1:]).all()
        assert np.isfinite(answer(uv, trimmed=False).reshape(3, -1)[:2]).all()


def test_cells_bound_the_surface_tightly(make_spline):
    spline = make_spline()
    rng = np.random.default_rng(2)
    for cell in ((0, 0), (3, 5), (7, 2)):
        low, high = spline.bounds(cell)
        values = spline(np.array(cell) + rng.random((5000, 2)))
        assert low <= values.min() and values.max() <= high
        assert high - low < 3.0 * np.ptp(values)
    flat = make_spline(np.full((11, 9), 3.0)).bounds((1, 1))
    np.testing.assert_allclose(flat, 3.0, rtol=1e-13)
    for cell in ((8, 0), (-1, 0), 3, ("a", 1)):
        with pytest.raises(InputError, match="cell"):
            spline.bounds(cell)


def test_the_area_of_a_plane_over_a_ragged_trim_is_exact(make_spline):
    spline = make_spline(plane(9, 7, 0.3, -0.4), occupancy=RAGGED, scale=(2.0, 0.5))
    squares = np.unpackbits(spline.trim).sum() / 4.0
    expected = squares / (2.0 * 0.5) * np.sqrt(1.0 + (0.3 * 2.0) ** 2 + (0.4 * 0.5) ** 2)
    assert np.isclose(spline.sheet().area, expected, rtol=1e-13)


def test_the_area_of_a_wavy_surface_is_that_of_triangles(make_spline):
    spline = make_spline(**PLACED)
    n = 1200
    u, v = np.meshgrid(np.linspace(0, 8, n), np.linspace(0, 6, n), indexing="ij")
    uv = np.column_stack([u.ravel(), v.ravel()])
    p = spline.frame.to_world(uv, spline(uv)).reshape(n, n, 3)
    one = np.cross(p[1:, :-1] - p[:-1, :-1], p[:-1, 1:] - p[:-1, :-1])
    two = np.cross(p[:-1, 1:] - p[1:, 1:], p[1:, :-1] - p[1:, 1:])
    by_triangles = 0.5 * (np.linalg.norm(one, axis=2).sum() + np.linalg.norm(two, axis=2).sum())
    assert np.isclose(spline.sheet().area, by_triangles, rtol=1e-5)


@pytest.mark.parametrize("side", ["above", "below"])
def test_patches_lie_on_the_surface_inside_its_bounds(make_spline, side):
    spline = make_spline(side=side, occupancy=RAGGED, **PLACED)
    sheet = spline.sheet()
    patches = sheet.patches(5000)
    uv, heights = spline.to_domain(patches.points)
    np.testing.assert_allclose(spline(uv, trimmed=False), heights, atol=1e-12)
    assert spline.trim_mask(uv).mean() > 0.995  # some lie on the very border
    assert np.isclose(patches.areas.sum(), sheet.area)
    np.testing.assert_allclose(patches.normals, spline.normal(uv, trimmed=False), atol=1e-11)
    low, high = sheet.bounds
    assert ((patches.points >= low) & (patches.points <= high)).all()
    assert ((high - low) < 1.6 * np.ptp(patches.points, axis=0)).all()


def test_patches_have_a_flat_density(make_spline):
    spline = make_spline(np.ones((11, 9)), occupancy=RAGGED)
    uv = spline.to_domain(spline.sheet().patches(200_000).points)[0]
    counts = np.zeros((8, 6))
    np.add.at(counts, tuple(np.minimum(uv, [7.5, 5.5]).astype(int).T), 1)
    shares = np.unpackbits(spline.trim[..., None], axis=-1).sum(axis=-1)
    np.testing.assert_allclose(counts / 200_000, shares / shares.sum(), atol=2e-4)


def random_lines(shape, count, seed=0):
    """Return lines of all directions through the ball round the bounds, by Cauchy and Crofton."""
    rng = np.random.default_rng(seed)
    low, high = shape.bounds
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    across = np.cross(directions, rng.normal(size=(count, 3)))
    across /= np.linalg.norm(across, axis=1)[:, None]
    origins = middle + radius * np.sqrt(rng.random((count, 1))) * across
    return Lines(origins, directions, np.full(count, 2.0 * np.pi**2 * radius**2 / count))


def test_crossings_count_the_area_and_know_the_normal(make_spline):
    spline = make_spline(occupancy=RAGGED, **PLACED)
    sheet = spline.sheet()
    lines = random_lines(sheet, 200_000)
    hits = sheet.cross(lines)
    sums = hits.weight_per_line() * lines.weights / np.pi
    assert abs(sums.sum() - sheet.area) < 4.0 * sums.std() * np.sqrt(len(lines))
    points = lines.origins[hits.lines] + hits.t[:, None] * lines.directions[hits.lines]
    cosine = np.einsum("ij,ij->i", lines.directions[hits.lines], spline.normal(points, trimmed=False))
    np.testing.assert_allclose(hits.cosine, cosine, atol=1e-9)
    assert hits.leaf.dtype == np.int32 and (hits.weight == 1.0).all()
    assert (np.diff(hits.t)[np.diff(hits.lines) == 0] > 0.0).all()


def test_crossing_under_an_affine_map(make_spline):
    sheet = make_spline(occupancy=RAGGED).sheet()
    matrix = np.eye(4)
    matrix[:3, :3] = [[1.0, 0.4, 0.0], [0.0, -2.0, 0.3], [0.2, 0.0, 0.5]]
    matrix[:3, 3] = [5.0, -1.0, 2.0]
    lines = random_lines(sheet, 2000)
    moved = Lines.of(
        lines.origins @ matrix[:3, :3].T + matrix[:3, 3], lines.directions @ matrix[:3, :3].T, lines.weights
    )
    inverse = np.linalg.inv(matrix)[:3]
    plain, placed = sheet.cross(lines), sheet._cross_placed(moved, inverse)
    np.testing.assert_array_equal(plain.offsets, placed.offsets)
    stretch = np.linalg.norm(lines.directions @ matrix[:3, :3].T, axis=1)
    np.testing.assert_allclose(placed.t, plain.t * stretch[plain.lines], atol=1e-9)
    assert (np.sign(placed.cosine) == np.sign(plain.cosine)).all()


def test_a_sheet_is_a_leaf_of_a_tree(make_spline):
    sheet = make_spline(np.full((11, 9), 2.0)).sheet()
    box = surfel.Box((2.0, 3.0, 9.0)).translated((3.0, 4.0, 0.0))
    uv = np.random.default_rng(0).uniform([0.0, 0.0], [8.0, 6.0], (3000, 2))
    lines = Lines.of(np.column_stack([uv, np.full(3000, 9.0)]), np.tile([0.0, 0.0, -1.0], (3000, 1)), 1.0)
    inside = (np.abs(uv - [3.0, 4.0]) < [1.0, 1.5]).all(axis=1)
    np.testing.assert_array_equal((sheet & box).cross(lines).counts == 1, inside)
    np.testing.assert_array_equal((sheet - box).cross(lines).counts == 1, ~inside)
    moved = sheet.translated((0.5, 0.0, 1.0))
    np.testing.assert_allclose(moved.cross(lines).t, 6.0, atol=1e-12)
    assert moved.cross(lines).counts.sum() == (uv[:, 0] >= 0.5).sum()


def test_a_large_grid_is_bounded_in_blocks(make_spline, monkeypatch):
    from surfel.bounding import rays

    spline = make_spline()
    whole = rays.Sheet.of(spline.coefficients, spline.trim)
    monkeypatch.setattr(rays, "_NETS", 10)
    for one, other in zip(whole, rays.Sheet.of(spline.coefficients, spline.trim), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)


def test_a_sheet_has_no_inside(make_spline):
    sheet = make_spline().sheet()
    assert isinstance(sheet, SplineSheet) and not sheet.solid
    with pytest.raises(InputError, match="sheet"):
        sheet.contains([[0.0, 0.0, 0.0]])


def test_measure_gives_the_area(make_spline):
    spline = make_spline(occupancy=RAGGED, **PLACED)
    measured = surfel.measure(spline.sheet(), lines=4096)
    assert abs(measured.area.value / spline.sheet().area - 1.0) < 1e-3
    assert measured.volume is None
