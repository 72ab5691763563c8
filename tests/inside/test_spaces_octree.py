"""The octree as published: right where it works, leaking where the notes say so, and node against node."""

from __future__ import annotations

import numpy as np
import pytest

from surfel.core.affine import rotation, translation
from surfel.core.errors import InputError
from surfel.inside.octree import build_octree
from surfel.inside.octree_classify import COLOURINGS, OctreeClassifier
from surfel.inside.operand import Operand


def ball(n: int, seed: int = 0) -> Operand:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    return Operand.of(p, p)


def even_ball(n: int) -> Operand:
    """Return a ball whose surfels lie along a spiral, evenly spread."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    turn = np.arange(n) * np.pi * (3.0 - np.sqrt(5.0))
    p = np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)
    return Operand.of(p, p)


def places(n: int) -> np.ndarray:
    return np.random.default_rng(7).uniform(-1.2, 1.2, (n, 3))


def test_nodes_hold_what_lies_in_them() -> None:
    cloud = ball(3000)
    tree = build_octree(cloud, 5)
    side = tree.size / 2.0**tree.level
    low = tree.low + tree.cell * side[:, None]
    for node in range(len(tree.first)):
        held = cloud.points[tree.row[tree.first[node] : tree.last[node]]]
        assert (held >= low[node] - 1e-9).all() and (held <= low[node] + side[node] + 1e-9).all()
    leaves = tree.child < 0
    assert (tree.last - tree.first)[leaves].sum() == len(cloud)
    assert ((tree.last - tree.first)[leaves & (tree.level < 5)] <= 1).all()


@pytest.mark.parametrize("colouring", COLOURINGS)
@pytest.mark.parametrize("depth", [4, 5])
def test_a_shallow_octree_is_right(colouring: str, depth: int) -> None:
    q = places(20_000)
    found = OctreeClassifier(even_ball(20_000), depth, colouring, slabs=False).classify(q)
    assert (found != (np.linalg.norm(q, axis=1) < 1.0)).mean() < 0.002


def test_the_flood_leaks_once_leaves_are_finer_than_the_spacing() -> None:
    q = places(20_000)
    truth = np.linalg.norm(q, axis=1) < 1.0
    cloud = ball(4000)
    flood = (OctreeClassifier(cloud, 6, "flood-faces").classify(q) != truth).mean()
    level = (OctreeClassifier(cloud, 6, "per-level").classify(q) != truth).mean()
    assert flood > 0.1 > level


def test_unguarded_slabs_are_wrong_at_edges() -> None:
    rng = np.random.default_rng(0)
    axis, side = rng.integers(0, 3, 12_000), rng.choice([-1.0, 1.0], 12_000)
    points, normals = rng.uniform(-0.5, 0.5, (12_000, 3)), np.zeros((12_000, 3))
    points[np.arange(12_000), axis] = 0.5 * side
    normals[np.arange(12_000), axis] = side
    q = np.stack([np.full(20_000, 0.5), np.full(20_000, 0.5), rng.uniform(-0.4, 0.4, 20_000)], axis=1)
    q += rng.normal(0.0, 0.02, q.shape)
    truth = (np.abs(q) < 0.5).all(axis=1)
    cloud = Operand.of(points, normals)
    with_slabs, without = (
        (OctreeClassifier(cloud, 4, slabs=slabs).classify(q) != truth).mean() for slabs in (True, False)
    )
    assert with_slabs > 2.0 * without


@pytest.mark.parametrize("depth", [4, 5, 6, 7])
def test_node_against_node_says_what_its_surfels_would(depth: int) -> None:
    classifier = OctreeClassifier(ball(8000), depth, slabs=False)
    other = ball(6000, 1)
    pose = translation([0.7, 0.1, 0.2]) @ rotation([1.0, 2.0, 3.0], 50.0)
    found = classifier.classify_nodes(build_octree(other, depth), other, pose)
    world = (other.points + other.origin) @ pose[:3, :3].T + pose[:3, 3]
    assert (found.inside == classifier.classify(world)).all()
    assert found.whole > 0.3 and 0 < found.tests < len(build_octree(other, depth).first)


def test_octree_refusals() -> None:
    with pytest.raises(InputError, match="at least one surfel"):
        build_octree(Operand.of(np.empty((0, 3)), np.empty((0, 3))))
    with pytest.raises(InputError, match="depth"):
        build_octree(ball(10), 21)
    with pytest.raises(InputError, match="colouring must be one of"):
        OctreeClassifier(ball(10), colouring="by-hand")
