"""Survivors: of each cloud in a tree, which surfels are seen for certain, and which a cut may pass.

Two leaves are compared once, and the answer is kept while both live. So a moving camera reuses everything, and a tree
that is built anew over the same leaves, or with one leaf moved, only what has changed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError
from surfel.inside.classes import IN, ON_OPPOSED, ON_SAME
from surfel.rendering.asking import asked
from surfel.rendering.bits import Beside, Bits, survival
from surfel.rendering.cuts import FAR, RING, cut_planes, ring
from surfel.rendering.splats import AROUND, Splats, splats_of
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

if TYPE_CHECKING:
    from surfel.rendering.scene import Item

_COMMON = 0.99  # share of the radii that a classifier is asked to reach for; larger disks count as near


class Survivors(NamedTuple):
    """Rows of a cloud's splats that may be seen."""

    rows: NDArray[np.int64]
    edge: Booleans
    """Of these, which a cut may pass."""
    cuts: Floats
    """And where, as :func:`surfel.rendering.cuts.cut_planes` tells it, shape (m, 5); (0, 5) where that is not known."""

    @classmethod
    def all(cls, count: int) -> Survivors:
        """Return that everything is seen."""
        return cls(np.arange(count), np.zeros(count, np.bool_), np.empty((0, 5)))


_pairs: WeakKeyDictionary[Surfels, WeakKeyDictionary[Shape, Beside]] = WeakKeyDictionary()
_lock = threading.RLock()


def survivors_of(item: Item, leaf: int) -> Survivors:
    """Return what survives of a cloud in its tree."""
    cloud, tree, rule = item.leaves[leaf], item.shape, item.rule
    assert isinstance(cloud, Surfels) and isinstance(tree, Tree) and rule is not None
    splats = splats_of(cloud)
    if splats is None:
        return Survivors.all(0)
    beside = {}
    for k, other in enumerate(item.leaves):
        if other is not cloud:
            beside[id(other)] = (
                Beside.constant(False, len(splats)) if k in rule.sheets else _beside(cloud, splats, other)
            )
    sheet = leaf in rule.sheets
    surely, perhaps = survival(tree, cloud, beside, len(splats), sheet=sheet)
    rows = np.flatnonzero(surely | perhaps)
    return Survivors(rows, perhaps[rows], _cuts(tree, cloud, splats, beside, perhaps, sheet)[rows])


def _cuts(
    tree: Tree, cloud: Surfels, splats: Splats, beside: Mapping[int, Beside], perhaps: Booleans, sheet: bool
) -> Floats:
    """Return where disks are cut that the surface of one other cloud passes, and of no other leaf."""
    count = len(splats)
    cuts = np.zeros((count, 5))
    cuts[:, 4] = FAR
    unknown = {name: bits.below.must != bits.below.may for name, bits in beside.items()}
    passing = np.sum([*unknown.values(), np.zeros(count)], axis=0)
    for other in tree.leaves:
        mine = perhaps & (passing == 1) & unknown.get(id(other), False)
        if not isinstance(other, Surfels) or not mine.any():
            continue
        outside, inside = (
            survival(tree, cloud, {**beside, id(other): Beside.constant(value, count)}, count, sheet=sheet).surely
            for value in (False, True)
        )
        rows, there = np.flatnonzero(mine & (outside != inside)), splats_of(other)
        if len(rows) and there is not None:
            cuts[rows] = cut_planes(splats, rows, there, np.where(inside[rows], 1.0, -1.0))
    return cuts


def _beside(cloud: Surfels, splats: Splats, other: Shape) -> Beside:
    """Return which surfels of a cloud lie inside another leaf; not known where its surface is near."""
    with _lock:
        known = _pairs.setdefault(cloud, WeakKeyDictionary())
        if other not in known:
            known[other] = _in_cloud(cloud, splats, other) if isinstance(other, Surfels) else _in_solid(splats, other)
        return known[other]


def _in_cloud(cloud: Surfels, splats: Splats, other: Surfels) -> Beside:
    """Ask the classifier of the other cloud, block by block; within a patch where both coincide all is known."""
    n = len(splats)
    if not len(other):
        return Beside.constant(False, n)
    reach = float(np.quantile(splats.radii, _COMMON))
    rest, motion = cloud._at_rest
    operand = rest.operand
    found = asked(other, operand, pose=motion, reach=reach)
    kind, near = np.empty(len(rest), np.int8), np.empty(len(rest), np.bool_)
    kind[operand.order] = found.kind
    near[operand.order] = found.near | (found.kind > IN)
    kind, near = kind[splats.rows], near[splats.rows] | (splats.radii > reach)
    places = np.flatnonzero(near & (kind <= IN))
    near[places] = _parted(splats, places, kind[places] == IN, lambda points: asked(other, points).inside)
    on = kind > IN
    if on.any() and n > AROUND:
        rows = np.flatnonzero(on)
        on[rows] = (kind[splats.index.knn(AROUND, rows)[1]] == kind[rows, None]).all(axis=1)
    else:
        on[:] = False
    inside, unsure = kind == IN, near & ~on
    below, above = inside | (on & (kind == ON_SAME)), inside | (on & (kind == ON_OPPOSED))
    return Beside(_bits(below, unsure), _bits(above, unsure), on)


def _in_solid(splats: Splats, other: Shape) -> Beside:
    """Ask an exact solid for a ring of places round each disk that its box comes near."""
    n = len(splats)
    points = splats.places()
    inside, near = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    try:
        box = np.asarray(other.bounds)
    except InputError:  # a mesh without triangles
        return Beside.constant(False, n)
    wide = RING * splats.radii[:, None]
    some = np.flatnonzero(((points >= box[0] - wide) & (points <= box[1] + wide)).all(axis=1))
    if not len(some):
        return Beside.constant(False, n)
    inside[some] = other._contains(points[some])
    near[some] = _parted(splats, some, inside[some], other._contains)
    found = _bits(inside, near)
    return Beside(found, found, np.zeros(n, np.bool_))


def _parted(
    splats: Splats, rows: NDArray[np.int64], inside: Booleans, contains: Callable[[Floats], Booleans]
) -> Booleans:
    """Tell of some disks whether their centres and a ring of places round them lie on both sides of a surface."""
    parted = np.zeros(len(rows), np.bool_)
    for places in ring(splats, rows):
        parted |= contains(places) != inside
    return parted


def _bits(inside: Booleans, near: Booleans) -> Bits:
    return Bits(inside & ~near, inside | near)
