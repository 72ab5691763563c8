"""Torus and cyclide: closed forms against quadrature, known crossings, thin and thick tubes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from primitives_with_truth import lines_round, places, to_cyclide, to_torus
from surfel import Lines
from surfel.lines.models import lines_through_ball
from surfel.lines.sequences import unit_points

CYCLIDES = [(3.0, 2.9, 1.0), (1.0, 0.6, 0.9), (1.0, 0.8, 0.61), (1.0, 0.3, 0.97), (2.0, 2.0, 0.5), (1.0, 0.99999, 0.5)]


def quadrature(a, b, d, n=512):
    """Area and volume by the trapezoid rule over both angles, with tangents by their formulas: spectrally exact."""
    c = math.sqrt(a * a - b * b)
    q, p = np.meshgrid(*[np.arange(n) * 2.0 * np.pi / n] * 2, indexing="ij")
    whole = a - c * np.cos(q) * np.cos(p)
    x = (d * (c - a * np.cos(q) * np.cos(p)) + b * b * np.cos(q)) / whole
    y = b * np.sin(q) * (a - d * np.cos(p)) / whole
    z = b * np.sin(p) * (c * np.cos(q) - d) / whole
    points = np.stack([x, y, z])
    frequencies = np.fft.fftfreq(n, 1.0 / n)
    along = np.fft.ifft(1j * frequencies[:, None] * np.fft.fft(points, axis=1), axis=1).real
    round_ = np.fft.ifft(1j * frequencies * np.fft.fft(points, axis=2), axis=2).real
    normal = np.cross(along, round_, axis=0)
    step = (2.0 * np.pi / n) ** 2
    return np.linalg.norm(normal, axis=0).sum() * step, abs((points * normal).sum()) * step / 3.0


@pytest.mark.parametrize("sizes", CYCLIDES)
def test_area_and_volume_are_those_of_quadrature(sizes):
    shape = surfel.Cyclide(*sizes)
    area, volume = quadrature(*sizes)
    assert shape.area == pytest.approx(area, rel=1e-12)
    assert shape.volume == pytest.approx(volume, rel=1e-12)


def test_a_round_cyclide_is_a_torus():
    torus, cyclide = surfel.Torus(2.0, 0.5), surfel.Cyclide(2.0, 2.0, 0.5)
    assert cyclide.area == pytest.approx(torus.area, rel=1e-14)
    assert cyclide.volume == pytest.approx(torus.volume, rel=1e-14)
    lines = lines_round(np.asarray(torus.bounds), 2000)
    one, other = torus.cross(lines), cyclide.cross(lines)
    assert np.array_equal(one.offsets, other.offsets)
    assert np.array_equal(one.t, other.t)


def test_volume_of_a_nearly_round_thin_cyclide_keeps_its_digits():
    a, d = 1.0, 1e-3
    for c in (1e-4, 5e-4):
        b = math.sqrt(a * a - c * c)
        shape = surfel.Cyclide(a, b, d)
        # to the fourth order in c: the mean of the squared radius is d^2 + c^2 / 2, along an ellipse
        assert shape.volume == pytest.approx(2.0 * math.pi**2 * (d * d + 0.5 * c * c), rel=1e-5)


def test_lines_along_the_axes_hit_where_they_must():
    a, b, d = 3.0, 2.9, 1.0
    c = math.sqrt(a * a - b * b)
    lines = Lines.of(np.zeros((3, 3)), np.eye(3), 1.0)
    found = surfel.Cyclide(a, b, d).cross(lines)
    assert found.counts.tolist() == [4, 4, 0]
    along_x = [-a - d - c, -a + d + c, a - d + c, a + d - c]
    assert found.t[:4] == pytest.approx(along_x, abs=1e-14)
    assert found.cosine[:4] == pytest.approx([-1.0, 1.0, -1.0, 1.0], abs=1e-14)
    torus = surfel.Torus(3.0, 1.0).cross(lines)
    assert torus.t == pytest.approx([-4.0, -2.0, 2.0, 4.0] * 2, abs=1e-14)


def test_lines_in_the_planes_that_touch_along_circles():
    torus = surfel.Torus(2.0, 0.5)
    angle = np.linspace(0.0, np.pi, 50)
    directions = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(50)])
    for height, counts in ((0.5, (0, 2, 4)), (0.5 + 1e-14, (0,)), (0.5 - 1e-9, (4,)), (0.5 - 1e-5, (4,)), (0.0, (4,))):
        found = torus.cross(Lines.of(np.tile([0.3, 0.2, height], (50, 1)), directions, 1.0))
        assert set(found.counts.tolist()) <= set(counts)


@pytest.mark.parametrize("minor", [1e-3, 1e-6, 1e-9, 1e-12])
def test_thin_tubes_are_hit_where_they_are(minor):
    rng = np.random.default_rng(0)
    angle = rng.uniform(0.0, 2.0 * np.pi, 500)
    centres = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(500)])
    directions = rng.standard_normal((500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lines = Lines.of(centres - directions * rng.uniform(-1.0, 1.0, (500, 1)), directions, 1.0)
    found = surfel.Torus(1.0, minor)._cross_placed(lines, np.eye(4)[:3])
    assert (found.counts >= 2).mean() == 1.0
    # from the line to the surface; a wire of 1e-12 is as thin as a few hundred roundings of a coordinate
    assert np.abs(to_torus(1.0, minor)(places(lines, found))).max() <= 2e-15


@pytest.mark.parametrize("slack", [1e-3, 1e-6, 1e-9])
def test_cyclides_at_the_ends_of_their_range(slack):
    a, b = 1.0, 0.8
    for d in (0.6 + slack, 1.0 - slack):
        shape = surfel.Cyclide(a, b, d)
        lines = lines_round(np.asarray(shape.bounds), 20_000, seed=1)
        found = shape._cross_placed(lines, np.eye(4)[:3])
        assert (found.counts % 2 == 0).all()
        assert np.abs(to_cyclide(a, b, d)(places(lines, found))).max() <= 1e-12
        length = np.bincount(found.lines, np.sign(found.cosine) * found.t, len(lines)) * lines.weights
        assert length.sum() / (2.0 * np.pi) == pytest.approx(shape.volume, rel=0.03)


def test_the_samples_of_a_torus_stand_for_equal_areas():
    elements = surfel.Torus(2.0, 1.0).patches(1000)
    assert np.ptp(elements.areas) <= 1e-12 * elements.areas[0]
    assert np.ptp(surfel.Cyclide(1.0, 0.8, 0.61).patches(10_000).areas) <= 0.1 * elements.areas[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [
        surfel.Torus(3.0, 1.0),
        surfel.Cyclide(1.0, 0.6, 0.9),
        surfel.Cyclide(1.0, 0.8, 0.61),
        surfel.Ellipsoid((1, 2, 3)),
    ],
    ids=repr,
)
def test_the_limit_of_many_lines_is_the_closed_form(shape):
    low, high = np.asarray(shape.bounds)
    centre, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    areas, volumes = [], []
    for shift in np.random.default_rng(1).random((16, 4)):
        lines = lines_through_ball(unit_points("r4", 0, 1_000_000 // 16, shift=shift), centre, radius, "offset")
        found = shape.cross(lines)
        areas.append(lines.weights[found.lines].sum() / np.pi)
        volumes.append((lines.weights[found.lines] * np.sign(found.cosine) * found.t).sum() / (2.0 * np.pi))
    for values, true in ((areas, shape.area), (volumes, shape.volume)):
        error = np.std(values, ddof=1) / 4.0
        assert abs(np.mean(values) - true) <= 3.5 * error
        assert error <= 1e-3 * true
