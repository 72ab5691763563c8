"""Lines through polynomial surfaces: every crossing is one, none is missed, and each knows in from out."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import surfel
from polynomials_with_truth import (
    X,
    Y,
    Z,
    barth_sextic,
    chebyshev,
    cyclide,
    dense,
    heart,
    rounded_cube,
    sphere,
    torus,
)
from surfel import Box, Polynomial, Sphere
from surfel._numba import threads_for
from surfel.lines.models import lines_through_ball
from surfel.lines.sequences import unit_points


def lines_round(shape, n, seed=0):
    low, high = shape.bounds
    points = (unit_points("r4", 0, n) + np.random.default_rng(seed).random(4)) % 1.0
    return lines_through_ball(points, 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)))


def places(lines, hits):
    return lines.origins[hits.lines] + hits.t[:, None] * lines.directions[hits.lines]


def inner_counts(poly, lines, chords, inverse, samples=2000):
    """How often the polynomial changes its sign between many places of each chord: a lower bound."""
    found = np.zeros(len(lines), int)
    for line in range(len(lines)):
        for start in range(chords.offsets[line], chords.offsets[line + 1], 2):
            t = np.linspace(*chords.t[start : start + 2], samples)
            world = lines.origins[line] + t[:, None] * lines.directions[line]
            values = poly.at(world @ inverse[:, :3].T + inverse[:, 3])
            found[line] += np.count_nonzero((values[1:] < 0.0) != (values[:-1] < 0.0))
    return found


SURFACES = {
    "sphere": (sphere(), Box(2.5)),
    "torus": (torus(1.0, 0.4), Box((3.0, 3.0, 1.0))),
    "cyclide": (cyclide(1.0, 0.9, 0.6), Sphere(2.2)),
    "Barth sextic": (barth_sextic(), Sphere(1.6)),
    "heart": (heart(), Box(3.0)),
    "dense 6": (dense(6, 1), Sphere(1.0)),
    "rounded cube 20": (rounded_cube(20), Box(2.2)),
    "Chebyshev 12": (chebyshev(12), Box(2.0)),
    "in a tree": (torus(1.0, 0.4), Box(3.0) - Sphere(1.0)),
    "in a shifted ball": (barth_sextic(), Sphere(1.0).translated((0.7, -0.2, 0.4))),
}


@pytest.mark.parametrize("name", SURFACES)
def test_a_sheet_is_crossed_where_the_polynomial_changes_its_sign(name):
    poly, within = SURFACES[name]
    shape = Polynomial(poly, within, capped=False)
    lines = lines_round(shape, 400)
    hits, around = shape.cross(lines), within.cross(lines)
    seen = inner_counts(poly, lines, around, np.eye(4)[:3])
    assert hits.counts.sum() > 40
    assert np.all(hits.counts >= seen)
    assert np.count_nonzero(hits.counts != seen) <= 4  # samples may pass over a pair
    assert np.all((hits.counts - seen) % 2 == 0)


@pytest.mark.parametrize("name", SURFACES)
def test_every_crossing_lies_on_the_surface(name):
    poly, within = SURFACES[name]
    shape = Polynomial(poly, within, capped=False)
    lines = lines_round(shape, 5000)
    hits = shape.cross(lines)
    points = places(lines, hits)
    value, gradient = poly.at(points), poly.gradient(points)
    slope = np.linalg.norm(gradient, axis=1)
    rounding = 1e-14 * poly.size(points)
    assert np.all(np.abs(value) <= 1e-12 * slope + rounding)
    cosine = np.einsum("ij,ij->i", lines.directions[hits.lines], gradient) / slope
    clear = slope > 1e-4 * slope.max()
    assert np.abs(cosine - hits.cosine)[clear].max() < 1e-7


@pytest.mark.parametrize("name", SURFACES)
def test_a_capped_solid_is_entered_and_left_in_turn(name):
    poly, within = SURFACES[name]
    shape = Polynomial(poly, within)
    lines = lines_round(shape, 5000)
    hits = shape.cross(lines)
    place = np.arange(len(hits.t)) - hits.offsets[hits.lines]
    assert len(hits.t) > 500
    assert np.all(hits.counts % 2 == 0)
    assert np.array_equal(hits.cosine < 0.0, place % 2 == 0)
    assert np.all(hits.t[1::2] >= hits.t[::2])
    middle = (
        lines.origins[hits.lines[::2]] + 0.5 * (hits.t[::2] + hits.t[1::2])[:, None] * lines.directions[hits.lines[::2]]
    )
    assert np.mean(poly.at(middle) < 1e-13 * poly.size(middle)) == 1.0
    assert np.mean(shape.contains(middle)) > 0.999


def random_map(rng):
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ np.diag(np.exp(rng.uniform(-1.5, 1.5, 3))) @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    matrix[:3, 3] = rng.uniform(-5.0, 5.0, 3)
    return matrix


@pytest.mark.parametrize("capped", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_any_affine_map_moves_the_crossings_along(seed, capped):
    rng = np.random.default_rng(seed)
    poly, within = SURFACES[["Barth sextic", "torus", "in a tree", "dense 6"][seed]]
    matrix = random_map(rng)  # mirrored ones among them
    inverse = np.linalg.inv(matrix)[:3]
    shape = Polynomial(poly, within, capped)
    local = lines_round(shape, 3000)
    moved = surfel.Lines.of(
        local.origins @ matrix[:3, :3].T + matrix[:3, 3], local.directions @ matrix[:3, :3].T, local.weights
    )
    here, there = shape.cross(local), shape.transformed(matrix).cross(moved)
    same = here.counts == there.counts
    assert np.count_nonzero(~same) <= 1  # a line that touches
    rows, stretch = same[here.lines], np.linalg.norm(local.directions @ matrix[:3, :3].T, axis=1)
    t = there.t[same[there.lines]]
    assert np.abs(t - here.t[rows] * stretch[here.lines[rows]]).max() < 1e-9 * max(1.0, np.abs(t).max())
    # cosines on the polynomial's own surface: against the gradient of p(A x + b), by differences
    points = places(moved, there)
    size = 1e-5 * np.linalg.norm(matrix[:3, :3], 2)

    def value(world):
        return poly.at(world @ inverse[:, :3].T + inverse[:, 3])

    steps = size * np.eye(3)
    gradient = np.stack([(value(points + s) - value(points - s)) / (2.0 * size) for s in steps], axis=1)
    norm = np.linalg.norm(gradient, axis=1)
    own = np.abs(value(points)) < 1e-10 * poly.size(points @ inverse[:, :3].T + inverse[:, 3])
    clear = own & (norm > 0.05 * np.median(norm[own]))
    expected = np.einsum("ij,ij->i", moved.directions[there.lines], gradient) / norm
    assert np.count_nonzero(clear) > 200
    assert np.abs(expected - there.cosine)[clear].max() < 1e-4


def test_lines_that_touch_a_sphere_cross_it_twice_or_never():
    shape = Polynomial(sphere(), Box(3.0))
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((4000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.cross(normal, rng.standard_normal((4000, 3)))
    for gap, counts in ((0.0, {0, 2}), (1e-7, {0}), (-1e-7, {2})):
        hits = shape.cross(surfel.Lines.of((1.0 + gap) * normal, along, 1.0))
        assert set(hits.counts.tolist()) <= counts
    exact = shape.cross(surfel.Lines.of([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 1.0))
    assert exact.counts.tolist() == [0, 0]  # from outside


def test_a_surface_on_the_boundary_of_within_counts_once_or_not_at_all():
    lines = lines_round(Polynomial(X, Box(1.0)), 3000)
    box = Box(1.0).cross(lines)
    for poly, whole in ((X - 0.5, True), (0.5 - X, False), (-0.5 - X, True), (X + 0.5, False)):
        hits = Polynomial(poly, Box(1.0)).cross(lines)  # the box itself, or nothing
        assert hits.counts.tolist() == (box.counts if whole else 0 * box.counts).tolist()
        if whole:
            assert np.abs(hits.t - box.t).max() < 1e-14
    sheet = Polynomial(0.5 - X, Box(1.0), capped=False).cross(lines)
    assert sheet.counts.sum() == 0


def test_a_line_in_the_surface_does_not_cross_it():
    saddle = Polynomial(X * Y - Z, Box(2.0))
    lines = surfel.Lines.of([[0.0, 0.3, 0.0], [0.2, 0.0, 0.0]], [[1.0, 0.0, 0.3], [0.0, 1.0, 0.2]], 1.0)
    assert saddle.cross(lines).counts.tolist() == [0, 0]
    above = surfel.Lines.of([[0.0, 0.3, 1e-6]], [[1.0, 0.0, 0.3]], 1.0)
    assert saddle.cross(above).counts.tolist() == [2]


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
def test_origins_far_away_cost_no_more_digits_than_they_have(distance):
    shape = Polynomial(barth_sextic(), Sphere(1.6))
    near = lines_round(shape, 2000)
    far = surfel.Lines.of(near.origins - distance * near.directions, near.directions, near.weights)
    a, b = shape.cross(near), shape.cross(far)
    same = a.counts == b.counts
    assert np.mean(same) > 1.0 - 1e-2 * (distance / 1e9) ** 0.5 - 2e-3
    error = np.abs(b.t[same[b.lines]] - distance - a.t[same[a.lines]])
    assert np.quantile(error, 0.99) < 1e-14 * distance
    assert np.all(b.counts % 2 == 0)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e4, 1e12])
def test_units_do_not_matter(scale):
    unit = Polynomial(barth_sextic(), Sphere(1.6))
    stretched = {key: c * scale ** -sum(key) for key, c in barth_sextic().items()}
    shape = Polynomial(stretched, Sphere(1.6 * scale))
    lines = lines_round(unit, 2000)
    large = surfel.Lines(lines.origins * scale, lines.directions, lines.weights)
    a, b = unit.cross(lines), shape.cross(large)
    assert np.count_nonzero(a.counts != b.counts) <= 1
    if np.array_equal(a.counts, b.counts):
        assert np.abs(a.t - b.t / scale).max() < 1e-9


def test_terms_far_from_the_origin_are_moved_there_exactly():
    place = (37.25, -11.0, 1024.0)
    moved = Polynomial(sphere(1.0, place), Box(2.5).translated(place))  # its constant term is 1e6
    here = Polynomial(sphere(), Box(2.5))
    lines = lines_round(here, 2000)
    there = surfel.Lines(lines.origins + np.array(place), lines.directions, lines.weights)
    a, b = here.cross(lines), moved.cross(there)
    assert np.array_equal(a.counts, b.counts)
    assert np.abs(a.t - b.t).max() < 1e-9  # lines themselves are rounded to 1e-13 there; some nearly touch
    assert np.median(np.abs(a.t - b.t)) < 1e-12


@pytest.mark.parametrize("degree", [21, 26, 40])
def test_beyond_degree_twenty_a_line_is_cut_to_pieces(degree):
    poly = X**degree + Y ** (degree - degree % 2) + Z ** (degree - degree % 2) - 1.0
    shape = Polynomial(poly, Box(2.2), capped=False)
    lines = lines_round(shape, 300)
    hits = shape.cross(lines)
    seen = inner_counts(poly, lines, Box(2.2).cross(lines), np.eye(4)[:3])
    assert np.array_equal(hits.counts, seen)
    points = places(lines, hits)
    assert np.abs(poly.at(points) / np.linalg.norm(poly.gradient(points), axis=1)).max() < 1e-13


def test_a_wave_of_degree_thirty_has_all_its_crossings():
    comb = np.polynomial.chebyshev.cheb2poly([0.0] * 30 + [1.0])
    shape = Polynomial({(k, 0, 0): c for k, c in enumerate(comb.tolist())}, Box(2.0), capped=False)
    hits = shape.cross(surfel.Lines.of([[0.0, 0.1, 0.2]], [[1.0, 0.0, 0.0]], 1.0))
    truth = np.sort(np.cos((np.arange(30) + 0.5) * np.pi / 30))
    assert hits.counts.tolist() == [30]
    assert np.abs(hits.t - truth).max() < 1e-7  # what rounding leaves of powers of degree thirty


def test_no_lines_and_lines_that_miss():
    shape = Polynomial(sphere(), Box(3.0))
    none = shape.cross(surfel.Lines(np.empty((0, 3)), np.empty((0, 3)), np.empty(0)))
    assert none.offsets.tolist() == [0]
    missed = shape.cross(surfel.Lines.of([[9.0, 9.0, 9.0]], [[1.0, 0.0, 0.0]], 1.0))
    assert missed.offsets.tolist() == [0, 0]


def test_the_same_bits_on_one_and_two_threads_and_whatever_lines_are_beside():
    shape = Polynomial(barth_sextic(), Sphere(1.6))
    lines = lines_round(shape, 6000)
    many = shape.cross(lines)
    with threads_for(10**6, threads=1):
        one = shape.cross(lines)
    assert np.array_equal(many.t, one.t)
    assert np.array_equal(many.cosine, one.cosine)
    some = shape.cross(surfel.Lines(lines.origins[7:300], lines.directions[7:300], lines.weights[7:300]))
    rows = slice(many.offsets[7], many.offsets[300])
    assert np.array_equal(some.t, many.t[rows])


def test_a_pickled_polynomial_is_the_same():
    shape = Polynomial(torus(1.0, 0.4), Box(3.0), capped=False)
    lines = lines_round(shape, 500)
    first = shape.cross(lines)
    other = pickle.loads(pickle.dumps(shape))
    assert other.terms == shape.terms
    assert not other.capped
    assert np.array_equal(other.cross(lines).t, first.t)
