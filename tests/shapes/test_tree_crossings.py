"""Trees against a judge who knows only implicit functions: every crossing, its side, its leaf; and points inside."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from primitives_with_truth import lines_round
from surfel import Lines
from surfel._numba import threads_for
from surfel.shapes.tree import Tree
from trees_with_truth import inside, judged, random_leaf, random_tree


def compare(tree, leaves, lines, least=10):
    found = tree.cross(lines)
    line, t, enters, of, clear = judged(tree, leaves, lines)
    assert clear.mean() > 0.99
    mine, theirs = clear[found.lines], clear[line]
    assert mine.sum() >= least
    assert np.array_equal(found.lines[mine], line[theirs])
    assert np.abs(found.t[mine] - t[theirs]).max(initial=0.0) < 1e-6  # the judge's quartics are poor where lines graze
    assert (np.abs(found.t[mine] - t[theirs]) < 1e-12).sum() >= 0.9 * mine.sum()
    assert np.array_equal(found.cosine[mine] < 0.0, enters[theirs])
    assert np.array_equal(found.leaf[mine], of[theirs])
    assert (found.weight == 1.0).all()
    assert (found.counts % 2 == 0).all()


def around(radius=2.5):
    return np.array([[-radius] * 3, [radius] * 3])


@pytest.mark.parametrize("number", range(40))
def test_every_crossing_of_random_trees(number):
    rng = np.random.default_rng(number)
    leaves = int(rng.integers(1, 13))
    tree, known = random_tree(rng, leaves)
    compare(tree, known, lines_round(around(), 1500, seed=number), least=0)


@pytest.mark.parametrize("leaves", [5, 6, 7, 8])
def test_both_ways_of_asking_the_logic(leaves):
    """Up to six leaves are looked up in a table; more are asked node by node."""
    rng = np.random.default_rng(leaves)
    made = [random_leaf(rng, reach=0.4) for _ in range(leaves)]
    shapes = [leaf.shape for leaf in made]
    tree = surfel.Union(*shapes[:2]) - (shapes[2] & (shapes[3] | shapes[4]))
    for shape in shapes[5:]:
        tree = (tree | shape) - (tree & shape)  # one but not both: every crossing of the new leaf counts
    compare(tree, {id(leaf.shape): leaf for leaf in made}, lines_round(around(), 3000, seed=1), least=200)


def test_many_leaves_go_through_the_tree_of_boxes():
    rng = np.random.default_rng(7)
    made = [random_leaf(rng, reach=4.0, kinds="bsco") for _ in range(60)]
    holes = [random_leaf(rng, reach=4.0, kinds="sc") for _ in range(20)]
    tree = surfel.Union(*(leaf.shape for leaf in made)) - surfel.Union(*(leaf.shape for leaf in holes))
    known = {id(leaf.shape): leaf for leaf in made + holes}
    compare(tree, known, lines_round(around(5.0), 300, seed=2), least=200)
    points = rng.uniform(-4.0, 4.0, (3000, 3))
    assert np.array_equal(tree.contains(points), inside(tree, known, points))


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 1.0)])
def test_lines_along_the_axes(direction):
    rng = np.random.default_rng(11)
    made = [random_leaf(rng, reach=3.0, kinds="bs") for _ in range(30)]
    tree = surfel.Union(*(leaf.shape for leaf in made[:20])) - surfel.Union(*(leaf.shape for leaf in made[20:]))
    lines = Lines.of(rng.uniform(-4.0, 4.0, (1000, 3)), np.tile(direction, (1000, 1)), 1.0)
    compare(tree, {id(leaf.shape): leaf for leaf in made}, lines)


@pytest.mark.parametrize("distance", [1e2, 1e5])
def test_origins_far_away(distance):
    rng = np.random.default_rng(13)
    tree, _ = random_tree(rng, 6)
    lines = lines_round(around(), 1500, seed=3)
    far = Lines(lines.origins - distance * lines.directions, lines.directions, lines.weights)
    near, found = tree.cross(lines), tree.cross(far)
    same = near.counts == found.counts
    assert same.mean() > 0.99
    one, other = np.repeat(same, near.counts), np.repeat(same, found.counts)
    assert np.quantile(np.abs(near.t[one] + distance - found.t[other]), 0.999) < 1e-14 * distance + 1e-12
    assert np.array_equal(near.leaf[one], found.leaf[other])


@pytest.mark.parametrize("number", range(12))
def test_points_inside(number):
    rng = np.random.default_rng(100 + number)
    tree, known = random_tree(rng, int(rng.integers(1, 13)))
    points = rng.uniform(-2.5, 2.5, (4000, 3))
    assert np.array_equal(tree.contains(points), inside(tree, known, points))


@pytest.mark.parametrize("number", range(12))
def test_kept_elements_lie_where_the_tree_changes_its_mind(number):
    rng = np.random.default_rng(200 + number)
    tree, known = random_tree(rng, int(rng.integers(2, 9)))
    if not (np.isfinite(tree.bounds).all() and isinstance(tree, Tree)):
        return
    elements = tree.patches(3000)
    step = 1e-6
    below = inside(tree, known, elements.points - step * elements.normals)
    above = inside(tree, known, elements.points + step * elements.normals)
    assert (below & ~above).mean() > 0.999 if len(elements) else True  # but for elements at an edge


def test_the_bits_are_the_same_on_one_and_two_threads():
    rng = np.random.default_rng(17)
    tree, _ = random_tree(rng, 10)
    lines = lines_round(around(), 30_000, seed=4)
    points = rng.uniform(-2.0, 2.0, (30_000, 3))
    with threads_for(10**9, 1):
        one, held = tree.cross(lines), tree.contains(points)
    with threads_for(10**9, 2):
        two, held_by_two = tree.cross(lines), tree.contains(points)
    for name in ("offsets", "t", "cosine", "weight", "leaf"):
        assert np.array_equal(getattr(one, name), getattr(two, name))
    assert np.array_equal(held, held_by_two)


def test_lines_with_many_crossings_are_swept_again():
    """Few crossings a line are noted at once; a comb of plates has far more."""
    plates = [surfel.Box((4.0, 4.0, 0.02)).translated((0.0, 0.0, 0.1 * k)) for k in range(40)]
    comb = surfel.Union(*plates)
    rng = np.random.default_rng(19)
    steep = np.column_stack([rng.uniform(-0.1, 0.1, (200, 2)), np.ones(200)])
    found = comb.cross(Lines.of(rng.uniform(-1.0, 1.0, (200, 3)), steep, 1.0))
    assert (found.counts == 80).all()
    assert (np.diff(found.t.reshape(200, 80), axis=1) > 0.0).all()
    assert np.array_equal(found.leaf.reshape(200, 80), np.tile(np.repeat(np.arange(40), 2), (200, 1)))
