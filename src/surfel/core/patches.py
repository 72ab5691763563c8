"""Patches: elements of a surface, each with a place, a normal and an area."""

from __future__ import annotations

from dataclasses import dataclass

from surfel.core.cast import Floats


@dataclass(frozen=True, eq=False)
class Patches:
    """Elements of a surface: a cloud's are its local cells, a primitive's and a mesh's are samples of its surface.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Where each element lies.
    normals : Floats, shape (n, 3)
        Unit normals, outward where the surface is closed and oriented.
    areas : Floats, shape (n,)
        The area that each element stands for; their sum is the area of the surface.
    """

    points: Floats
    normals: Floats
    areas: Floats

    def __len__(self) -> int:
        return len(self.points)
