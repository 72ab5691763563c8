"""Planted noise, strays, duplicates, leaks and zero normals, found again within a fifth."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel


def _measured(points, lines=8192, **options):
    return surfel.measure(surfel.Surfels(points, **options), lines=lines)


@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("shape", [truth.sphere, truth.torus])
def test_noise(shape, sigma):
    cloud = shape(6000, 7)
    m = _measured(cloud.noisy(sigma, 8), lines=16)
    assert m.noise == pytest.approx(sigma, rel=0.2)
    assert m.area.reliable == (sigma < 0.6)  # and above that nothing is promised
    if m.area.reliable:
        assert m.area.value == pytest.approx(cloud.area, rel=0.005 + 0.03 * sigma)
    assert any("spacings" in text for text in m.warnings) == (sigma > 0.1)


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_leak_of_a_sphere_without_a_cap(share):
    # Where an invariant line meets a sphere are two independent uniform points of it: odd with 2 f (1 - f), missed f^2.
    m = _measured(truth.capless_sphere(8000, share, 3).points, lines=16_384)
    assert m.leak == pytest.approx(2.0 * share / (1.0 + share), rel=0.2)
    assert not m.closed and m.volume is None
    assert any("solid=True" in text for text in m.warnings)


def test_a_leaky_scan_that_is_said_to_be_a_solid_has_a_volume_that_is_not_trusted():
    m = _measured(truth.capless_sphere(8000, 0.02, 3).points, solid=True)
    assert m.volume.value == pytest.approx(4 * np.pi / 3, rel=0.1)
    assert not m.volume.reliable and "open" in m.volume.reason
    assert not m.closed


def test_a_closed_cloud_does_not_leak():
    for shape in (truth.sphere, truth.torus, truth.box, truth.cylinder):
        m = _measured(shape(6000, 3).points)
        assert m.closed and m.leak < 0.01


def _strays(cloud, count, seed):
    """Return points at least ten spacings from the surface, in a box of five times its radius."""
    places = np.random.default_rng(seed).uniform(-2.5, 2.5, (4 * count, 3))
    away = np.array([np.linalg.norm(cloud.points - place, axis=1).min() for place in places])
    return places[away > 10.0 * cloud.spacing][:count]


@pytest.mark.parametrize("count", [2, 12, 60, 300])
def test_strays_are_counted_and_do_not_count(count):
    ball = truth.sphere(6000, 5)
    m = _measured(np.concatenate([ball.points, _strays(ball, count, 6)]))
    assert m.cleaning["strays"] == pytest.approx(count, rel=0.2)
    assert m.area.value == pytest.approx(ball.area, rel=0.01) and m.area.reliable
    assert m.volume.value == pytest.approx(ball.volume, rel=0.01)
    assert any("belong to no surface" in text for text in m.warnings)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_duplicates(share):
    points = truth.torus(3000, 5).points
    again = points[: int(share * 3000)]
    m = _measured(np.concatenate([points, again]), lines=16)
    assert m.cleaning["duplicates"] == len(again)
    assert m.points == 3000 + len(again)


def test_rows_that_are_not_finite():
    ball = truth.sphere(4000, 5)
    points = ball.points.copy()
    points[::20, 1], points[5::200] = np.nan, np.inf
    m = _measured(points, normals=ball.normals)
    assert m.cleaning["non_finite"] == 220 and m.points == 4000
    assert m.area.value == pytest.approx(ball.area, rel=0.01)
    assert m.volume.value == pytest.approx(ball.volume, rel=0.01)


@pytest.mark.parametrize("share", [0.03, 0.5, 1.0])
def test_zero_normals_are_counted_and_found(share):
    ring = truth.torus(4000, 5)
    normals = ring.normals.copy()
    normals[: int(4000 * share)] = 0.0
    m = _measured(ring.points, normals=normals)
    assert m.cleaning["without_normal"] == int(4000 * share)
    assert m.area.value == pytest.approx(ring.area, rel=0.005)
    assert m.volume.value == pytest.approx(ring.volume, rel=0.01)
    lengths = np.linalg.norm(surfel.Surfels(ring.points, normals=normals).patches().normals, axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-9)


@pytest.mark.parametrize(("points", "reason"), [(60, "only 60 points"), (150, "150 points are too few to be halved")])
def test_why_few_points_are_not_trusted(points, reason):
    area = _measured(truth.sphere(points, 5).points, lines=16).area
    assert not area.reliable and area.reason.startswith(reason)
    assert "a lot" not in area.reason


def test_halves_that_disagree_are_the_reason_where_they_were_taken():
    stars = np.random.default_rng(3).standard_normal((250, 1)) * truth.sphere(250, 5).points
    area = _measured(stars, lines=16).area
    assert not area.reliable and "halving it changes the area a lot" in area.reason


def test_spacing():
    for n in (2000, 8000):
        cloud = truth.sphere(n, 5)
        assert _measured(cloud.points, lines=16).spacing == pytest.approx(cloud.spacing, rel=0.1)


def test_plates_nearer_than_the_spacing_are_said_to_be_two():
    rng = np.random.default_rng(5)
    flat = np.column_stack([rng.random((6000, 2)), np.zeros(6000)])
    flat[3000:, 2] = 0.5 * np.sqrt(1.0 / 3000)
    found = surfel.measure(surfel.Surfels(flat), lines=1024).area
    assert not found.reliable
    assert "two sheets" in found.reason


def test_ambiguous_signs_are_told_and_sure_ones_are_not():
    rng = np.random.default_rng(6)
    angle, across = rng.uniform(0.0, 2.0 * np.pi, 6000), rng.uniform(-0.4, 0.4, 6000)
    out = 1.0 + across * np.cos(0.5 * angle)  # a Moebius strip has no outside
    strip = np.column_stack([out * np.cos(angle), out * np.sin(angle), across * np.sin(0.5 * angle)])
    surface = surfel.Surfels(strip).surface
    assert surface.ambiguous_signs == 0.0  # nobody has asked for signs yet
    conflict = surface.orientation.conflict
    assert conflict > 0.0
    sphere = surfel.measure(surfel.Surfels(truth.sphere(3000, 1).points), lines=1024)
    assert not any("ambiguous" in text for text in sphere.warnings)
    box = rng.standard_normal((3000, 3))  # a cloud without a surface
    assert any("ambiguous" in text for text in surfel.measure(surfel.Surfels(box), lines=1024).warnings)


def test_noise_that_hides_a_thin_shape_is_not_given_as_an_area():
    """Points in a ball show no surface, whatever is read as their noise."""
    rng = np.random.default_rng(8)
    inside = truth.sphere(4000, 6).points * rng.random((4000, 1)) ** (1.0 / 3.0)
    assert not _measured(inside, lines=16).area.reliable
