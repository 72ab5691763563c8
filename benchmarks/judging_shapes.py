"""Shapes that judge the intervals of clouds: solids and sheets from formulas with random parameters, as dense meshes.

Their truth is the sum of their triangles. The same number gives the same shape on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.grids import of_grid, of_triangles, on_sphere, sides, tube, waves
from benchmarks.level_sets import blob, quartic
from benchmarks.pieces import Floats
from benchmarks.shapes import KnownShape


def _superquadric(number: int) -> KnownShape:
    """Return a rounded box, a pillow or a pointed star (Barr 1981), with random exponents."""
    random = np.random.default_rng((21, number))
    (along, across), size = random.uniform(0.25, 2.2, 2), random.uniform(0.5, 1.0, 3)

    def power(base: Floats, exponent: float) -> Floats:
        return np.sign(base) * np.abs(base) ** exponent

    def place(u: Floats, v: Floats) -> Floats:
        tall, turn = math.pi * (u - 0.5), 2.0 * math.pi * v
        flat = power(np.cos(tall), along)
        round_it = np.stack([flat * power(np.cos(turn), across), flat * power(np.sin(turn), across)], axis=-1)
        return np.concatenate([round_it, power(np.sin(tall), along)[..., None]], axis=-1) * size

    return of_grid(f"superquadric {number}", place)


def _supershape(number: int) -> KnownShape:
    """Return the product of two super-formulas (Gielis 2003) with random lobes."""
    random = np.random.default_rng((22, number))

    def radius(lobes: int, powers: Floats, angle: Floats) -> Floats:
        turn = 0.25 * lobes * angle
        return (np.abs(np.cos(turn)) ** powers[1] + np.abs(np.sin(turn)) ** powers[2]) ** (-1.0 / powers[0])

    lobes, powers = random.integers(2, 7, 2), random.uniform(1.2, 3.0, (2, 3)) + np.array([1.0, 0.0, 0.0])

    def place(u: Floats, v: Floats) -> Floats:
        tall, turn = math.pi * (u - 0.5), 2.0 * math.pi * (v - 0.5)
        far = radius(2 * int(lobes[0]), powers[0], turn)  # an even number closes the seam
        high = radius(2 * int(lobes[1]), powers[1], tall)
        flat = far * high * np.cos(tall)
        return np.stack([flat * np.cos(turn), flat * np.sin(turn), high * np.sin(tall)], axis=-1)

    return of_grid(f"supershape {number}", place)


def _cyclide(number: int) -> KnownShape:
    """Return a ring cyclide of Dupin with random parameters."""
    random = np.random.default_rng((23, number))
    a, c = 1.0, random.uniform(0.1, 0.5)
    b, d = math.sqrt(a * a - c * c), random.uniform(c + 0.1, 0.85)

    def place(u: Floats, v: Floats) -> Floats:
        s, t = 2.0 * math.pi * u, 2.0 * math.pi * v
        below = a - c * np.cos(s) * np.cos(t)
        x = d * (c - a * np.cos(s) * np.cos(t)) + b * b * np.cos(s)
        y, z = b * np.sin(s) * (a - d * np.cos(t)), b * np.sin(t) * (c * np.cos(s) - d)
        return np.stack([x / below, y / below, z / below], axis=-1)

    return of_grid(f"cyclide {number}", place)


def _spring(number: int) -> KnownShape:
    """Return a helical tube with open ends."""
    random = np.random.default_rng((24, number))
    turns, pitch, radius = random.uniform(2.0, 4.0), random.uniform(0.6, 1.0), random.uniform(0.1, 0.25)

    def line(t: Floats) -> Floats:
        angle = 2.0 * math.pi * turns * t
        return np.stack([np.cos(angle), np.sin(angle), pitch * turns * t], axis=-1)

    return tube(f"spring {number}", line, radius)


def _shell(number: int) -> KnownShape:
    """Return a spiral that grows, as a snail's, open at its mouth."""
    random = np.random.default_rng((25, number))
    turns, growth, rise = random.uniform(1.5, 2.5), random.uniform(0.8, 1.3), random.uniform(0.6, 1.4)

    def place(u: Floats, v: Floats) -> Floats:
        size, angle, around = np.exp(growth * (u - 1.0) * turns), 2.0 * math.pi * turns * u, 2.0 * math.pi * v
        far = size * (1.0 + 0.55 * np.cos(around))
        return np.stack(
            [far * np.cos(angle), far * np.sin(angle), size * (0.55 * np.sin(around) - 2.0 * rise)], axis=-1
        )

    return of_grid(f"shell {number}", place)


def _twisted_prism(number: int) -> KnownShape:
    """Return a prism over a random star, twisted about its axis, with its two ends."""
    random = np.random.default_rng((26, number))
    corners = 2 * int(random.integers(3, 6))
    radius = np.where(np.arange(corners) % 2, random.uniform(0.45, 0.8), 1.0)
    angle = 2.0 * math.pi * np.arange(corners) / corners
    rim = np.c_[radius * np.cos(angle), radius * np.sin(angle)]
    rim = np.concatenate([rim, rim[:1]])
    twist, height = random.uniform(0.4, 1.6), random.uniform(1.0, 2.5)
    part = 840 // corners  # a corner of the star falls on a line of the mesh
    ring = np.concatenate([np.linspace(rim[k], rim[k + 1], part, endpoint=False) for k in range(corners)])
    level = np.linspace(0.0, 1.0, 500)
    turn = twist * level[:, None]
    x = ring[:, 0] * np.cos(turn) - ring[:, 1] * np.sin(turn)
    y = ring[:, 0] * np.sin(turn) + ring[:, 1] * np.cos(turn)
    side = np.stack([x, y, np.broadcast_to(height * level[:, None], x.shape)], axis=-1)
    n = len(ring)
    here = (np.arange(499)[:, None] * n + np.arange(n)).ravel()
    beside = (np.arange(499)[:, None] * n + (np.arange(n) + 1) % n).ravel()
    walls = np.concatenate([np.c_[here, beside, here + n], np.c_[beside, beside + n, here + n]])
    low, high = 500 * n, 500 * n + 1
    first, last = np.arange(n), 499 * n + np.arange(n)
    ends = np.concatenate(
        [np.c_[np.full(n, low), np.roll(first, -1), first], np.c_[np.full(n, high), last, np.roll(last, -1)]]
    )
    vertices = np.concatenate([side.reshape(-1, 3), [[0.0, 0.0, 0.0], [0.0, 0.0, height]]])
    return of_triangles(f"twisted prism {number}", vertices, np.concatenate([walls, ends]).astype(np.int32))


def _hull(number: int) -> KnownShape:
    """Return the convex hull of some random points: flat faces and sharp edges."""
    from scipy.spatial import ConvexHull

    random = np.random.default_rng((27, number))
    points = random.standard_normal((int(random.integers(8, 40)), 3)) * random.uniform(0.4, 1.0, 3)
    hull = ConvexHull(points)
    inward = np.einsum("ij,ij->i", np.cross(*sides(points, hull.simplices)), hull.equations[:, :3]) < 0.0
    triangles = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return of_triangles(f"hull {number}", points, triangles.astype(np.int32))


def _rock(number: int) -> KnownShape:
    """Return a body with relief of every length down to a hundredth of it, as scans have."""
    random = np.random.default_rng((28, number))
    depth, fall, highest = random.uniform(0.03, 0.08), random.uniform(1.1, 1.6), random.uniform(10.0, 24.0)
    size = random.uniform(0.5, 1.0, 3)

    def place(u: Floats, v: Floats) -> Floats:
        sphere = on_sphere(u, v)
        return sphere * size * (1.0 + depth * waves(sphere, random, 0.6, highest, 120, fall))[..., None]

    return of_grid(f"rock {number}", place)


def _terrain(number: int) -> KnownShape:
    """Return an open sheet with hills of every length."""
    random = np.random.default_rng((29, number))
    depth, fall, highest = random.uniform(0.04, 0.1), random.uniform(1.1, 1.6), random.uniform(8.0, 20.0)
    wide = random.uniform(0.5, 1.0)

    def place(u: Floats, v: Floats) -> Floats:
        sheet = np.stack([u, v * wide, np.zeros_like(u)], axis=-1)
        sheet[..., 2] = depth * waves(sheet, random, 1.0, highest, 120, fall)
        return sheet

    return of_grid(f"terrain {number}", place)


def _moebius(number: int) -> KnownShape:
    """Return a band with a random number of half turns: open, and with one side where that is odd."""
    random = np.random.default_rng((30, number))
    turns, wide = int(random.integers(1, 4)), random.uniform(0.25, 0.5)

    def place(u: Floats, v: Floats) -> Floats:
        angle, off = 2.0 * math.pi * u, wide * (2.0 * v - 1.0)
        far = 1.0 + off * np.cos(0.5 * turns * angle)
        return np.stack([far * np.cos(angle), far * np.sin(angle), off * np.sin(0.5 * turns * angle)], axis=-1)

    return of_grid(f"moebius {number}", place)


def _helicoid(number: int) -> KnownShape:
    """Return an open spiral ramp round a free middle."""
    random = np.random.default_rng((31, number))
    turns, pitch, inner = random.uniform(1.0, 2.0), random.uniform(0.5, 1.2), random.uniform(0.1, 0.4)

    def place(u: Floats, v: Floats) -> Floats:
        angle, far = 2.0 * math.pi * turns * u, inner + (1.0 - inner) * v
        return np.stack([far * np.cos(angle), far * np.sin(angle), pitch * turns * u], axis=-1)

    return of_grid(f"helicoid {number}", place)


def _vase(number: int) -> KnownShape:
    """Return a surface of revolution with a random outline, closed below and open above."""
    random = np.random.default_rng((33, number))
    height, swing, phase = random.uniform(1.5, 3.0), random.uniform(0.1, 0.3, 2), random.uniform(0.0, 6.0, 2)

    def place(u: Floats, v: Floats) -> Floats:
        wide = 0.6 + swing[0] * np.sin(4.0 * u + phase[0]) + 0.5 * swing[1] * np.sin(9.0 * u + phase[1])
        far = wide * np.minimum(1.0, np.sqrt(8.0 * u))
        angle = 2.0 * math.pi * v
        return np.stack([far * np.cos(angle), far * np.sin(angle), height * u], axis=-1)

    return of_grid(f"vase {number}", place)


FAMILIES: dict[str, Callable[[int], KnownShape]] = {
    "superquadric": _superquadric,
    "supershape": _supershape,
    "cyclide": _cyclide,
    "spring": _spring,
    "shell": _shell,
    "twisted prism": _twisted_prism,
    "hull": _hull,
    "rock": _rock,
    "terrain": _terrain,
    "moebius": _moebius,
    "helicoid": _helicoid,
    "blob": blob,
    "vase": _vase,
    "quartic": quartic,
}
