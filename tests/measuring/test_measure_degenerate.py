"""Degenerate clouds: a sensible answer or one clear refusal, always ready for JSON, never a warning of numpy."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel

KEYS = {
    "points", "method", "lines", "area", "volume", "centroid", "inertia", "areas", "sides", "closed", "leak", "spacing",
    "noise", "seed", "seconds", "warnings",
}  # fmt: skip
BALL = truth.sphere(1200, 3).points
FLAT = truth.square(800, 3).points
FLOAT_MAX = 3.4028234663852886e38


def _line(n):
    return np.outer(np.random.default_rng(0).random(n), [1.0, 2.0, -0.5])


CLOUDS = {
    "empty": np.empty((0, 3)),
    "one": BALL[:1],
    "two": BALL[:2],
    "three": BALL[:3],
    "four": BALL[:4],
    "five": BALL[:5],
    "a handful": BALL[:12],
    "all equal": np.ones((40, 3)),
    "two places": np.repeat(BALL[:2], 30, axis=0),
    "collinear": _line(300),
    "collinear along an axis": np.outer(np.arange(300.0), [0.0, 1.0, 0.0]),
    "four collinear": _line(4),
    "coplanar": FLAT,
    "coplanar grid": np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), [0.0]), axis=-1).reshape(-1, 3),
    "cube grid": np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3),
    "not finite": np.full((9, 3), np.nan),
    "some not finite": np.where(np.arange(1200)[:, None] % 7 == 0, np.nan, BALL),
    "half doubled": np.concatenate([BALL, BALL[::2]]),
    "largest floats": BALL * FLOAT_MAX,
    "tiny": BALL * 1e-30,
    "very tiny": BALL * 1e-60,
    "far planes": np.concatenate([FLAT, FLAT + [0.0, 0.0, 1e6 * 0.035]]),
    "cube of noise": np.random.default_rng(1).random((600, 3)),
    "outlier at 1e6": np.concatenate([BALL, [[1e6, 0.0, 0.0]]]),
    "needle": BALL * [1.0, 1e-3, 1e-3],
    **{f"{n} points": truth.sphere(n, 1).points for n in (24, 25, 26, 99, 192, 193, 195, 196, 199, 200, 201)},
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", ["patches", "lines"])
@pytest.mark.parametrize("name", CLOUDS)
def test_any_cloud_is_measured_and_told(name, method):
    for solid in (None, True, False):
        cloud = surfel.Surfels(CLOUDS[name], solid=solid)
        m = surfel.measure(cloud, method=method, lines=512)
        told = m.to_dict()
        assert json.loads(json.dumps(told, allow_nan=False)) == told
        assert set(told) >= KEYS
        assert told["sides"] == "one" and told["method"] == method and told["points"] == len(CLOUDS[name])
        assert (solid is not False) or m.volume is None
        assert m.area.reliable != bool(m.area.reason)
        assert math.isinf(m.area.standard_error) or m.area.value >= 0.0
        assert m.closed in (True, False) and len(m.areas) == 1
        str(m)


@pytest.mark.parametrize("name", ["one", "two", "three", "all equal", "two places", "collinear",
                                  "collinear along an axis", "four collinear", "not finite"])  # fmt: skip
def test_where_there_is_no_surface_no_number_is_given(name):
    m = surfel.measure(surfel.Surfels(CLOUDS[name]))
    assert not m.area.reliable and math.isnan(m.area.value) and math.isinf(m.area.standard_error)
    assert "no surface" in m.area.reason and m.area.reason in m.warnings
    assert m.volume is None and not m.closed and m.lines == 0
    assert m.to_dict()["area"]["value"] is None


def test_an_empty_cloud_has_no_area_at_all():
    m = surfel.measure(surfel.Surfels(np.empty((0, 3))))
    assert m.area.value == 0.0 and m.warnings == ("the cloud is empty",)


@pytest.mark.parametrize("n", [12, 50, 99])
def test_a_handful_of_points_is_measured_but_not_trusted(n):
    m = surfel.measure(surfel.Surfels(truth.even_sphere(n, 1).points), lines=512)
    assert not m.area.reliable and f"only {n} points" in m.area.reason
    assert 0.2 * 4 * np.pi < m.area.value < 1.5 * 4 * np.pi
    low, high = m.area.interval()
    assert low < 4 * np.pi < high


def test_a_flat_cloud_is_open():
    m = surfel.measure(surfel.Surfels(FLAT), lines=2048)
    assert not m.closed and m.volume is None
    assert m.leak > 0.99
    assert m.area.value == pytest.approx(1.0, rel=0.03)


def test_a_flat_cloud_that_is_said_to_be_a_solid_has_no_volume_all_the_same():
    m = surfel.measure(surfel.Surfels(FLAT, solid=True), lines=2048)
    assert m.volume is None or not m.volume.reliable


@pytest.mark.parametrize("factor", [1e-30, FLOAT_MAX, 1e-60])
def test_extreme_scales_change_nothing_but_the_unit(factor):
    ours = surfel.measure(surfel.Surfels(BALL), lines=2048)
    theirs = surfel.measure(surfel.Surfels(BALL * factor), lines=2048)
    assert theirs.area.value == pytest.approx(ours.area.value * factor**2, rel=1e-9)
    assert theirs.area.standard_error == pytest.approx(ours.area.standard_error * factor**2, rel=1e-6)
    assert theirs.volume.value == pytest.approx(ours.volume.value * factor**3, rel=1e-6)
    assert theirs.volume.standard_error == pytest.approx(ours.volume.standard_error * factor**3, rel=1e-3)
    assert theirs.volume.reliable


@pytest.mark.parametrize("factor", [1e200, 1e120, 1e-120, 1e-200])
def test_scales_whose_cubes_no_float_holds_are_refused_with_the_cure(factor):
    with pytest.raises(surfel.InputError, match="scale"):
        surfel.measure(surfel.Surfels(BALL * factor))


def test_far_planes_are_both_counted_and_it_is_said_that_no_line_tells_more():
    m = surfel.measure(surfel.Surfels(CLOUDS["far planes"]), lines=512)
    assert m.area.value == pytest.approx(2.0, rel=0.05)
    assert m.volume is None and not m.closed


def test_points_all_through_a_cube_are_no_surface_to_be_trusted():
    m = surfel.measure(surfel.Surfels(np.random.default_rng(1).random((3000, 3))), lines=2048)
    assert not m.area.reliable


def test_the_odd_point_far_away_changes_little():
    m = surfel.measure(surfel.Surfels(CLOUDS["outlier at 1e6"]), lines=512)
    assert m.cleaning["strays"] == 1
    assert m.area.value == pytest.approx(4 * np.pi, rel=0.02)
