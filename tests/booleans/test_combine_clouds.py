"""Clouds combined: closed forms, exact meshes, what is carried over, and how sharp the cut is."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball, cube, sampled, within_disks

LENS = 5.0 * PI / 12.0
BALL = 4.0 * PI / 3.0


@pytest.mark.parametrize(
    ("operation", "true_area", "true_volume"),
    [
        (lambda a, b: a | b, 6.0 * PI, 2.0 * BALL - LENS),
        (lambda a, b: a & b, 2.0 * PI, LENS),
        (lambda a, b: a - b, 4.0 * PI, BALL - LENS),
    ],
    ids=["union", "intersection", "difference"],
)
def test_two_balls(operation, true_area, true_volume):
    result = surfel.combine(operation(ball(8000, 1), ball(8000, 2, x=1.0)))
    assert not result.leaky
    assert result.conflict == 0.0
    assert result.warnings == ()
    assert area(result) == pytest.approx(true_area, rel=2e-4)
    found = surfel.measure(result.surfels, lines=16_384)
    assert found.area.value == pytest.approx(true_area, rel=2e-4)
    assert found.volume.value == pytest.approx(true_volume, rel=1e-3)  # odd lines are asked what lies inside
    outward = np.sign(np.einsum("ij,ij->i", result.surfels.normals, result.surfels.points))
    first = result.surfels.attributes["leaf"] == 0
    assert (outward[first] == 1.0).all()
    assert sum(result.kept) == len(result.surfels)
    assert 0 < result.cut < 0.2 * len(result.surfels)


def test_what_is_subtracted_is_turned_over():
    result = surfel.combine(ball(5000, 1) - ball(5000, 2, x=1.0)).surfels
    second = result.attributes["leaf"] == 1
    inward = np.einsum("ij,ij->i", result.normals[second], result.points[second] - [1.0, 0.0, 0.0])
    assert (inward < -0.999).all()


@pytest.mark.parametrize(("shift", "true"), [(1.0, (32.0, 16.0, 16.0)), (2.0, (40.0, 0.0, 24.0))])
def test_cubes_that_share_faces(shift, true):
    a, b = cube(seed=1), cube(seed=2, x=shift)
    for tree, wanted in zip((a | b, a & b, a - b), true, strict=True):  # .06 spacings along each edge of a shared face
        assert area(surfel.combine(tree)) == pytest.approx(wanted, abs=0.04)


def test_turned_cubes_against_exact_solids():
    turned = surfel.Box(2.0).rotated((1, 2, 3), 50.0).translated((0.7, 0.4, 0.3))
    a, b = cube(12_000, 1), sampled(turned, 12_000, 2)
    for clouds, exact in (
        (a | b, surfel.Box(2) | turned),
        (a & b, surfel.Box(2) & turned),
        (a - b, surfel.Box(2) - turned),
    ):
        true = surfel.measure(exact).area.value
        assert area(surfel.combine(clouds)) == pytest.approx(true, rel=1.5e-3)


def test_a_deep_tree_needs_no_intermediate_solid():
    c = sampled(surfel.Sphere(0.8).translated((0.5, 0.6, 0.0)), 6000, 3)
    d = sampled(surfel.Box(1.2).translated((0.3, 0.0, 0.9)), 8000, 4)
    exact = surfel.Sphere(1), surfel.Sphere(1).translated((1, 0, 0)), surfel.Sphere(0.8).translated((0.5, 0.6, 0.0))
    box = surfel.Box(1.2).translated((0.3, 0.0, 0.9))
    result = surfel.combine(((ball(8000, 1) | ball(8000, 2, x=1.0)) - c) | d)
    true = surfel.measure(((exact[0] | exact[1]) - exact[2]) | box).area.value
    assert area(result) == pytest.approx(true, rel=1.5e-3)
    assert len(result.kept) == 4


def test_against_exact_booleans_of_meshes(data_file):
    manifold3d, trimesh = pytest.importorskip("manifold3d"), pytest.importorskip("trimesh")

    def load(name):
        mesh = trimesh.load(data_file(name), process=True, force="mesh")
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
        mesh.apply_scale(1.0 / mesh.extents.max())
        return mesh

    a, b = load("meshes/fandisk.obj"), load("meshes/rocker-arm.obj")
    b.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    b.apply_translation((0.1, 0.0, 0.1))
    solids = [
        manifold3d.Manifold(manifold3d.Mesh(np.asarray(m.vertices, np.float32), np.asarray(m.faces, np.uint32)))
        for m in (a, b)
    ]
    clouds = [sampled(surfel.Mesh(m.vertices, m.faces), 20_000, k) for k, m in enumerate((a, b))]
    for tree, solid in (
        (clouds[0] | clouds[1], solids[0] + solids[1]),
        (clouds[0] & clouds[1], solids[0] ^ solids[1]),
        (clouds[0] - clouds[1], solids[0] - solids[1]),
    ):
        mesh = solid.to_mesh()
        true = surfel.Mesh(np.asarray(mesh.vert_properties[:, :3], float), np.asarray(mesh.tri_verts)).area
        assert area(surfel.combine(tree)) == pytest.approx(true, rel=2e-3)


def test_nothing_reaches_over_the_cut():
    result = surfel.combine(ball(5000, 1) - ball(5000, 2, x=1.0)).surfels
    spacing = np.sqrt(4.0 * PI / 5000)
    for leaf, centre, sign in ((0, (1.0, 0.0, 0.0), 1.0), (1, (0.0, 0.0, 0.0), -1.0)):
        cut = np.flatnonzero((result.attributes["leaf"] == leaf) & (result.clips.counts > 0))
        places, left = within_disks(result, cut)
        depth = sign * (1.0 - np.linalg.norm(places - centre, axis=2))
        over = np.where(left, depth, 0.0).max(axis=1).clip(0.0) / spacing
        assert over.mean() <= 0.05
        assert np.quantile(over, 0.95) <= 0.1
        short = np.where(left, -np.inf, -depth).max(axis=1) / spacing  # what was cut off lies beyond the cut
        assert np.quantile(short, 0.95) <= 0.1


def test_surfels_whose_centres_are_outside_stay_where_their_disks_are_cut():
    result = surfel.combine(ball(5000, 1) - ball(5000, 2, x=1.0)).surfels
    first = result.attributes["leaf"] == 0
    outside = first & (np.linalg.norm(result.points - [1.0, 0.0, 0.0], axis=1) < 1.0)
    assert outside.sum() > 50
    assert (result.clips.counts[outside] > 0).all()
    bare = surfel.combine(ball(5000, 1) - ball(5000, 2, x=1.0), cut="none").surfels
    first = bare.attributes["leaf"] == 0
    assert (np.linalg.norm(bare.points[first] - [1.0, 0.0, 0.0], axis=1) > 1.0 - 1e-3).all()
    assert not bare.clips.counts.any()


def test_colors_and_attributes_are_carried_over():
    n = 4000
    p = ball(n, 1)
    a = surfel.Surfels(
        p.points, p.normals, np.full(n, 0.05), np.tile(np.array([[10, 20, 30]], np.uint8), (n, 1)),
        {"number": np.arange(n), "heat": p.points[:, 0], "name": np.array(["left"] * n)},
    )  # fmt: skip
    result = surfel.combine(a | ball(n, 2, x=1.0)).surfels
    first = result.attributes["leaf"] == 0
    number = result.attributes["number"][first]
    assert np.array_equal(result.points[first], a.points[number])
    assert np.array_equal(result.attributes["heat"][first], a.points[number, 0])
    assert np.isnan(result.attributes["heat"][~first]).all()
    assert set(result.attributes["name"][~first]) == {""}
    assert (result.radii[first] == 0.05).all()
    assert (result.colors[first] == [10, 20, 30]).all()
    assert (result.colors[~first] == 127).all()


def test_bad_arguments_are_refused():
    a, b = ball(), ball(x=1.0)
    for arguments, told in (
        ({"cut": "saw"}, "cut must be one of"),
        ({"judge": "jury"}, "judge must be one of"),
        ({"level": 2}, "level and tolerance belong to cut='split'"),
        ({"cut": "split", "level": 2, "tolerance": 0.1}, "either a level or a tolerance"),
        ({"cut": "split", "level": 9}, "level must be between 1 and 8"),
        ({"spacing": -1.0}, "spacing must be positive"),
    ):
        with pytest.raises(surfel.InputError, match=told):
            surfel.combine(a | b, **arguments)
    with pytest.raises(surfel.InputError, match="wrap points as"):
        surfel.combine(a.points)
    with pytest.raises(surfel.InputError, match="no end"):
        surfel.combine(a | surfel.HalfSpace((0, 0, 1), 0.0))
