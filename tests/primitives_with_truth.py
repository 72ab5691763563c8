"""Exact primitives beside slow, obvious distances to their surfaces, which share nothing with the kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import surfel
from surfel.core.affine import reflection, rotation, scaling, translation
from surfel.core.lines import Lines

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A primitive, the signed distance to its surface (to first order), and how large it is."""

    name: str
    shape: surfel.Box
    distance: Callable[[Floats], Floats]
    size: float


def to_box(*size):
    return lambda p: (np.abs(p) - 0.5 * np.array(size)).max(axis=1)


def to_ellipsoid(*radii):
    r = np.array(radii)
    return lambda p: (((p / r) ** 2).sum(axis=1) - 1.0) / (2.0 * np.linalg.norm(p / r**2, axis=1))


def to_cone(bottom, top, height):
    slope = (top - bottom) / height

    def distance(p):
        side = (np.hypot(p[:, 0], p[:, 1]) - 0.5 * (bottom + top) - slope * p[:, 2]) / np.hypot(1.0, slope)
        return np.maximum(side, np.abs(p[:, 2]) - 0.5 * height)

    return distance


def to_torus(major, minor):
    return lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - major, p[:, 2]) - minor


def to_cyclide(a, b, d):
    """The nearest ball by Newton's method on its angle, from many starts: no use is made of the closed form."""
    c = np.sqrt(a * a - b * b)

    def distance(p):
        angle = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)[:, None]
        for step in range(10):
            cos, sin = np.cos(angle), np.sin(angle)
            gap = np.sqrt((p[:, 0] - a * cos) ** 2 + (p[:, 1] - b * sin) ** 2 + p[:, 2] ** 2) - (d - c * cos)
            best = np.take_along_axis(np.broadcast_to(angle, gap.shape), gap.argmin(axis=0)[None], axis=0)
            if step == 9:
                return gap.min(axis=0)
            angle = best + np.linspace(-1.0, 1.0, 17)[:, None] * (np.pi / 64) * 0.15**step

    return distance


def to_quadric(matrix):
    def distance(p):
        h = np.concatenate([p, np.ones((len(p), 1))], axis=1)
        return np.einsum("ni,ij,nj->n", h, matrix, h) / (2.0 * np.linalg.norm(h @ matrix[:, :3], axis=1))

    return distance


ELLIPSOID = np.array([[2.0, 0.3, 0.0, -0.5], [0.3, 1.0, 0.2, 0.1], [0.0, 0.2, 0.7, 0.2], [-0.5, 0.1, 0.2, -1.0]])
"""A quadric that is an ellipsoid, turned and moved."""

CASES = [
    Case("box", surfel.Box((1.0, 2.0, 3.0)), to_box(1.0, 2.0, 3.0), 3.0),
    Case("sphere", surfel.Sphere(2.0), to_ellipsoid(2.0, 2.0, 2.0), 2.0),
    Case("ellipsoid", surfel.Ellipsoid((1.0, 0.5, 2.0)), to_ellipsoid(1.0, 0.5, 2.0), 2.0),
    Case("cylinder", surfel.Cylinder(1.0, 3.0), to_cone(1.0, 1.0, 3.0), 3.0),
    Case("rod", surfel.Cylinder(0.01, 3.0), to_cone(0.01, 0.01, 3.0), 3.0),
    Case("frustum", surfel.Cone(1.0, 0.4, 2.0), to_cone(1.0, 0.4, 2.0), 2.0),
    Case("cone", surfel.Cone(1.0, 0.0, 2.0), to_cone(1.0, 0.0, 2.0), 2.0),
    Case("turned cone", surfel.Cone(0.001, 1.0, 1.0), to_cone(0.001, 1.0, 1.0), 1.0),
    Case("torus", surfel.Torus(2.0, 0.7), to_torus(2.0, 0.7), 2.7),
    Case("wire torus", surfel.Torus(1.0, 0.01), to_torus(1.0, 0.01), 1.0),
    Case("fat torus", surfel.Torus(1.0, 0.99), to_torus(1.0, 0.99), 2.0),
    Case("cyclide", surfel.Cyclide(3.0, 2.9, 1.0), to_cyclide(3.0, 2.9, 1.0), 4.0),
    Case("uneven cyclide", surfel.Cyclide(1.0, 0.6, 0.9), to_cyclide(1.0, 0.6, 0.9), 1.9),
    Case("pinched cyclide", surfel.Cyclide(1.0, 0.8, 0.61), to_cyclide(1.0, 0.8, 0.61), 1.6),
    Case("quadric", surfel.Quadric(ELLIPSOID), to_quadric(ELLIPSOID), 1.5),
]
"""Bounded primitives; all but the quadric can be sampled."""

PLACEMENTS = {
    "in place": np.eye(4),
    "turned": translation((1.0, -2.0, 0.5)) @ rotation((1.0, 2.0, -0.5), 67.0),
    "mirrored": translation((0.0, 1.0, 0.0)) @ reflection((1.0, 1.0, 0.3)) @ scaling(1.7),
    "stretched": rotation((0.0, 1.0, 1.0), 30.0) @ scaling((3.0, 1.0, 0.4)) @ rotation((1.0, 0.0, 1.0), 50.0),
}
"""Affine maps: rigid, a reflection, and one that shears."""


def lines_round(bounds: Floats, count: int, seed: int = 0) -> Lines:
    """Random lines through the ball round a box, each of the weight with which crossings add up to pi times an area."""
    rng = np.random.default_rng(seed)
    centre, radius = bounds.mean(axis=0), 0.5 * float(np.linalg.norm(bounds[1] - bounds[0]))
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(directions, rng.standard_normal((count, 3)))
    across *= (radius * np.sqrt(rng.random(count)) / np.linalg.norm(across, axis=1))[:, None]
    return Lines.of(centre + across, directions, 2.0 * np.pi * np.pi * radius**2 / count)


def places(lines: Lines, crossings: surfel.Crossings) -> Floats:
    """The points in which lines hit."""
    return lines.origins[crossings.lines] + crossings.t[:, None] * lines.directions[crossings.lines]


def to_local(points: Floats, matrix: Floats) -> Floats:
    """Map points of the world to the frame of what was placed by a matrix."""
    return (points - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
