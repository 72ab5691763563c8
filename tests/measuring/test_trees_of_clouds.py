"""Trees of clouds: the difference of two scans, by closed forms and by Booleans of the meshes they were drawn from."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel import Box, HalfSpace, Surfels
from surfel.measuring.by_patches import _disk, _kept_shares

DATA = Path(os.environ.get("SURFEL_DATA", Path(__file__).parents[3] / "shared" / "data")) / "meshes"
PI = math.pi
SIDES = (1.0, 0.8, 0.6)
AREA, VOLUME = 2.0 * (0.8 + 0.6 + 0.48), 0.48


def ball(n=20_000, seed=0, by=(0.0, 0.0, 0.0), given=True):
    points = truth.sphere(n, seed).points
    return Surfels(points + np.array(by), points if given else None)


def box(seed, by=(0.0, 0.0, 0.0), n=12_000):
    cloud = truth.box(n, seed, SIDES)
    return Surfels(cloud.points + np.array(by), cloud.normals)


def lens(d):
    """Return the area and the volume that two unit balls at the distance d have in common."""
    height = 1.0 - 0.5 * d
    return 4.0 * PI * height, PI * (4.0 + d) * (2.0 - d) ** 2 / 12.0


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("operation", ["a - b", "b - a", "a & b", "a | b"])
def test_two_balls(operation, given):
    d = 0.8
    a, b = ball(seed=1, given=given), ball(seed=2, by=(d, 0.0, 0.0), given=given)
    area, volume = lens(d)
    truth_of = {
        "a - b": (4.0 * PI, 4.0 * PI / 3.0 - volume),  # what it loses outside it gains inside
        "b - a": (4.0 * PI, 4.0 * PI / 3.0 - volume),
        "a & b": (area, volume),
        "a | b": (8.0 * PI - area, 8.0 * PI / 3.0 - volume),
    }[operation]
    found = surfel.measure({"a - b": a - b, "b - a": b - a, "a & b": a & b, "a | b": a | b}[operation])
    for estimate, value in zip((found.area, found.volume), truth_of, strict=True):
        assert estimate.value == pytest.approx(value, rel=2e-3)
        assert abs(estimate.value - value) < 4.0 * estimate.standard_error
        assert estimate.standard_error < 5e-3 * value


COINCIDENT = {
    "one and its like": (lambda: box(1) | box(2), AREA, VOLUME),
    "what both have": (lambda: box(1) & box(2), AREA, VOLUME),
    "one without its like": (lambda: box(1) - box(2), 0.0, 0.0),
    "two that touch": (lambda: box(1) | box(3, (1.0, 0.0, 0.0)), 2.0 * AREA - 0.96, 2.0 * VOLUME),
    "one without what touches it": (lambda: box(1) - box(3, (1.0, 0.0, 0.0)), AREA, VOLUME),
    "an exact one and its like": (lambda: Box(SIDES) | box(1), AREA, VOLUME),
    "balls and their like": (lambda: ball(seed=1) - ball(seed=2), 0.0, 0.0),
}


@pytest.mark.parametrize("name", COINCIDENT)
def test_surfaces_that_coincide_count_once_or_not_at_all(name):
    """Judged by inside and outside alone, half of the shared faces would be kept: errors of 7 to 50 %."""
    tree, area, volume = COINCIDENT[name]
    found = surfel.measure(tree(), lines=8192)
    assert found.area.value == pytest.approx(area, abs=0.012 * AREA)
    assert found.volume.value == pytest.approx(volume, abs=0.003 * VOLUME)


def test_a_cloud_without_itself_is_empty():
    a = ball(3000)
    found = surfel.measure(a - a, lines=1024)
    assert found.area.value == 0.0 and found.volume.value == 0.0


def test_the_share_of_a_cell_that_a_plane_cuts_is_that_of_a_disk():
    cloud = ball(8000, seed=4)
    for offset in (0.0, 0.31, -0.6):
        tree = cloud & HalfSpace((0.0, 0.0, 1.0), offset)
        patches = cloud.surface.patches
        share = _kept_shares(tree, tree.leaves.index(cloud), patches)
        radius = np.sqrt(np.maximum(patches.areas, 1e-12) / PI)
        slope = np.sqrt(1.0 - patches.normals[:, 2] ** 2)
        at = np.clip((offset - patches.points[:, 2]) / (radius * slope), -1.0, 1.0)  # the cut, in radii
        segment = 1.0 - (np.arccos(at) - at * np.sqrt(1.0 - at * at)) / PI
        cut = np.abs(at) < 0.9
        assert cut.sum() > 60 and np.abs(share - segment)[cut].mean() < 0.03
        assert (share[at == 1.0] == 1.0).all() and (share[at == -1.0] == 0.0).all()
        assert abs(float((share - segment)[cut].mean())) < 0.02


def test_places_in_a_disk_stand_for_equal_areas():
    places = _disk(24)
    assert np.abs(places.mean(axis=0)).max() < 0.03
    assert np.allclose((places**2).mean(axis=0), 0.25, atol=0.03)  # of the unit disk: 1/4 along each axis


def test_a_deep_tree_of_clouds_and_exact_solids():
    a, b = ball(seed=5), ball(seed=6, by=(0.8, 0.0, 0.0))
    tree = ((a - b) | (a & b)) & HalfSpace((0.0, 0.0, 1.0), 0.0)  # half of a
    found = surfel.measure(tree, lines=16_384)
    assert found.area.value == pytest.approx(3.0 * PI, rel=5e-3)
    assert found.volume.value == pytest.approx(2.0 * PI / 3.0, rel=5e-3)


def test_far_clouds_cost_no_more_than_near_ones():
    """A million spacings apart: neither crossing nor judging looks round for ever."""
    a, b = ball(4000), ball(4000, seed=1, by=(5e4, 0.0, 0.0))
    found = surfel.measure(a | b, lines=4096)
    assert found.area.value == pytest.approx(8.0 * PI, rel=5e-3)
    assert surfel.measure(a & b, lines=1024).area.value == 0.0


@pytest.mark.parametrize("pair", [("fertility.off", "rocker-arm.obj"), ("horse.ply", "igea.ply")])
def test_scans_against_exact_booleans(pair):
    """The clouds of two meshes against manifold3d's Booleans of the meshes themselves."""
    manifold3d = pytest.importorskip("manifold3d")
    if not all((DATA / name).exists() for name in pair):
        pytest.skip(f"{pair} are not in the data folder (set SURFEL_DATA)")
    solids, clouds = [], []
    for which, name in enumerate(pair):
        mesh = surfel.io.read(DATA / name)
        corners, place = np.unique(mesh.vertices, axis=0, return_inverse=True)
        triangles = place.ravel()[mesh.triangles]
        low, high = corners.min(axis=0), corners.max(axis=0)
        corners = (corners - 0.5 * (low + high)) / (high - low).max()
        if which:
            corners = corners @ truth.rotation(3).T + [0.15, 0.05, 0.1]
        a, b, c = (corners[triangles[:, k]] for k in range(3))
        if np.einsum("ij,ij->", a, np.cross(b, c)) < 0.0:
            triangles, b, c = triangles[:, ::-1], c, b
        across = np.cross(b - a, c - a)
        twice = np.linalg.norm(across, axis=1)
        rng = np.random.default_rng(which)
        face = rng.choice(len(twice), 20_000, p=twice / twice.sum())
        root, share = np.sqrt(rng.random((20_000, 1))), rng.random((20_000, 1))
        points = a[face] * (1.0 - root) + b[face] * root * (1.0 - share) + c[face] * root * share
        clouds.append(Surfels(points, across[face]))
        solids.append(manifold3d.Manifold(manifold3d.Mesh64(corners, np.ascontiguousarray(triangles, np.uint64))))
    (a, b), (x, y) = clouds, solids
    for tree, exact in ((a - b, x - y), (b - a, y - x), (a & b, x ^ y)):
        found = surfel.measure(tree)
        assert found.area.value == pytest.approx(exact.surface_area(), rel=1e-2)
        assert found.volume.value == pytest.approx(exact.volume(), rel=6e-3)
        assert abs(found.area.value - exact.surface_area()) < 3.5 * found.area.standard_error
