"""Space as sifting reads it against a dilation of every cell, and moves that are known not to change an answer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from surfel import InputError
from surfel._numba import threads_for
from surfel.core.affine import rotation, translation
from surfel.inside.both_ways import both_ways
from surfel.inside.classify import Classifier
from surfel.inside.falloff import falloff
from surfel.inside.grid import ALL_IN
from surfel.inside.looks import BORDERS, INSIDE, NEAR, NEAR_REACH, REACH, WIDER
from surfel.inside.moved import moved, rigid
from surfel.inside.operand import Operand

Floats = np.ndarray


def sphere(n: int, seed: int = 0) -> Floats:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    return p / np.linalg.norm(p, axis=1, keepdims=True)


def cells(table: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Return which cells have their bits set; those of bricks without words have none."""
    found = np.zeros(tuple(8 * s for s in table.shape), bool)
    for place in np.argwhere(table >= 0):
        bits = words[table[tuple(place)]][:, None] >> np.arange(64, dtype=np.uint64) & np.uint64(1)
        found[tuple(slice(8 * p, 8 * p + 8) for p in place)] = bits.reshape(8, 8, 8).astype(bool)
    return found


def some_cloud(kind: str) -> Operand:
    points = sphere(4000)
    if kind == "open":
        points = points[points[:, 2] > 0.2]
    if kind == "volume":
        return Operand.of(np.random.default_rng(0).random((3000, 3)), sphere(3000))
    return Operand.of(points, points)


@pytest.mark.parametrize("kind", ["sphere", "open", "volume", "edited"])
def test_border_is_widened_as_a_dilation_would(kind: str) -> None:
    classifier = Classifier(some_cloud(kind))
    if kind == "edited":  # then some numbers belong to no brick
        classifier = Classifier(Operand.of(sphere(40_000), sphere(40_000)))
        rows = classifier.operand.order[:5]
        edited = classifier.edited(rows, 1.03 * sphere(40_000)[rows], sphere(40_000)[rows])
        assert 0 < edited.recoloured < classifier.recoloured
        classifier = edited
    coloured = classifier._coloured
    assert coloured is not None
    grid, looks = coloured.grid, classifier._laid_out()
    columns = looks.words.reshape(-1, 8, 8)
    border = cells(grid.table, grid.border)
    for column, reach in ((BORDERS, 0), (NEAR, NEAR_REACH), (WIDER, REACH)):
        wide = border if reach == 0 else ndimage.binary_dilation(border, np.ones((3, 3, 3)), reach)
        assert (cells(looks.table, columns[:, :, column]) == wide).all()
    inside = cells(grid.table, grid.inside) | np.kron(grid.table == ALL_IN, np.ones((8, 8, 8), bool))
    found = cells(looks.table, columns[:, :, INSIDE]) | np.kron(looks.table == ALL_IN, np.ones((8, 8, 8), bool))
    assert (found == inside).all() and (looks.table >= grid.table).all()
    assert kind not in ("sphere", "edited") or (looks.table > grid.table).any()


@pytest.mark.parametrize("reach", [0.0, 0.05, 0.3])
def test_a_cloud_gets_the_answers_of_its_places(reach: float) -> None:
    """Blocks of an operand are settled together, places one by one."""
    cloud, tool = Operand.of(sphere(20_000), sphere(20_000)), Operand.of(0.9 * sphere(20_000, 1), sphere(20_000, 1))
    classifier = Classifier(cloud)
    for step in range(4):
        pose = translation([0.2, 0.1 * step, 0.05]) @ rotation([1.0, 2.0, 3.0], 37.0 * step)
        together = classifier.classify(tool, pose=pose, reach=reach)
        alone = classifier.classify(tool.points + tool.origin, tool.normals, pose, reach)
        assert (together.kind == alone.kind).all() and (together.near == alone.near).all()
        assert 0 < len(together.judged) < len(tool)


@pytest.mark.parametrize("threads", [1, 2])
def test_both_ways_is_one_way_and_the_other(threads: int) -> None:
    clouds = [Operand.of(r * sphere(30_000, seed), sphere(30_000, seed)) for r, seed in ((1.0, 0), (0.9, 1))]
    one, other = Classifier(clouds[0]), Classifier(clouds[1])
    pose = translation([0.2, 0.1, 0.05]) @ rotation([1.0, 2.0, 3.0], 37.0)
    with threads_for(10**9, threads):
        found = both_ways(one, other, pose)
    for side, alone in zip(
        found, (one.classify(clouds[1], pose=pose), other.classify(clouds[0], pose=np.linalg.inv(pose))), strict=True
    ):
        assert (side.kind == alone.kind).all() and (side.near == alone.near).all() and len(side.judged) > 0
        assert (side.judged == alone.judged).all()
        np.testing.assert_allclose(side.value, alone.value, atol=1e-12)
    with pytest.raises(InputError, match="rigid"):
        both_ways(one, other, np.diag([2.0, 2.0, 2.0, 1.0]))


def test_falloff_is_the_exponential() -> None:
    x = np.linspace(0.0, 3.0, 301)
    np.testing.assert_allclose([falloff.py_func(value) for value in x], np.exp(-x), rtol=1e-9)


def test_moved_rows_are_those_of_the_matrix() -> None:
    motion = (translation([1.0, -2.0, 3.0]) @ rotation([1.0, 1.0, 0.0], 50.0))[:3]
    points, chosen = sphere(100), np.arange(0, 100, 7)
    np.testing.assert_allclose(moved(points, chosen, motion, 1.0), points[chosen] @ motion[:, :3].T + motion[:, 3])
    np.testing.assert_allclose(moved(points, chosen, motion, 0.0), points[chosen] @ motion[:, :3].T)


def test_what_is_rigid() -> None:
    turn = rotation([1.0, 1.0, 0.0], 50.0)
    assert (rigid(turn) == turn).all() and (rigid(turn.tolist()) == turn).all() and (rigid(None) == np.eye(4)).all()
    assert (rigid(np.asfortranarray(turn)) == turn).all()
    bent, shifted, endless = turn.copy(), turn.copy(), turn.copy()
    bent[0, 0] += 1e-4
    shifted[3, 0] = 1.0
    endless[1, 3] = np.inf
    for wrong, problem in ((bent, "rigid"), (shifted, "last row"), (endless, "finite"), (2.0 * turn, "last row")):
        with pytest.raises(InputError, match=problem):
            rigid(wrong)
