"""Random points on the surface of exact solids and of trees: drawn on the leaves, kept where the tree keeps them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.shapes.elements import can_be_sampled, elements_of, exact_area, kept_elements
from surfel.shapes.extent import bounded, is_empty
from surfel.shapes.mesh import Mesh
from surfel.shapes.primitives.primitive import square_points
from surfel.shapes.sample_mesh import OfMesh, Samples, some_area
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

_PILOT = 4096
_ABOVE = 1.1  # times the densest place of the pilot, above which no place is
_ROUNDS = 200


class OfSolid:
    """Draws from the surface of a tree."""

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.box = bounded(tree)
        self.area = some_area(float(kept_elements(tree, 1 << 16).areas.sum()))
        self.leaves = [k for k in range(len(tree.leaves)) if not is_empty(tree.program.boxes[k])]
        self.most = np.array([self._most(k) for k in self.leaves])

    def random(self, n: int, rng: np.random.Generator) -> Samples:
        """Return ``n`` independent points, uniform by area; ``triangles`` are the leaves that they lie on."""
        share = self.most / self.most.sum()
        found: list[Samples] = []
        have = 0
        for _ in range(_ROUNDS):
            tries = int(1.1 * (n - have) * self.most.sum() / self.area) + 64
            counts = rng.multinomial(min(tries, 1 << 22), share)
            drawn = [self._draw(k, int(count), rng) for k, count in zip(self.leaves, counts, strict=True) if count]
            found += drawn
            have += sum(len(part.points) for part in drawn)
            if have >= n:
                break
        else:
            raise InputError(f"only {have} of {n} points were found: too little of the leaves' surfaces is left")
        every = [np.concatenate([part[field] for part in found]) for field in range(3)]
        rows = rng.permutation(have)[:n]
        return Samples(every[0][rows], every[1][rows], every[2][rows])

    def _most(self, k: int) -> float:
        """Return the area that the whole leaf would have if it were everywhere as dense as where it is densest."""
        leaf = self.tree.leaves[k]
        if isinstance(leaf, Surfels):
            return float(leaf.surface.patches.areas.sum())
        if isinstance(leaf, Mesh):
            return leaf.area
        density = elements_of(leaf, square_points(_PILOT), self.box).areas * _PILOT
        if len(density) == 0:
            return 0.0
        even = exact_area(leaf, self.box) is not None and np.ptp(density) <= 1e-9 * density.max()
        return float(density.max()) * (1.0 if even else _ABOVE)

    def _draw(self, k: int, count: int, rng: np.random.Generator) -> Samples:
        leaf = self.tree.leaves[k]
        points, normals, taken = self._on_leaf(leaf, k, count, rng)
        points, normals = points[taken], normals[taken]
        kept = self.tree.program.keeps(points, normals, k)
        rows = kept != 0
        return Samples(points[rows], normals[rows] * kept[rows, None], np.full(int(rows.sum()), k, np.int32))

    def _on_leaf(
        self, leaf: object, k: int, count: int, rng: np.random.Generator
    ) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        if isinstance(leaf, Surfels):
            patches = leaf.surface.patches
            chosen = rng.choice(len(patches), count, p=patches.areas / patches.areas.sum())
            return patches.points[chosen], patches.normals[chosen], np.ones(count, np.bool_)
        if isinstance(leaf, Mesh):
            drawn = OfMesh(leaf).random(count, rng)
            return drawn.points, drawn.normals, np.ones(count, np.bool_)
        if not can_be_sampled(self.tree.leaves[k]):
            raise InputError("a leaf of the tree is known by its equation alone; its surface cannot be sampled")
        found = elements_of(self.tree.leaves[k], rng.random((count, 2)), self.box)
        taken = rng.random(count) * self.most[self.leaves.index(k)] < found.areas * count
        return found.points, found.normals, taken
