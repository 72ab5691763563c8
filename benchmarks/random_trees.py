"""Random Boolean trees of exact primitives, for coverage of intervals: the same number gives the same tree."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import surfel
from surfel.shapes.base import Shape

_MOST_LEAVES = 8
_REACH = 0.9  # of the middles of leaves from the origin
_STRETCHED = 0.25  # share of the leaves under a map that is not rigid

_Make = Callable[[np.random.Generator], Shape]

PRIMITIVES: dict[str, _Make] = {
    "box": lambda r: surfel.Box(tuple(r.uniform(0.5, 2.0, 3))),
    "sphere": lambda r: surfel.Sphere(r.uniform(0.4, 1.1)),
    "ellipsoid": lambda r: surfel.Ellipsoid(tuple(r.uniform(0.3, 1.2, 3))),
    "cylinder": lambda r: surfel.Cylinder(r.uniform(0.2, 0.9), r.uniform(0.5, 2.5)),
    "cone": lambda r: surfel.Cone(r.uniform(0.4, 1.1), r.choice([0.0, 0.3]), r.uniform(0.5, 2.0)),
    "torus": lambda r: surfel.Torus(r.uniform(0.5, 1.0), r.uniform(0.1, 0.45)),
}


def random_tree(number: int) -> Shape:
    """Return tree ``number``: one to eight leaves, turned and moved, joined at random by ``| & -``."""
    random = np.random.default_rng((20_030_605, number))
    parts = [_leaf(random) for _ in range(random.integers(1, _MOST_LEAVES + 1))]
    while len(parts) > 1:
        first, second = (parts.pop(int(random.integers(len(parts)))) for _ in range(2))
        operation = random.choice(["|", "&", "-"], p=[0.45, 0.2, 0.35])
        joined = {"|": first | second, "-": first - second, "&": first & second}[str(operation)]
        parts.append(joined)
    return parts[0]


def _leaf(random: np.random.Generator) -> Shape:
    leaf = PRIMITIVES[str(random.choice(list(PRIMITIVES)))](random)
    if random.random() < _STRETCHED:
        leaf = leaf.scaled(tuple(random.uniform(0.5, 1.6, 3)))
    turned = leaf.rotated(random.standard_normal(3), float(random.uniform(0.0, 360.0)))
    if random.random() < 0.1:  # a plane cuts it
        normal = random.standard_normal(3)
        turned = turned & surfel.HalfSpace(tuple(normal / np.linalg.norm(normal)), float(random.uniform(-0.2, 0.5)))
    return turned.translated(random.uniform(-_REACH, _REACH, 3))
