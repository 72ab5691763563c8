"""Elliptical surfels: which of them a cut passes, what it leaves of them, and what stays of their axes."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball
from surfel.core.affine import scaling

N = 6000
STRETCH = (1.0, 0.7, 3.0)
NORMAL, OFFSET = np.array([2.0, 1.0, 6.0]) / np.sqrt(41.0), 0.4
CUT = surfel.HalfSpace(tuple(NORMAL), OFFSET)


def round_ball(seed=1, x=0.0):
    """Return a ball whose disks are given as ellipses with equal axes."""
    cloud = ball(N, seed, x=x)
    across = np.cross(cloud.normals, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axes = np.stack([across, np.cross(cloud.normals, across)], axis=1) * np.sqrt(4.0 * PI / N)
    return surfel.Surfels(cloud.points, cloud.normals, axes=axes)


def stretched(seed=1, x=0.0):
    return round_ball(seed, x).transformed(scaling(STRETCH))


def over(cloud, normal=NORMAL):
    """Return how far each centre lies beyond the cut, and how far each ellipse reaches towards it."""
    reach = np.linalg.norm(cloud.axes @ normal, axis=1)
    return cloud.points @ normal - OFFSET, reach


@pytest.mark.parametrize("along", [True, False], ids=["long towards the cut", "long beside the cut"])
def test_the_ellipse_decides_what_the_cut_passes(along):
    cloud = stretched()
    normal = NORMAL if along else np.array([0.8, 0.6, 0.0])
    found = surfel.combine(cloud & surfel.HalfSpace(tuple(normal), OFFSET)).surfels
    first = found[found.attributes["leaf"] == 0]
    left = {tuple(point): part for point, part in zip(first.points, first.clips.areas, strict=True)}
    kept = np.array([tuple(point) in left for point in cloud.points])
    beyond, reach = over(cloud, normal)
    assert kept[beyond < 0.95 * reach].all()
    far = (beyond > 1.03 * reach) & kept
    assert far.sum() < 20
    assert all(left[tuple(point)] > 0.0 for point in cloud.points[far])  # the cell reaches farther than the ellipse
    lengths = np.linalg.norm(cloud.axes, axis=2)
    disk = np.sqrt(lengths.prod(axis=1)) * np.sqrt(1.0 - (cloud.normals @ normal) ** 2)
    unlike = kept & (beyond > 1.05 * disk) if along else ~kept & (beyond < 0.95 * disk)
    assert unlike.sum() > 20  # a disk of the same size would reach less, or more


def test_clips_end_at_the_cut_all_over_the_ellipse():
    found = surfel.combine(stretched() & CUT).surfels
    chosen = np.flatnonzero(found.attributes["leaf"] == 0)
    assert (found.clips.counts[chosen] > 0).sum() > 200
    rng = np.random.default_rng(3)
    out, turn = np.sqrt(rng.random((len(chosen), 200))), 2.0 * PI * rng.random((len(chosen), 200))
    uv = np.stack([out * np.cos(turn), out * np.sin(turn)], axis=2)
    offsets = np.einsum("ika,iax->ikx", uv, found.axes[chosen])
    which = np.repeat(np.arange(len(chosen)), 200)
    kept = found.clips[chosen].leaves(which, offsets.reshape(-1, 3))
    beyond = ((found.points[chosen][:, None] + offsets) @ NORMAL - OFFSET).ravel()
    assert np.abs(beyond[kept != (beyond <= 0.0)]).max(initial=0.0) < 1e-9


@pytest.mark.parametrize("cut", ["clip", "split"])
def test_areas_beside_the_exact_ellipsoid(cut):
    shape = surfel.Sphere(1.0).scaled(STRETCH)
    result = surfel.combine(stretched() & CUT, cut=cut)
    assert area(result) == pytest.approx(float(surfel.measure(shape & CUT).area), rel=2e-3)


def test_what_is_left_of_two_stretched_balls():
    a, b = stretched(), stretched(2, 1.0)
    exact = [surfel.Sphere(1.0).translated((x, 0.0, 0.0)).scaled(STRETCH) for x in (0.0, 1.0)]
    for tree, same in ((a | b, exact[0] | exact[1]), (a - b, exact[0] - exact[1]), (a & b, exact[0] & exact[1])):
        assert area(surfel.combine(tree)) == pytest.approx(float(surfel.measure(same).area), rel=3e-3)


def test_small_surfels_that_are_split_off_are_round_and_keep_to_the_tolerance():
    tolerance = 0.01
    found = surfel.combine(stretched() & CUT, cut="split", tolerance=tolerance).surfels
    first = found[found.attributes["leaf"] == 0]
    beyond, reach = over(first)
    assert (beyond + reach).max() <= tolerance
    small = np.flatnonzero(np.abs(np.linalg.norm(first.axes, axis=2) - first.radii[:, None]).max(axis=1) < 1e-9)
    assert len(small) > 500
    cloud = stretched()
    far = np.linalg.norm(cloud.axes, axis=2).max() + tolerance
    inner = {tuple(point) for point, away in zip(cloud.points, over(cloud)[0], strict=True) if away < -far}
    rows = [row for row, point in enumerate(first.points) if tuple(point) in inner]
    assert len(rows) == len(inner)
    given = {tuple(point): axes for point, axes in zip(cloud.points, cloud.axes, strict=True)}
    assert all(np.array_equal(first.axes[row], given[tuple(first.points[row])]) for row in rows)


def test_disks_beside_ellipses_have_equal_axes():
    found = surfel.combine(stretched() - ball(3000, 2, 0.5, 1.0)).surfels
    second = found[found.attributes["leaf"] == 1]
    assert len(second) > 100
    lengths = np.linalg.norm(second.axes, axis=2)
    assert lengths == pytest.approx(np.stack([second.radii, second.radii], axis=1))
    assert np.abs(np.einsum("iaj,ij->ia", second.axes, second.normals)).max() < 1e-12
