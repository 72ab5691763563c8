"""Areas of primitives under maps that change their shape, where a closed form or one sum over a circle tells them."""

from __future__ import annotations

import math

import numpy as np

from surfel.core.cast import Floats
from surfel.shapes.primitives.box import Box
from surfel.shapes.primitives.cylinder import Cone, Cylinder
from surfel.shapes.primitives.ellipsoid import Ellipsoid, Sphere
from surfel.shapes.primitives.primitive import Primitive

_ROUND = 4096


def area_under(shape: Primitive, linear: Floats) -> float | None:
    """Return the area of a primitive under a linear map; None where only sampling tells.

    A vector that stands for a piece of area is mapped by the cofactor matrix (Nanson's formula).

    Parameters
    ----------
    shape : Primitive
        In its own frame.
    linear : Floats, shape (3, 3)
        Not singular.
    """
    cofactor: Floats = float(np.linalg.det(linear)) * np.linalg.inv(linear).T.astype(np.float64)
    if isinstance(shape, Box):
        return 2.0 * math.fsum(shape._pairs * np.linalg.norm(cofactor, axis=0))
    if isinstance(shape, Sphere):
        return Ellipsoid(tuple(np.linalg.svd(shape.radius * linear, compute_uv=False))).area
    if isinstance(shape, Ellipsoid):
        return Ellipsoid(tuple(np.linalg.svd(linear * np.asarray(shape.radii), compute_uv=False))).area
    if isinstance(shape, Cylinder):
        return _area_round(shape.radius, shape.radius, shape.height, cofactor)
    if isinstance(shape, Cone):
        return _area_round(shape.bottom, shape.top, shape.height, cofactor)
    return None


def _area_round(bottom: float, top: float, height: float, cofactor: Floats) -> float:
    """Add up the side of a cone round its axis (the rule converges faster than any power), and the two disks."""
    angle = 2.0 * np.pi * np.arange(_ROUND) / _ROUND
    normals = np.stack([height * np.cos(angle), height * np.sin(angle), np.full(_ROUND, bottom - top)])
    side = float(np.linalg.norm(cofactor @ normals, axis=0).mean()) * math.pi * (bottom + top)
    return side + math.pi * (bottom**2 + top**2) * float(np.linalg.norm(cofactor[:, 2]))
