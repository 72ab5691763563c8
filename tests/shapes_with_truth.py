"""Surfaces whose area, volume, centroid and inertia are known in closed form, and random points of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sampled:
    """Points of a surface, its outward normals there, and the truth; volume 0 where it is open."""

    points: Floats
    normals: Floats
    area: float
    volume: float = 0.0
    centroid: Floats = field(default_factory=lambda: np.zeros(3))
    inertia: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def spacing(self) -> float:
        """Side of the square that a point has to itself."""
        return float(np.sqrt(self.area / len(self.points)))

    def noisy(self, sigma: float, seed: int = 0) -> Floats:
        """Return the points moved along their normals by Gaussian noise of ``sigma`` spacings."""
        off = np.random.default_rng(seed).standard_normal(len(self.points)) * sigma * self.spacing
        return self.points + off[:, None] * self.normals

    def moved(self, by: Floats) -> Sampled:
        """Return the same surface elsewhere."""
        return Sampled(self.points + by, self.normals, self.area, self.volume, self.centroid + by, self.inertia)


def sphere(n: int, seed: int = 0) -> Sampled:
    """Return uniform random points of the unit sphere."""
    p = np.random.default_rng(seed).standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    volume = 4.0 * np.pi / 3.0
    return Sampled(p, p, 4.0 * np.pi, volume, inertia=np.eye(3) * 0.4 * volume)


def even_sphere(n: int, seed: int = 0) -> Sampled:
    """Return points that are more even than random ones: a spherical Fibonacci set, shaken by a fifth spacing."""
    i = np.arange(n)
    z, angle = 1.0 - (2.0 * i + 1.0) / n, np.pi * (3.0 - np.sqrt(5.0)) * i
    ring = np.sqrt(1.0 - z * z)
    p = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    p += np.random.default_rng(seed).standard_normal((n, 3)) * 0.2 * np.sqrt(4.0 * np.pi / n)
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    volume = 4.0 * np.pi / 3.0
    return Sampled(p, p, 4.0 * np.pi, volume, inertia=np.eye(3) * 0.4 * volume)


def uneven_sphere(n: int, seed: int = 0) -> Sampled:
    """Return points of the unit sphere that lie 16 times denser at one pole than at the other."""
    rng = np.random.default_rng(seed)
    p = sphere(12 * n, seed + 1).points
    p = p[rng.random(len(p)) < 16.0 ** (0.5 * (p[:, 2] - 1.0))][:n]
    return Sampled(p, p, 4.0 * np.pi, 4.0 * np.pi / 3.0)


def half_sphere(n: int, seed: int = 0) -> Sampled:
    """Return the upper half of the unit sphere, without a floor."""
    p = sphere(n, seed).points
    p = p * np.where(p[:, 2:] < 0.0, [1.0, 1.0, -1.0], 1.0)
    return Sampled(p, p, 2.0 * np.pi)


def capless_sphere(n: int, share: float, seed: int = 0) -> Sampled:
    """Return the unit sphere without a cap of ``share`` of its area."""
    p = sphere(n, seed).points
    p = p[p[:, 2] < 1.0 - 2.0 * share]
    return Sampled(p, p, 4.0 * np.pi * (1.0 - share))


def torus(n: int, seed: int = 0, ring: float = 1.0, tube: float = 0.35) -> Sampled:
    """Return uniform random points of a torus round the z axis."""
    rng = np.random.default_rng(seed)
    u, v = rng.random((2, 4 * n)) * 2.0 * np.pi
    keep = rng.random(4 * n) * (ring + tube) < ring + tube * np.cos(v)
    u, v = u[keep][:n], v[keep][:n]
    normal = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    centre = ring * np.column_stack([np.cos(u), np.sin(u), 0.0 * u])
    volume = 2.0 * np.pi**2 * ring * tube**2
    axial = volume * (ring**2 + 0.75 * tube**2)
    across = volume * (0.5 * ring**2 + 0.625 * tube**2)
    return Sampled(
        centre + tube * normal, normal, 4.0 * np.pi**2 * ring * tube, volume, inertia=np.diag([across, across, axial])
    )


def box(n: int, seed: int = 0, sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Sampled:
    """Return uniform random points of the surface of a box round the origin."""
    rng = np.random.default_rng(seed)
    a = np.asarray(sides)
    face = np.repeat([a[1] * a[2], a[0] * a[2], a[0] * a[1]], 2)
    which = rng.choice(6, n, p=face / face.sum())
    axis, sign = which // 2, np.where(which % 2, 1.0, -1.0)
    p = (rng.random((n, 3)) - 0.5) * a
    p[np.arange(n), axis] = 0.5 * sign * a[axis]
    normal = np.zeros((n, 3))
    normal[np.arange(n), axis] = sign
    volume = float(a.prod())
    squares = a**2
    inertia = np.diag(volume / 12.0 * (squares.sum() - squares))
    return Sampled(p, normal, float(face.sum()), volume, inertia=inertia)


def cylinder(n: int, seed: int = 0, radius: float = 0.5, height: float = 2.0) -> Sampled:
    """Return uniform random points of a closed cylinder along z round the origin."""
    rng = np.random.default_rng(seed)
    side, lid = 2.0 * np.pi * radius * height, np.pi * radius**2
    which = rng.choice(3, n, p=np.array([side, lid, lid]) / (side + 2.0 * lid))
    angle, r = rng.random(n) * 2.0 * np.pi, radius * np.sqrt(rng.random(n))
    r = np.where(which == 0, radius, r)
    z = np.where(which == 0, (rng.random(n) - 0.5) * height, np.where(which == 1, 0.5, -0.5) * height)
    round_normal = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    normal = np.where((which == 0)[:, None], round_normal, np.sign(z)[:, None] * [0.0, 0.0, 1.0])
    volume = np.pi * radius**2 * height
    across = volume * (3.0 * radius**2 + height**2) / 12.0
    inertia = np.diag([across, across, 0.5 * volume * radius**2])
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    return Sampled(points, normal, side + 2.0 * lid, volume, inertia=inertia)


def square(n: int, seed: int = 0) -> Sampled:
    """Return uniform random points of an open unit square."""
    p = np.column_stack([np.random.default_rng(seed).random((n, 2)), np.zeros(n)])
    return Sampled(p, np.tile([0.0, 0.0, 1.0], (n, 1)), 1.0)


def crossing_squares(n: int, seed: int = 0) -> Sampled:
    """Return two unit squares that cross at a right angle in their middle lines."""
    rng = np.random.default_rng(seed)
    upright = rng.random(n) < 0.5
    s, t = rng.random((2, n)) - 0.5
    p = np.where(upright[:, None], np.column_stack([s, 0 * s, t]), np.column_stack([s, t, 0 * s]))
    normal = np.where(upright[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    return Sampled(p, normal, 2.0)


def box_mesh(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> tuple[Floats, NDArray[np.int64]]:
    """Return vertices and outward triangles of a box round the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def rotation(seed: int = 0) -> Floats:
    """Return a random proper rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))
