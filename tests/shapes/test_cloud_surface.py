"""The surface of a cloud: patches in the order of the cloud, crossings, sheets, inside and outside."""

from __future__ import annotations

import numpy as np
import pytest

import naive
import shapes_with_truth as truth
import surfel
from surfel import Lines, Surfels
from surfel.lines.enclosing import smallest_ball
from surfel.lines.models import lines_through_ball
from surfel.lines.sequences import unit_points
from surfel.shapes.sheets import CloudCrossings


def _lines(points, count, seed=0):
    ball = smallest_ball(points).grown(0.3)
    shift = np.random.default_rng(seed).random(4)
    return lines_through_ball(unit_points("niederreiter", 0, count, 4, shift), ball.centre, ball.radius)


def test_patches_come_in_the_order_of_the_cloud():
    cloud = truth.torus(1500, 4)
    place = cloud.points + [5.0, 0.0, 0.0]
    order = np.random.default_rng(0).permutation(1500)
    ours, theirs = Surfels(place).patches(), Surfels(place[order]).patches()
    np.testing.assert_allclose(ours.points, place, atol=1e-12)
    np.testing.assert_allclose(theirs.areas, ours.areas[order], rtol=1e-9)
    assert ours.areas.sum() == pytest.approx(surfel.measure(Surfels(place), lines=16).area.value, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ours.normals, axis=1), 1.0, atol=1e-9)
    assert len(Surfels(np.empty((0, 3))).patches()) == 0


def test_what_was_left_out_has_no_area():
    points = truth.torus(1500, 4).points
    patches = Surfels(np.concatenate([points, points[:40]])).patches()
    doubled = patches.areas[:40] + patches.areas[1500:]
    np.testing.assert_allclose(doubled, Surfels(points).patches().areas[:40], rtol=1e-9)
    assert (np.minimum(patches.areas[:40], patches.areas[1500:]) == 0.0).all()


@pytest.mark.parametrize("given", [False, True])
def test_normals_of_patches_point_outward(given):
    cloud = truth.torus(2000, 4)
    patches = Surfels(cloud.points, normals=cloud.normals if given else None).patches()
    assert (np.einsum("ij,ij->i", patches.normals, cloud.normals) > 0.8).mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("shape", [truth.torus, truth.square, truth.crossing_squares])
def test_over_many_lines_the_weighted_count_is_the_sum_of_the_patches(shape):
    cloud = Surfels(shape(600, 3).points)
    expected = cloud.patches().areas.sum()
    found = []
    for seed in range(4):
        lines = _lines(cloud.points, 250_000, seed)
        found.append((lines.weights * cloud.cross(lines).weight_per_line()).sum() / np.pi)
    error = np.std(found, ddof=1) / 2.0
    assert abs(np.mean(found) - expected) < 4.0 * error + 1e-4 * expected
    assert error < 0.003 * expected


def test_the_weighted_count_of_a_small_cloud_is_the_sum_of_the_patches():
    cloud = Surfels(truth.box(400, 3).points)
    lines = _lines(cloud.points, 120_000)
    found = (lines.weights * cloud.cross(lines).weight_per_line()).sum() / np.pi
    assert found == pytest.approx(cloud.patches().areas.sum(), rel=0.003)


def test_lines_never_read_the_sum_of_the_patches(monkeypatch):
    from surfel.surface.patches import LocalPatches

    cloud = Surfels(truth.torus(1500, 4).points)
    before = surfel.measure(cloud, method="lines", lines=4096)
    monkeypatch.setattr(LocalPatches, "area", property(lambda self: 1.0))
    assert surfel.measure(cloud, method="lines", lines=4096).area.value == before.area.value


def test_sheets_lie_where_the_surface_is():
    cloud = Surfels(truth.even_sphere(4000, 3).points)
    lines = _lines(cloud.points, 3000)
    events = cloud._sheets(cloud.cross(lines))
    expected = naive.sphere_hits(lines.origins, lines.directions)
    wrong = 0
    for row, places in enumerate(expected):
        t = events.t[events.offsets[row] : events.offsets[row + 1]]
        closest = np.linalg.norm(np.cross(lines.origins[row], lines.directions[row]))
        if abs(closest - 1.0) < 0.02:
            continue  # lines that graze
        if len(t) != len(places) or not np.allclose(t, places, atol=0.005):
            wrong += 1
        cosine = events.cosine[events.offsets[row] : events.offsets[row + 1]]
        assert len(t) != 2 or cosine[0] * cosine[1] < 0.0
    assert wrong <= 3


def test_crossings_are_sorted_and_match_the_triangles():
    ball = Surfels(truth.sphere(150, 3).points * 3.0 + [1.0, 2.0, 3.0])
    lines = _lines(ball.points, 40)
    crossings = ball.cross(lines)
    fans = ball.surface._once("fans", ball.surface._crossable)[0]
    vertices = fans.vertices * ball.surface.scale + ball.surface.origin
    for row in range(40):
        t = crossings.t[crossings.offsets[row] : crossings.offsets[row + 1]]
        assert (np.diff(t) >= 0.0).all()
        hits = [naive.triangle_hit(lines.origins[row], lines.directions[row], vertices[f]) for f in fans.triangles]
        hits = sorted(hit for hit in hits if hit is not None)
        assert len(hits) == len(t)
        weight = crossings.weight[crossings.offsets[row] : crossings.offsets[row + 1]]
        assert (weight > 0.0).all()


@pytest.mark.parametrize("seed", range(4))
def test_hits_are_merged_as_by_hand(seed):
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(200):
        count = rng.integers(0, 7)
        t = np.sort(rng.random(count) * 3.0)
        rows.append((t, rng.integers(0, 2, count) / 3.0 + (rng.random(count) < 0.2) * 0.05, np.full(count, 0.3)))
    t, share, gap = (np.concatenate(part) for part in zip(*rows, strict=True))
    offsets = np.concatenate([[0], np.cumsum([len(row[0]) for row in rows])])
    ones = np.ones(len(t))
    merged = CloudCrossings(
        offsets, t, ones, ones, np.zeros(len(t), np.int32), share, gap, np.ones((len(t), 3)) / np.sqrt(3.0)
    ).merged()
    compared = 0
    for row, (places, shares, gaps) in enumerate(rows):
        if shares.sum() >= 1.5:
            continue
        found = merged.t[merged.offsets[row] : merged.offsets[row + 1]]
        np.testing.assert_allclose(found, naive.sheet_events(list(places), list(shares), list(gaps)), rtol=1e-12)
        compared += 1
    assert compared > 150


@pytest.mark.parametrize(
    ("t", "share", "events"),
    [
        ([1.0], [1.0], [1.0]),
        ([1.0], [1 / 3], []),
        ([1.0], [2 / 3], [1.0]),
        ([1.0, 1.1], [1 / 3, 2 / 3], [1.0 + 0.2 / 3]),
        ([1.0, 1.1], [1.0, 1.0], [1.0, 1.1]),  # two sheets, however near
        ([1.0, 5.0], [1.0, 1.0], [1.0, 5.0]),
        ([1.0, 1.05, 1.1], [2 / 3, 2 / 3, 2 / 3], [1.025, 1.1]),
        ([1.0, 1.1, 5.0], [1 / 3, 2 / 3, 1.0], [1.0 + 0.2 / 3, 5.0]),
    ],
)
def test_merging_by_example(t, share, events):
    k = len(t)
    hits = CloudCrossings(
        np.array([0, k]),
        np.array(t),
        np.ones(k),
        np.ones(k),
        np.zeros(k, np.int32),
        np.array(share),
        np.full(k, 0.3),
        np.tile([0.0, 0.0, 1.0], (k, 1)),
    )
    np.testing.assert_allclose(hits.merged().t, events)


def test_hits_of_two_planes_at_an_edge_are_two_sheets():
    normal = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    cosine, third = np.array([-0.6, 0.8, -0.6, 0.8]), np.full(4, 1.0 / 3.0)
    t = np.array([1.0, 1.02, 1.04, 1.06])
    hits = CloudCrossings(np.array([0, 4]), t, cosine, third, np.zeros(4, np.int32), third, np.full(4, 0.3), normal)
    np.testing.assert_allclose(hits.merged().t, [1.02, 1.04])
    np.testing.assert_allclose(hits.merged().cosine, [-0.6, 0.8])


def test_the_way_in_and_the_way_out_of_a_shallow_cap_are_two_sheets():
    normal = np.array([[0.0, 0.1, 1.0], [0.0, -0.1, 1.0]])
    hits = CloudCrossings(
        np.array([0, 2]), np.array([1.0, 1.1]), np.array([-0.1, 0.1]), np.ones(2), np.zeros(2, np.int32),
        np.full(2, 2.0 / 3.0), np.full(2, 0.3), normal / np.linalg.norm(normal, axis=1, keepdims=True),
    )  # fmt: skip
    assert len(hits.merged().t) == 2


@pytest.mark.parametrize("given", [False, True])
def test_inside_and_outside(given):
    ring = truth.torus(4000, 4)
    cloud = Surfels(ring.points, normals=ring.normals if given else None)
    places = np.random.default_rng(1).uniform(-1.5, 1.5, (3000, 3)) * [1.0, 1.0, 0.4]
    off = 0.35 - np.hypot(np.hypot(places[:, 0], places[:, 1]) - 1.0, places[:, 2])
    clear = np.abs(off) > 0.03
    assert (cloud.contains(places)[clear] == (off > 0)[clear]).mean() > 0.999


@pytest.mark.parametrize(
    "open_", [truth.square, truth.half_sphere, truth.crossing_squares, lambda n: truth.capless_sphere(n, 0.05)]
)
def test_an_open_cloud_has_no_inside_unless_it_is_said_to_be_a_solid(open_):
    cloud = Surfels(open_(3000).points)
    with pytest.raises(surfel.InputError, match=r"open: .*% of the lines .*with_solid\(True\)"):
        cloud.contains([[0, 0, 0]])
    with pytest.raises(surfel.InputError, match="open"):
        Surfels(np.zeros((1, 3))).cropped(cloud)
    assert cloud.with_solid(True).contains([[0, 0, 9]]).tolist() == [False]
    assert Surfels(truth.capless_sphere(3000, 0.02).points, solid=True).contains([[0, 0, 0]]).tolist() == [True]


def test_a_sheet_has_no_inside():
    cloud = Surfels(truth.sphere(1000).points, solid=False)
    with pytest.raises(surfel.InputError, match="solid=False"):
        cloud.contains([[0, 0, 0]])
    assert cloud.with_solid(None).contains([[0, 0, 0]]).tolist() == [True]


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_leak_of_few_lines_is_that_of_the_cap(scale):
    for share in (0.05, 0.2):
        cap = truth.capless_sphere(6000, share, 2).points * scale + 3.0 * scale
        expected = 2.0 * share / (1.0 + share)  # odd with 2 f (1 - f), missed f^2
        assert Surfels(cap).surface.leak == pytest.approx(expected, rel=0.1)
    assert Surfels(truth.torus(6000, 2).points * scale).surface.leak < 0.005


def test_no_lines_and_no_surface_cross_nothing():
    nothing = Lines.of(np.empty((0, 3)), np.empty((0, 3)), 1.0)
    cloud = Surfels(truth.sphere(200, 1).points)
    assert len(cloud.cross(nothing)) == 0 and len(cloud.contains(np.empty((0, 3)))) == 0
    one = Lines.of([[0, 0, 0]], [[0, 0, 1]], 1.0)
    for points in (np.empty((0, 3)), np.zeros((3, 3))):
        assert Surfels(points).cross(one).counts.tolist() == [0]
        assert Surfels(points).contains([[0, 0, 0]]).tolist() == [False]


def test_what_is_no_line_is_refused():
    with pytest.raises(surfel.InputError, match="Lines"):
        Surfels(np.zeros((4, 3))).cross([[0, 0, 1]])
    with pytest.raises(surfel.InputError, match="n must be"):
        Surfels(np.zeros((4, 3))).patches(0)
