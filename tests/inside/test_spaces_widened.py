"""The widened border against a dilation of every cell, and moves that are known not to change an answer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from surfel import InputError
from surfel.core.affine import rotation, translation
from surfel.inside.classify import Classifier
from surfel.inside.moved import moved, rigid
from surfel.inside.operand import Operand
from surfel.inside.widened import REACH, widened

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


@pytest.mark.parametrize("kind", ["sphere", "open", "volume"])
def test_border_is_widened_as_a_dilation_would(kind: str) -> None:
    points = sphere(4000)
    if kind == "open":
        points = points[points[:, 2] > 0.2]
    cloud = Operand.of(points, points)
    if kind == "volume":
        cloud = Operand.of(np.random.default_rng(0).random((3000, 3)), sphere(3000))
    coloured = Classifier(cloud)._coloured
    assert coloured is not None
    grid = coloured.grid
    wide = ndimage.binary_dilation(cells(grid.table, grid.border), np.ones((3, 3, 3)), REACH)
    held = cells(grid.table, np.full_like(grid.border, np.iinfo(np.uint64).max))
    assert (cells(grid.table, widened(grid)) == (wide & held)).all()


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
