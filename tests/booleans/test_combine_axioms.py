"""Axioms on random pairs of clouds, and the rule for trees beside its slow statement."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import surfel
from booleans_with_truth import PI, area, ball, cube, rows, sampled
from surfel import Difference, Intersection, Union
from surfel._numba import threads_for
from surfel.booleans.sides import IN, OPPOSED, OUT, SAME, Rule
from surfel.core.affine import rotation, translation


def pair(seed):
    """Return two clouds of random shapes that overlap."""
    rng = np.random.default_rng(seed)
    made = []
    for k in range(2):
        shape = [
            surfel.Sphere(rng.uniform(0.6, 1.2)),
            surfel.Box(tuple(rng.uniform(0.8, 2.0, 3))),
            surfel.Cylinder(rng.uniform(0.4, 0.9), rng.uniform(1.0, 2.5)),
            surfel.Torus(0.9, 0.35),
        ][rng.integers(4)]
        shape = shape.rotated(rng.standard_normal(3), rng.uniform(0, 360)).translated(rng.uniform(-0.4, 0.4, 3))
        made.append(sampled(shape, int(rng.integers(3000, 5000)), seed + k, rng.choice(["blue", "random"])))
    return made


@pytest.mark.parametrize("seed", range(4))
def test_axioms(seed):
    a, b = pair(seed)
    same = surfel.Surfels(a.points, a.normals)
    for tree in (a | a, a & a, a | same, a & same):
        assert np.array_equal(rows(surfel.combine(tree).surfels), rows(a))
    for tree in (a - a, a - same):
        assert len(surfel.combine(tree).surfels) == 0
    for operation in (Union, Intersection):
        one, other = surfel.combine(operation(a, b)), surfel.combine(operation(b, a))
        assert len(one.surfels) == pytest.approx(len(other.surfels), rel=8e-3)  # where they coincide, the first's stay
        assert area(one) == pytest.approx(area(other), rel=6e-3)  # about tangent, one may cut where the other coincides
    # A - B = A & not B, not B by a box that holds it all
    everything = surfel.Box(10.0)
    outside = surfel.combine(Intersection(a, Difference(everything, b)), spacing=0.5).surfels
    assert np.array_equal(rows(outside), rows(surfel.combine(a - b).surfels))
    # De Morgan: U - (A | B) = (U - A) & (U - B)
    left = surfel.combine(Difference(everything, Union(a, b)), spacing=0.5).surfels
    right = surfel.combine(Intersection(Difference(everything, a), Difference(everything, b)), spacing=0.5).surfels
    inner = [result[result.attributes["leaf"] > 0] for result in (left, right)]
    assert np.array_equal(rows(inner[0]), rows(inner[1]))
    # areas: what is cut away here is found there
    union, common = area(surfel.combine(a | b)), area(surfel.combine(a & b))
    whole = sum(float(cloud.surface.patches.areas.sum()) for cloud in (a, b))
    assert union + common == pytest.approx(whole, rel=2e-3)  # what lies on both, at flat angles, is counted once


def test_rigid_motion_and_order_of_points():
    a, b = ball(4000, 1), cube(4000, 2, 1.5, 0.8)
    first = surfel.combine(a - b)
    motion = translation((3.0, -2.0, 5.0)) @ rotation((1.0, 2.0, 0.5), 70.0)
    moved = surfel.combine(a.transformed(motion) - b.transformed(motion))
    assert abs(moved.cut - first.cut) <= 0.06 * first.cut
    assert area(moved) == pytest.approx(area(first), rel=1e-3)
    shuffled = np.random.default_rng(3).permutation(len(a))
    again = surfel.combine(a[shuffled] - b)
    assert np.array_equal(rows(again.surfels), rows(first.surfels))
    assert np.array_equal(np.sort(again.surfels.clips.planes, axis=0), np.sort(first.surfels.clips.planes, axis=0))


def test_one_and_two_threads_give_the_same_bits():
    a = sampled(surfel.Sphere(1.0), 60_000, 1, "random")
    b = sampled(surfel.Sphere(1.0).translated((0.9, 0, 0)), 60_000, 2, "random")
    results = []
    for threads in (1, 2):
        with threads_for(10**9, threads):
            fresh = [surfel.Surfels(cloud.points, cloud.normals) for cloud in (a, b)]
            results.append(surfel.combine(fresh[0] | fresh[1]).surfels)
    one, two = results
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.normals, two.normals)
    assert np.array_equal(one.clips.planes, two.clips.planes)


def test_clouds_that_sample_one_surface_anew_coincide():
    a, b = ball(6000, 1), ball(6000, 5)
    assert len(surfel.combine(a - b).surfels) == 0
    assert surfel.combine(a | b).kept == (6000, 0)
    assert area(surfel.combine(a & b)) == pytest.approx(4.0 * PI, rel=1e-3)


def test_disjoint_contained_and_touching():
    a, inner, far = ball(4000, 1), ball(3000, 2, 0.4), ball(3000, 3, 1.0, 5.0)
    assert surfel.combine(a | far).kept == (4000, 3000)
    assert len(surfel.combine(a & far).surfels) == 0
    assert surfel.combine(a - far).kept == (4000, 0)
    assert surfel.combine(a | far).judges == (None, None)  # the boxes tell it all
    assert surfel.combine(a | inner).kept == (4000, 0)
    assert surfel.combine(a & inner).kept == (0, 3000)
    assert surfel.combine(a - inner).kept == (4000, 3000)
    assert len(surfel.combine(inner - a).surfels) == 0
    touching = ball(3000, 3, 1.0, 2.0)
    assert area(surfel.combine(a | touching)) == pytest.approx(8.0 * PI, rel=5e-3)  # where they touch, both go
    assert area(surfel.combine(a & touching)) < 0.01


def test_empty_operands():
    a, nothing = ball(3000), surfel.Surfels(np.empty((0, 3)))
    for tree, kept in (
        (a | nothing, 3000),
        (a - nothing, 3000),
        (a & nothing, 0),
        (nothing - a, 0),
        (Union(nothing), 0),
    ):
        result = surfel.combine(tree)
        assert len(result.surfels) == kept
        assert not result.leaky
    assert len(surfel.combine(Union()).surfels) == 0
    assert surfel.combine(a & nothing).curve == []


def test_far_clouds_take_no_longer():
    a = ball(3000, 1)
    spacing = np.sqrt(4.0 * PI / 3000)
    far = surfel.Surfels(a.points + [1e6 * spacing, 0.0, 0.0], a.normals)
    both = surfel.Surfels(np.concatenate([a.points, far.points]), np.concatenate([a.normals, far.normals]))
    shifted = surfel.Surfels(both.points + [0.5, 0.0, 0.0], both.normals)
    result = surfel.combine(both | shifted)
    assert area(result) == pytest.approx(
        2.0 * surfel.measure(surfel.Sphere(1) | surfel.Sphere(1).translated((0.5, 0, 0))).area.value, rel=2e-3
    )
    assert surfel.combine(a | far).kept == (3000, 3000)


def slow_rule(tree, values):
    if not isinstance(tree, surfel.shapes.tree.Tree):
        return values[id(tree)]
    parts = [slow_rule(child, values) for child in tree.children]
    if tree.operation == "union":
        return any(parts)
    if tree.operation == "intersection":
        return all(parts)
    return parts[0] and not any(parts[1:])


def test_the_rule_beside_its_slow_statement():
    rng = np.random.default_rng(0)
    leaves = [ball(50, k) for k in range(4)]
    for _ in range(20):
        nodes = list(leaves)
        while len(nodes) > 1:
            chosen = rng.permutation(len(nodes))[: rng.integers(2, min(3, len(nodes)) + 1)]
            kind = (Union, Intersection, Difference)[rng.integers(3)]
            made = kind(*(nodes[k] for k in chosen))
            nodes = [node for k, node in enumerate(nodes) if k not in chosen] + [made]
        tree = nodes[0]
        rule = Rule(tree, set())
        order = {id(leaf): k for k, leaf in enumerate(tree.leaves)}
        cases = list(product((OUT, SAME, OPPOSED, IN), repeat=3))
        for leaf in range(len(tree.leaves)):
            others = [k for k in range(len(tree.leaves)) if k != leaf]
            sides = {k: np.array([case[j] for case in cases], np.uint8) for j, k in enumerate(others)}
            found = rule.keeps(leaf, sides, len(cases))
            for row, case in enumerate(cases):
                bits = dict(zip(others, case, strict=True))
                values = []
                for side in (0, 1):
                    inside = {i: bool(bits[k] >> side & 1) if k != leaf else side == 0 for i, k in order.items()}
                    values.append(slow_rule(tree, inside))
                wanted = int(values[0]) - int(values[1])
                if any(k < leaf and bits[k] in (SAME, OPPOSED) for k in others):
                    wanted = 0
                assert found[row] == wanted
