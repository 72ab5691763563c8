"""Rays meet the surface where dense sampling says so, to rounding; touching counts once; the trim is kept."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import NdBSpline

from surfel import InputError, Lines
from surfel.bounding.roots import STACK, WIDTH

SKEW = (0.3, -0.5, 0.8)


def random_rays(spline, count, seed=0):
    """Return rays from all around to places on the surface."""
    rng = np.random.default_rng(seed)
    target = spline.sheet().patches(4096).points[rng.integers(0, 4096, count)]
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return target - 7.0 * directions, directions


def residuals(spline, origins, directions, hits):
    points = origins[hits.lines] + hits.t[:, None] * directions[hits.lines]
    uv, heights = spline.to_domain(points)
    uv = np.clip(uv, 0.0, spline.frame.cells)  # a hit on the outermost line may be rounded over it
    return spline(uv, trimmed=False) - heights


def bernstein(function):
    """Return the seven Bernstein coefficients of a polynomial of degree six."""
    s = np.linspace(0.0, 1.0, 7)
    binomial = np.array([1, 6, 15, 20, 15, 6, 1])
    basis = binomial * s[:, None] ** np.arange(7) * (1 - s[:, None]) ** (6 - np.arange(7))
    return np.linalg.solve(basis, function(s))


@pytest.fixture
def plain_kernels(monkeypatch):
    """Run the kernels as Python, so that they can be called."""
    from surfel.bounding import roots

    for name, value in list(vars(roots).items()):
        if hasattr(value, "py_func"):
            monkeypatch.setattr(roots, name, value.py_func)
    monkeypatch.setattr(roots, "times_plus", lambda x, y, z: x * y + z)
    return roots.zeros


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda s: s - 0.3, [0.3]),
        (lambda s: (s - 0.25) * (s - 0.5), [0.25, 0.5]),
        (lambda s: (s - 0.6) ** 2, [0.6]),
        (lambda s: (s - 0.6) ** 2 + 1e-3, []),
        (lambda s: (s - 0.5) ** 2 * (s - 0.8), [0.5, 0.8]),
        (lambda s: -((s - 0.375) ** 4), [0.375]),
        (lambda s: np.prod([s - r for r in (0.1, 0.2, 0.4, 0.6, 0.7, 0.9)], axis=0), [0.1, 0.2, 0.4, 0.6, 0.7, 0.9]),
        (lambda s: s * (1.0 - s), [0.0, 1.0]),
        (lambda s: 0.0 * s, [0.0]),
        (lambda s: 1.0 + s, []),
    ],
)
def test_polynomials_with_known_zeros(function, expected, plain_kernels):
    out = np.empty(8)
    count, _ = plain_kernels(bernstein(function), 1e-13, False, np.empty((STACK, WIDTH)), out)
    assert count == len(expected)
    np.testing.assert_allclose(out[:count], expected, atol=2e-3 if len(expected) == 1 else 1e-9)


def test_random_polynomials_have_the_zeros_of_their_companion_matrix(plain_kernels):
    binomial, out = np.array([1, 6, 15, 20, 15, 6, 1]), np.empty(8)
    rise, fall = np.polynomial.Polynomial([0.0, 1.0]), np.polynomial.Polynomial([1.0, -1.0])
    rng = np.random.default_rng(6)
    counts = set()
    for _ in range(300):
        c = rng.normal(size=7)
        roots = sum(b * x * rise**k * fall ** (6 - k) for k, (b, x) in enumerate(zip(binomial, c, strict=True))).roots()
        expected = np.sort(roots[(abs(roots.imag) < 1e-9) & (roots.real >= 0.0) & (roots.real <= 1.0)].real)
        count, _ = plain_kernels(c, 1e-14, False, np.empty((STACK, WIDTH)), out)
        assert count == len(expected)
        np.testing.assert_allclose(out[:count], expected, atol=1e-11)
        counts.add(count)
    assert {0, 1, 2, 3} <= counts


def test_one_change_of_sign_is_told_from_the_bits(plain_kernels):
    from surfel.bounding.roots import change_once

    for code in range(3**7):
        signs = np.array([code // 3**k % 3 - 1 for k in range(7)])
        bits = sum(int(s > 0) << k | int(s < 0) << (8 + k) for k, s in enumerate(signs))
        expected = (signs != 0).all() and np.count_nonzero(np.diff(signs)) <= 1
        assert bool(change_once(bits)) == expected  # none at all is looked for before


@pytest.mark.parametrize("direction", [(0, 0, 1), SKEW])
@pytest.mark.parametrize("side", ["above", "below"])
def test_hits_are_those_of_dense_sampling(make_spline, direction, side):
    spline = make_spline(direction=direction, side=side, low=(-3.0, 2.0), scale=(2.0, 0.5))
    origins, directions = random_rays(spline, 150)
    hits = spline.intersect((origins, directions), "all")
    reference = NdBSpline(tuple(np.arange(-3.0, k + 3.0) for k in spline.shape), np.array(spline.coefficients), 3)
    t = np.linspace(0.0, 60.0, 40_001)
    missed = 0
    for line in range(len(origins)):
        uv, heights = spline.to_domain(origins[line] + t[:, None] * directions[line])
        inside = ((uv >= 0.0) & (uv <= spline.frame.cells)).all(axis=1)
        gap = reference(uv[inside]) - heights[inside]
        expected = t[inside][:-1][np.sign(gap[1:]) != np.sign(gap[:-1])]
        found = hits.t[hits.offsets[line] : hits.offsets[line + 1]]
        if len(found) != len(expected):
            missed += 1
        else:
            np.testing.assert_allclose(found, expected, atol=2e-3)
    assert missed == 0
    scale = np.ptp(spline.coefficients)
    assert np.abs(residuals(spline, origins, directions, hits)).max() <= 1e-13 * scale


def test_ten_thousand_rays_have_the_residual_of_rounding(make_spline):
    spline = make_spline(np.random.default_rng(1).normal(size=(22, 22)), direction=SKEW)
    origins, directions = random_rays(spline, 10_000)
    for which in ("first", "all"):
        hits = spline.intersect((origins, directions), which)
        assert len(np.unique(hits.lines)) == 10_000
        assert np.abs(residuals(spline, origins, directions, hits)).max() <= 1e-12 * np.ptp(spline.coefficients)


def test_the_first_hit_is_the_first_of_all(make_spline):
    spline = make_spline()
    rays = random_rays(spline, 2000)
    first, every = spline.intersect(rays), spline.intersect(rays, "all")
    np.testing.assert_array_equal(first.lines, np.unique(every.lines))
    np.testing.assert_array_equal(first.t, every.t[every.offsets[:-1][every.counts > 0]])
    assert (np.diff(every.t)[np.diff(every.lines) == 0] > 0.0).all()


def test_a_line_that_touches_is_one_hit_with_the_place_known_well(make_spline):
    spline = make_spline(np.random.default_rng(2).normal(size=(14, 12)))
    rng = np.random.default_rng(3)
    uv = rng.uniform(0.5, 9.5, (2000, 2))
    slope, bend = spline.gradient(uv), spline.hessian(uv)
    aside = rng.normal(size=(2000, 2))
    aside /= np.linalg.norm(aside, axis=1)[:, None]
    curved = np.abs(np.einsum("ki,kij,kj->k", aside, bend, aside)) > 0.05  # else the contact is of a higher order
    along = np.column_stack([aside, np.einsum("ki,ki->k", aside, slope)])[curved]
    along /= np.linalg.norm(along, axis=1)[:, None]
    origins = np.column_stack([uv, spline(uv)])[curved] - 0.4 * along
    hits = spline.intersect((origins, along), "all")
    near = np.abs(hits.t - 0.4) < 1e-6
    np.testing.assert_array_equal(np.bincount(hits.lines[near], minlength=len(origins)), 1)
    assert np.abs(residuals(spline, origins, along, hits)).max() <= 1e-12 * np.ptp(spline.coefficients)


def test_transversal_hits_are_known_to_twelve_digits(make_spline):
    spline = make_spline()
    rng = np.random.default_rng(4)
    uv = rng.uniform([0.0, 0.0], spline.frame.cells, (3000, 2))
    target = np.column_stack([uv, spline(uv)])
    normal = spline.normal(uv)
    directions = rng.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    steep = np.abs(np.einsum("ij,ij->i", normal, directions)) > 0.2
    origins = target - 5.0 * directions
    hits = spline.intersect((origins[steep], directions[steep]), "all")
    best = np.full(steep.sum(), np.inf)
    np.minimum.at(best, hits.lines, np.abs(hits.t - 5.0))
    assert best.max() <= 1e-12 * np.ptp(spline.coefficients)


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        ((2.0, 3.0, 9.0), (0.0, 0.0, -1.0), [7.0]),  # down through a corner of cells
        ((2.5, 3.0, -9.0), (0.0, 0.0, 2.0), [11.0]),  # up along a line between cells, direction not a unit vector
        ((0.0, 0.0, 9.0), (0.0, 0.0, -1.0), [7.0]),  # the corner of the domain
        ((8.0, 6.0, 9.0), (0.0, 0.0, -1.0), [7.0]),
        ((4.0, 3.0, 9.0), (0.0, 0.0, 1.0), []),  # away
        ((4.0, 3.0, 2.0), (0.0, 0.0, 1.0), [0.0]),  # from the surface itself
        ((-1.0, 3.0, 2.0), (1.0, 0.0, 0.0), [1.0]),  # along the surface: once, where it begins
        ((-1.0, -1.0, 3.0), (1.0, 1.0, -0.5), [3.0]),  # along the diagonal of cells, hits at (1, 1)
        ((9.0, 3.0, 9.0), (0.0, 0.0, -1.0), []),  # beside the domain
    ],
)
def test_rays_on_a_flat_surface(make_spline, origin, direction, expected):
    spline = make_spline(np.full((11, 9), 2.0))
    hits = spline.intersect(([origin], [direction]), "all")
    np.testing.assert_allclose(hits.t, expected, atol=1e-12)


def test_far_origins_cost_no_more_digits_than_their_own(make_spline):
    spline = make_spline()
    uv = np.random.default_rng(0).uniform(1.0, 5.0, (500, 2))
    origins = np.column_stack([uv, np.full(500, 1e6)])
    hits = spline.intersect((origins, np.tile([0.0, 0.0, -1.0], (500, 1))))
    np.testing.assert_allclose(1e6 - hits.t, spline(uv), atol=1e-9)


def test_the_trimmed_part_is_not_hit(make_spline):
    occupancy = np.zeros((8, 6), np.uint8)
    occupancy[2:5, 1:4] = 15
    spline = make_spline(np.full((11, 9), 2.0), occupancy=occupancy)
    uv = np.random.default_rng(5).uniform([0.0, 0.0], [8.0, 6.0], (4000, 2))
    rays = np.column_stack([uv, np.full(4000, 5.0)]), np.tile([0.0, 0.0, -1.0], (4000, 1))
    hit = spline.intersect(rays).counts > 0
    np.testing.assert_array_equal(hit, ((uv >= [2, 1]) & (uv <= [5, 4])).all(axis=1))
    np.testing.assert_array_equal(hit, spline.occludes(rays))
    assert not spline.occludes(rays, 2.9).any()
    np.testing.assert_array_equal(spline.occludes(rays, np.where(uv[:, 0] > 3.0, 3.1, 2.9)), hit & (uv[:, 0] > 3.0))


def test_threads_and_parts_give_the_same_bits(make_spline):
    spline = make_spline()
    origins, directions = random_rays(spline, 6000)
    whole = spline.intersect((origins, directions), "all")
    half = [spline.intersect((origins[i::2], directions[i::2]), "all") for i in (0, 1)]
    for i in (0, 1):
        np.testing.assert_array_equal(half[i].t, whole.t[whole.lines % 2 == i])


@pytest.mark.parametrize(
    ("rays", "said"),
    [
        (5.0, "pair"),
        (([[0, 0, 0]], [[0, 0, 0]]), "none of them zero"),
        (([[0, 0, np.nan]], [[0, 0, 1]]), "finite"),
        (([[0, 0, 0]], [[0, 0, 1], [1, 0, 0]]), "shape"),
    ],
)
def test_bad_rays_are_refused(make_spline, rays, said):
    with pytest.raises(InputError, match=said):
        make_spline().intersect(rays)


def test_other_bad_arguments_are_refused(make_spline):
    spline, rays = make_spline(), ([[0, 0, 9]], [[0, 0, -1]])
    with pytest.raises(InputError, match="first, all"):
        spline.intersect(rays, "last")
    for length in (-1.0, np.nan, [1.0, 2.0], "far"):
        with pytest.raises(InputError, match="length"):
            spline.occludes(rays, length)


def test_lines_are_rays_from_their_origins_and_no_rays_have_no_hits(make_spline):
    spline = make_spline(np.full((11, 9), 2.0))
    lines = Lines.of([[1, 1, 9], [1, 1, -9]], [[0, 0, -1], [0, 0, -1]], 1.0)
    assert spline.intersect(lines).counts.tolist() == [1, 0]
    assert spline.sheet().cross(lines).counts.tolist() == [1, 1]
    assert len(spline.intersect((np.empty((0, 3)), np.empty((0, 3))))) == 0
