"""The area of a tree by classified elements of its leaves' surfaces (Sarraga's GMSolid), taken stochastically.

Each leaf's own surface is covered by points. What the tree keeps of them is the leaf's share of the boundary. There are
two dimensions instead of the four that lines need, and nothing misses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import ConvergenceError
from surfel.core.estimate import Estimate, at_best_halved, combine_errors
from surfel.core.execute import Progress
from surfel.core.patches import Patches
from surfel.lines.sequences import from_shifts
from surfel.measuring.strata import Kept, kept_area
from surfel.shapes.elements import can_be_sampled, elements_of, rough_area
from surfel.shapes.extent import is_empty
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

MOST_POINTS = 1 << 27
"""A tolerance that asks for more points than this is refused."""

_SHIFTS = 16  # of the samples of a mesh
_LEAST = 64  # points of a leaf
_SHARE_ERROR = 0.1  # of a cell that a cut passes
_ROUNDING = 4.0 * 2.0**-52
_FEW, _MORE = 6, 24  # places in an element of a cloud: to find those that a cut passes, and in these
_GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True, eq=False)
class PatchResult:
    """The area of a tree, and of what is left of each leaf."""

    area: Estimate
    areas: tuple[Estimate, ...]
    points: int


def active_leaves(tree: Tree) -> list[int]:
    """Return the leaves that can matter at all."""
    return [k for k in range(len(tree.leaves)) if not is_empty(tree.program.boxes[k])]


def measures_by_patches(tree: Tree) -> bool:
    """Tell whether every leaf of a tree that matters has elements."""
    return all(can_be_sampled(tree.leaves[k]) for k in active_leaves(tree))


def measure_by_patches(
    tree: Tree,
    box: Floats,
    points: int,
    seed: int,
    tolerance: float | None = None,
    progress: Progress | None = None,
) -> PatchResult:
    """Measure the area of a tree.

    Parameters
    ----------
    tree : Tree
        Bounded.
    box : Floats, shape (2, 3)
        Its bounds; half-spaces end there.
    points : int
        About how many in all; they are shared out to the leaves by area.
    seed : int
        Of where the points fall.
    tolerance : float, optional
        Double the points until the half-width of the 95 % interval is at most this share of the area.
    progress : Progress, optional
        Called as the work proceeds.

    Raises
    ------
    ConvergenceError
        If more than :data:`MOST_POINTS` points would be needed.
    """
    active = active_leaves(tree)
    rough = {k: rough_area(tree.leaves[k], box) for k in active if not isinstance(tree.leaves[k], Surfels)}
    whole = math.fsum(rough.values()) or 1.0
    known: dict[int, tuple[Estimate, int]] = {}
    wanted, spent = points, 0
    before: Estimate | None = None
    while True:
        for place, k in enumerate(active):
            if k in rough:
                share = max(_LEAST, math.ceil(wanted * rough[k] / whole))
                random = np.random.default_rng((seed, 3, k, wanted))
                known[k] = _part_of_solid(tree, k, box, share, random) if rough[k] else (Estimate(0.0, 0.0), 0)
            elif k not in known:
                known[k] = _part_of_cloud(tree, k)
            spent += known[k][1]
            if progress is not None:
                progress((place + 1) / len(active), "judging elements")
        area = _sum_of([estimate for estimate, _ in known.values()])
        area = area if before is None else at_best_halved(area, before)
        before = area
        width = _half_width(area, whole)
        if tolerance is None or width <= tolerance:
            areas = tuple(known[k][0] if k in known else Estimate(0.0, 0.0) for k in range(len(tree.leaves)))
            return PatchResult(area, areas, spent)
        if not rough or 2 * wanted > MOST_POINTS:
            raise ConvergenceError(
                f"the area is not known to {tolerance:g} of its value after {spent:,} elements, but to {width:.2g}; "
                "ask for less"
            )
        wanted *= 2


def _part_of_solid(tree: Tree, k: int, box: Floats, points: int, random: np.random.Generator) -> tuple[Estimate, int]:
    """Return the part of an exact leaf's area, or of a mesh's, that the tree keeps."""
    boxes = tree.program.boxes
    apart = (boxes[k, 0] > boxes[:, 1]).any(axis=1) | (boxes[:, 0] > boxes[k, 1]).any(axis=1)
    alone = int((~apart).sum()) <= 1
    if isinstance(tree.leaves[k], Mesh):
        return _part_of_mesh(tree, k, box, points, random)
    kept: Kept = kept_area(tree, k, box, points, random, alone)
    error = math.hypot(math.sqrt(kept.variance), _ROUNDING * kept.area)
    return Estimate(kept.area, error, freedom=kept.freedom), kept.points


def _part_of_mesh(tree: Tree, k: int, box: Floats, points: int, random: np.random.Generator) -> tuple[Estimate, int]:
    """Return the part of a mesh: from sixteen systematic samples along a curve through its triangles."""
    count = -(-points // _SHIFTS)
    values = []
    for _ in range(_SHIFTS):
        found = elements_of(tree.leaves[k], np.empty((count, 2)), box, int(random.integers(1 << 32)))
        values.append(float(found.areas @ (tree.program.keeps(found.points, found.normals, k) != 0)))
    mean, error, freedom = from_shifts(values)
    return Estimate(mean, math.hypot(error, _ROUNDING * mean), freedom=freedom), count * _SHIFTS


def _sum_of(parts: list[Estimate]) -> Estimate:
    """Add independent estimates; the degrees of freedom are those of Welch and Satterthwaite."""
    value = math.fsum(float(part.value) for part in parts)
    error = float(combine_errors(*(part.standard_error for part in parts))) if parts else 0.0
    weak = sum((float(part.standard_error) / error) ** 4 / part.freedom for part in parts) if error else 0.0
    reasons = [part.reason for part in parts if part.reason]
    return Estimate(value, error, not reasons, "; ".join(reasons), 1.0 / weak if weak else math.inf)


def _part_of_cloud(tree: Tree, k: int) -> tuple[Estimate, int]:
    """Return the part of a cloud's area that a tree keeps, and how many cells were judged.

    The error joins that of the cloud's area with that of the cells that the cut passes: their shares are those of disks
    of their size, good to about a tenth.
    """
    cloud = tree.leaves[k]
    assert isinstance(cloud, Surfels)
    surface = cloud.surface
    if surface.local is None:
        return Estimate.unknown(f"the {len(cloud)} points show no surface", 0.0), 0
    local, sampling = surface.known
    patches = surface.patches
    if local.area == 0.0:
        return Estimate(0.0, 0.0), len(patches)
    share = _kept_shares(tree, k, patches)
    part = float((patches.areas * share).sum())
    whole = float(patches.areas.sum())
    cut = patches.areas * (share > 0.0) * (share < 1.0) * _SHARE_ERROR
    square = surface.scale**2
    sampled = sampling.standard_error * square * (part / whole) ** 0.5
    error = combine_errors(sampled, math.sqrt(float((cut * cut).sum())))
    return Estimate(part, float(error)), len(patches)


def _kept_shares(tree: Tree, k: int, patches: Patches) -> Floats:
    """Return which share of each element the tree keeps, from places in a disk of its size.

    Places round its rim tell which elements a cut passes, and more places what it leaves of these. Where the surface of
    another cloud coincides with an element, its own place decides: about it, the other cloud is as rough as this one.
    """
    program = tree.program
    share = _share_of(tree, k, patches, np.arange(len(patches)), _rim(_FEW))
    cut = np.flatnonzero((share > 0.0) & (share < 1.0))
    share[cut] = _share_of(tree, k, patches, cut, _disk(_MORE))
    same = cut[program.meets_cloud(patches.points[cut], patches.normals[cut], k)]
    share[same] = program.keeps(patches.points[same], patches.normals[same], k) != 0
    return share


def _share_of(tree: Tree, k: int, patches: Patches, rows: NDArray[np.int64], steps: Floats) -> Floats:
    points, normals = patches.points[rows], patches.normals[rows]
    helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = np.cross(normals, helper)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    along = np.cross(normals, across)
    angle = (rows * _GOLDEN)[:, None]  # each turned by another angle: a cut mostly runs the same way through many
    across, along = across * np.cos(angle) + along * np.sin(angle), along * np.cos(angle) - across * np.sin(angle)
    radius = np.sqrt(np.maximum(patches.areas[rows], 0.0) / math.pi)[:, None]
    kept: NDArray[np.float64] = np.zeros(len(rows))
    for u, v in steps:
        kept += tree.program.keeps(points + radius * (u * across + v * along), normals, k) != 0
    return kept / len(steps)


def _rim(count: int) -> Floats:
    """Return places evenly round the rim of the unit disk."""
    angle = np.arange(count) * (2.0 * math.pi / count)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _disk(count: int) -> Floats:
    """Return places in the unit disk, each for as much of its area: on a spiral that turns by the golden angle."""
    ring = np.arange(count) + 0.5
    radius, angle = np.sqrt(ring / count), ring * _GOLDEN
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _half_width(estimate: Estimate, whole: float) -> float:
    """Return half of the 95 % interval as a share of the value; of an empty tree, of all its leaves."""
    low, high = estimate.interval(0.95)
    half = 0.5 * float(high - low)
    return half / (abs(float(estimate.value)) or whole) if half else 0.0
