"""Integrals along lines against quadrature, and the moments that they add up to."""

from __future__ import annotations

import numpy as np
import pytest

import naive
from surfel import Crossings, Lines
from surfel.measuring.line_sums import COLUMNS, inertia_tensor, moments_of, set_sums


def _crossings(rows, weights=None):
    t = np.concatenate([np.asarray(r, float) for r in rows])
    offsets = np.concatenate([[0], np.cumsum([len(r) for r in rows])])
    weight = np.ones(len(t)) if weights is None else np.concatenate(weights)
    return Crossings(offsets, t, np.zeros(len(t)), weight, np.zeros(len(t), np.int32))


def test_each_line_adds_its_hits_and_its_pieces_inside():
    rng = np.random.default_rng(0)
    counts = [0, 2, 4, 3, 1, 6]
    directions = rng.standard_normal((6, 3))
    lines = Lines.of(rng.standard_normal((6, 3)), directions, 1.0)
    events = [np.sort(rng.standard_normal(c)) for c in counts]
    hit_counts = [0, 5, 4, 3, 2, 9]
    weights = [rng.random(c) for c in hit_counts]
    hits = _crossings([np.sort(rng.standard_normal(c)) for c in hit_counts], weights)
    origin = np.array([0.3, -0.2, 0.9])
    values = set_sums(lines, hits, _crossings(events), _crossings(events), origin, 6)
    assert values.shape == (6, COLUMNS)
    for row, t in enumerate(events):
        assert values[row, 0] == pytest.approx(weights[row].sum())
        assert values[row, 1] == (len(t) > 0)
        assert values[row, 2] == len(t) % 2
        pieces = list(zip(t[::2], t[1::2], strict=True)) if len(t) % 2 == 0 else []
        expected = naive.moments_along(lines.origins[row] - origin, lines.directions[row], pieces)
        np.testing.assert_allclose(values[row, 3:13], expected, rtol=1e-12, atol=1e-14)
        assert values[row, 13] == len(t) % 2


def test_lines_through_a_ball_add_up_to_its_area_and_its_moments():
    rng = np.random.default_rng(1)
    n, radius, centre = 60_000, 1.5, np.array([0.4, 0.0, -0.3])
    two = rng.standard_normal((2, n, 3))  # chords of a ball of radius 3: two independent points of its sphere
    a, b = 3.0 * two / np.linalg.norm(two, axis=2, keepdims=True)
    lines = Lines.of(a, b - a, 1.0)
    rows = naive.sphere_hits(lines.origins - centre, lines.directions, radius)
    crossings = _crossings(rows)
    sums = set_sums(lines, crossings, crossings, crossings, np.zeros(3), 1)[0]
    found = moments_of(sums, n, 0.5 * np.pi * 4.0 * np.pi * 9.0)
    volume = 4.0 / 3.0 * np.pi * radius**3
    assert found.area == pytest.approx(4.0 * np.pi * radius**2, rel=0.02)
    assert found.volume == pytest.approx(volume, rel=0.02)
    place, tensor = inertia_tensor(found.volume, found.first, found.second)
    np.testing.assert_allclose(place, centre, atol=0.03)
    np.testing.assert_allclose(tensor, 0.4 * volume * radius**2 * np.eye(3), atol=0.03 * volume * radius**2)
    assert found.odd == 0.0
    assert found.hit == pytest.approx((radius / 3.0) ** 2, rel=0.02)


def test_even_lines_stand_for_odd_ones():
    lines = Lines.of(np.zeros((4, 3)), np.tile([0.0, 0.0, 1.0], (4, 1)), 1.0)
    whole = _crossings([[0, 1]] * 4)
    leaky = _crossings([[0, 1], [0, 1], [0], [0, 1]])
    ours, theirs = (moments_of(set_sums(lines, e, e, e, np.zeros(3), 1)[0], 4, 1.0) for e in (whole, leaky))
    assert theirs.volume == pytest.approx(ours.volume)
    assert theirs.odd == 0.25 and theirs.area < ours.area
    nothing = _crossings([[0]] * 4)
    assert moments_of(set_sums(lines, nothing, nothing, nothing, np.zeros(3), 1)[0], 4, 1.0).volume == 0.0


def test_pieces_that_are_known_of_odd_lines_count_as_they_are():
    lines = Lines.of(np.zeros((4, 3)), np.tile([0.0, 0.0, 1.0], (4, 1)), 1.0)
    leaky, pieces = _crossings([[0, 1], [0, 1], [0], [0, 1]]), _crossings([[0, 1], [0, 1], [0, 0.5], [0, 1]])
    ours = moments_of(set_sums(lines, leaky, leaky, pieces, np.zeros(3), 1)[0], 4, 1.0)
    whole = _crossings([[0, 1]] * 4)
    four = moments_of(set_sums(lines, whole, whole, whole, np.zeros(3), 1)[0], 4, 1.0)
    assert ours.volume == pytest.approx(3.5 / 4.0 * four.volume)
    assert ours.odd == 0.25


def test_the_inertia_tensor_is_about_the_centroid():
    rng = np.random.default_rng(2)
    points, mass = rng.standard_normal((50, 3)), rng.random(50)
    second = np.einsum("n,ni,nj->ij", mass, points, points)
    place, tensor = inertia_tensor(mass.sum(), mass @ points, second[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]])
    centre = mass @ points / mass.sum()
    d = points - centre
    expected = np.einsum("n,nij->ij", mass, (d**2).sum(axis=1)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None])
    np.testing.assert_allclose(place, centre)
    np.testing.assert_allclose(tensor, expected, rtol=1e-10)


def test_sets_and_leaves_are_kept_apart():
    rng = np.random.default_rng(3)
    lines = Lines.of(rng.standard_normal((12, 3)), rng.standard_normal((12, 3)), 1.0)
    rows = [np.sort(rng.standard_normal(count)) for count in rng.integers(0, 5, 12)]
    plain = _crossings(rows, [rng.random(len(row)) for row in rows])
    hits = Crossings(plain.offsets, plain.t, plain.cosine, plain.weight, rng.integers(0, 3, len(plain.t), np.int32))
    each = set_sums(lines, hits, hits, hits, np.zeros(3), 12, leaves=3)
    sums = set_sums(lines, hits, hits, hits, np.zeros(3), 3, leaves=3)
    np.testing.assert_allclose(sums, each.reshape(3, 4, -1).sum(axis=1))
    np.testing.assert_allclose(sums[:, COLUMNS:].sum(axis=1), sums[:, 0])
    assert each[0, COLUMNS + 1] == pytest.approx(hits.weight[: len(rows[0])][hits.leaf[: len(rows[0])] == 1].sum())
