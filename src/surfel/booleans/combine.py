"""combine(): the Boolean result of an expression, as surfels that are sharp at the cut."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from surfel._numba import compile_seconds
from surfel.booleans.assemble import Cut, assembled
from surfel.booleans.by_solid import SolidLeaf
from surfel.booleans.findings import Findings, findings_of
from surfel.booleans.join import joined
from surfel.booleans.kept import Kept
from surfel.booleans.leaf import CloudLeaf, Leaf
from surfel.booleans.part import Part
from surfel.booleans.result import Combination
from surfel.booleans.sampling import DEFAULT, size_of, surfels_of
from surfel.booleans.sides import Rule, Sides, as_tree, is_sheet
from surfel.core.cast import Booleans, Floats, as_choice, as_count, as_positive
from surfel.core.errors import InputError
from surfel.core.together import together
from surfel.inside.decision import SHEETS
from surfel.inside.judges import NAMES
from surfel.shapes.base import Shape
from surfel.shapes.extent import bounded, boxes_of, is_empty
from surfel.shapes.program import where_leaves_matter
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree, postorder

CUTS = ("clip", "split", "none")
_HEAVY = 30  # a surfel takes the time of so many of the items that threads are started for


def combine(
    tree: Shape,
    cut: str = "clip",
    judge: str = "auto",
    level: int | None = None,
    tolerance: float | None = None,
    spacing: float | None = None,
    seed: int = 0,
) -> Combination:
    """Combine clouds and exact solids by a Boolean expression.

    No mesh is made and no intermediate solid. Every surfel of every operand is told where it lies in all the others;
    the expression then says whether it stays, and whether it is turned over. A surfel that the surface of another
    operand passes is cut there: it stays, though its centre may be outside, with planes that clip it. The surfaces of
    exact operands are sampled as densely as the clouds, where the result may have them.

    Parameters
    ----------
    tree : Shape
        An expression like ``(a | b) - c`` over clouds, primitives and meshes, of any depth. A cloud is taken for a
        solid unless it says that it is a sheet (``solid=False``).
    cut : {"clip", "split", "none"}
        ``clip`` gives the surfels at the cut clip planes; ``split`` divides them into smaller ones; ``none`` lets
        their centres decide.
    judge : str
        Which judge tells the inside of clouds that do not say so themselves (:meth:`Surfels.with_judge`); ``auto``
        chooses for each from its noise, flips and edges.
    level : int, optional
        With ``split``: so often are surfels halved along both directions, 1 to 8; 3 by default.
    tolerance : float, optional
        With ``split``, in place of a level: how far what is left may reach over the cut.
    spacing : float, optional
        How far apart the surfels of exact operands lie; by default as those of the finest cloud, or such that about
        65,536 cover all exact operands.
    seed : int
        Of the sampling of exact operands.

    Returns
    -------
    Combination
        ``surfels`` is the result; see there for the rest.

    Raises
    ------
    InputError
        If an argument cannot be used, a sheet is subtracted or two are intersected, or an exact operand has no end.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*; the cut after Wicke (clip planes) and after Adams and Dutre
    (splitting).

    Examples
    --------
    >>> import surfel
    >>> lens = surfel.combine(surfel.Sphere(1) & surfel.Sphere(1).translated((1, 0, 0)), spacing=0.05)
    >>> abs(surfel.measure(lens.surfels).area.value / 6.2832 - 1) < 0.01
    True
    """
    started, compiled = time.perf_counter(), compile_seconds()
    root = as_tree(tree)
    as_choice(cut, "cut", CUTS)
    as_choice(judge, "judge", ("auto", SHEETS, *NAMES))
    depth = None if level is None else as_count(level, "level", 1, 8)
    width = None if tolerance is None else as_positive(tolerance, "tolerance")
    if (depth is not None or width is not None) and cut != "split":
        raise InputError(f"level and tolerance belong to cut='split'; got cut={cut!r}")
    if depth is not None and width is not None:
        raise InputError("give either a level or a tolerance, not both")
    work = _Work(root, judge, None if spacing is None else as_positive(spacing, "spacing"), as_count(seed, "seed", 0))
    work.colour()
    parts = [work.part(k) for k in range(len(root.leaves))]
    how = Cut(cut, depth, width)
    near = [work.others(part) for part in parts]
    sizes = [_HEAVY * len(part) for part in parts]
    kept = together(lambda k: assembled(parts[k], near[k], work.rule, how), range(len(parts)), sizes)
    surfels = joined(parts, kept, work.solid())
    found = work.findings()
    compiling = compile_seconds() - compiled
    return Combination(
        surfels,
        tuple(len(k.rows) for k in kept),
        sum(k.cut for k in kept),
        *found,
        time.perf_counter() - started - compiling,
        compiling,
        work.tracing(parts, kept),
    )


class _Work:
    """The leaves of a tree, made ready."""

    def __init__(self, tree: Tree, judge: str, spacing: float | None, seed: int) -> None:
        self.tree = tree
        self.seed = seed
        self.sheets = {k for k, leaf in enumerate(tree.leaves) if is_sheet(leaf)}
        self.rule = Rule(tree, self.sheets)
        boxes = boxes_of(tree)
        self.boxes = [boxes[id(leaf)] for leaf in tree.leaves]
        self.leaves: dict[int, Leaf] = {}
        for k, leaf in enumerate(tree.leaves):
            if k not in self.sheets and not is_empty(self.boxes[k]):
                self.leaves[k] = CloudLeaf(leaf, judge) if isinstance(leaf, Surfels) else SolidLeaf(leaf, self.boxes[k])
        self.exact = [k for k, leaf in enumerate(tree.leaves) if not isinstance(leaf, Surfels)]
        if self.exact:
            self.frame = bounded(tree)
            self.reach = where_leaves_matter(tree, postorder(tree))
            self.spacing = spacing or self._usual_spacing()
        self._asked: set[int] = set()

    def colour(self) -> None:
        """Build the classifiers of the clouds that somebody may ask, side by side."""
        asked = [leaf for k, leaf in self.leaves.items() if isinstance(leaf, CloudLeaf) and self._meets_another(k)]
        together(lambda leaf: leaf.classifier, asked, [_HEAVY * len(leaf.cloud) for leaf in asked])

    def part(self, k: int) -> Part:
        """Return the surfels of a leaf."""
        leaf = self.tree.leaves[k]
        if not isinstance(leaf, Surfels):
            return self._drawn(k)
        mine = self.leaves.get(k)
        if isinstance(mine, CloudLeaf) and self._meets_another(k):
            return Part(k, leaf, mine.classifier.operand, exact=False)
        return Part(k, leaf, leaf.operand, exact=False)

    def _meets_another(self, k: int) -> bool:
        return any(_meet(self.boxes[k], self.boxes[j]) for j in self.leaves if j != k)

    def others(self, part: Part) -> dict[int, Leaf]:
        """Return the leaves that the surfels of a part may lie in or touch."""
        if not len(part):
            return {}
        low, high = part.operand.bounds + part.operand.origin
        margin = 2.0 * float(part.reach.max())
        near = {
            j: leaf
            for j, leaf in self.leaves.items()
            if j != part.leaf and _meet(np.stack([low - margin, high + margin]), self.boxes[j])
        }
        self._asked.update(near)
        return near

    def _drawn(self, k: int) -> Part:
        """Sample an exact leaf where the tree may keep or cut its surface."""
        leaf = self.tree.leaves[k]
        box = self.reach[k]
        if is_empty(box):
            cloud = Surfels(np.empty((0, 3)), np.empty((0, 3)))
        else:
            limits = np.clip(box, self.frame[0] - 1.0, self.frame[1] + 1.0) if not np.isfinite(box).all() else box

            def wanted(points: Floats, normals: Floats) -> Booleans:
                sides: dict[int, Sides] = {}
                near = np.zeros(len(points), bool)
                for j, other in self.leaves.items():
                    if j != k and _meet(limits, self.boxes[j]):
                        sides[j], close = other.sift(points, normals, 3.0 * self.spacing)
                        near |= close
                return np.asarray(near | (self.rule.keeps(k, sides, len(points)) != 0))

            cloud = surfels_of(leaf, limits, self.spacing, wanted, self.seed + k)
        return Part(k, cloud, cloud.operand, exact=True)

    def _usual_spacing(self) -> float:
        """Return the spacing of the finest cloud; without one, what makes a usual number of surfels."""
        clouds = [leaf.operand.spacing for leaf in self.tree.leaves if isinstance(leaf, Surfels) and len(leaf) > 1]
        fine = [value for value in clouds if value > 0.0]
        if fine:
            return min(fine)
        sizes = [size_of(self.tree.leaves[k], self.frame) for k in self.exact if not is_empty(self.reach[k])]
        return float(np.sqrt(sum(sizes) / DEFAULT)) or 1.0

    def solid(self) -> bool | None:
        """Tell whether the result is known to bound a solid."""
        if self.sheets:
            return None
        return True if not self.findings().leaky else None

    def tracing(self, parts: list[Part], kept: list[Kept]) -> Callable[[], list[Floats]]:
        """Return what finds the curve when it is asked for."""
        seams = {part.leaf: left.seam for part, left in zip(parts, kept, strict=True) if left.seam is not None}

        def trace() -> list[Floats]:
            from surfel.booleans.curve import traced
            from surfel.booleans.surfaces import SmoothSurface, SolidSurface, Surface

            surfaces: dict[int, Surface] = {}
            for part in parts:
                leaf = self.tree.leaves[part.leaf]
                surfaces[part.leaf] = SmoothSurface(part.operand) if isinstance(leaf, Surfels) else SolidSurface(leaf)
            return traced(seams, surfaces, {part.leaf: part.operand.spacing for part in parts})

        return trace

    def findings(self) -> Findings:
        """Return what was found out about the clouds that were asked."""
        asked = {k: leaf for k, leaf in self.leaves.items() if k in self._asked and isinstance(leaf, CloudLeaf)}
        return findings_of(asked, len(self.tree.leaves))


def _meet(a: Floats, b: Floats) -> bool:
    return bool((a[0] <= b[1]).all() and (b[0] <= a[1]).all())
