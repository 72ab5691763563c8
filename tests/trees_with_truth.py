"""Trees beside a slow, obvious judge of them: the places where a line may pass a leaf's surface, and what lies between.

Each leaf names a superset of the places where a line meets it (planes and quadrics are taken as endless). A place
counts where the tree, asked by implicit functions just before and just after it, changes its answer. Nothing is
shared with the kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import surfel
from primitives_with_truth import to_box, to_cone, to_ellipsoid, to_local, to_torus
from surfel import Lines
from surfel.core.affine import reflection, rotation, scaling, translation
from surfel.shapes.base import Shape
from surfel.shapes.tree import Tree

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Leaf:
    """A placed primitive, the sign of its implicit function, and where lines may meet it, both in its own frame."""

    shape: Shape
    matrix: Floats
    distance: Callable[[Floats], Floats]
    candidates: Callable[[Floats, Floats], Floats]

    def inside(self, points: Floats) -> NDArray[np.bool_]:
        return self.distance(to_local(points, self.matrix)) < 0.0

    def places(self, lines: Lines) -> Floats:
        """Return t of all candidates of each line, shape (m, c), infinite where there is none."""
        inverse = np.linalg.inv(self.matrix[:3, :3])
        return self.candidates(to_local(lines.origins, self.matrix), lines.directions @ inverse.T)


def planes(normals: Floats, offsets: Floats) -> Callable[[Floats, Floats], Floats]:
    def candidates(o: Floats, d: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (offsets - o @ normals.T) / (d @ normals.T)
        return np.where(np.isfinite(t), t, np.inf)

    return candidates


def quadric(square: Floats, linear: float, free: float) -> Callable[[Floats, Floats], Floats]:
    """Where square . (x^2, y^2, z^2) + linear z + free vanishes."""

    def candidates(o: Floats, d: Floats) -> Floats:
        o, d = o.astype(np.longdouble), d.astype(np.longdouble)
        a = (d * d) @ square
        b = 2.0 * (o * d) @ square + linear * d[:, 2]
        c = (o * o) @ square + linear * o[:, 2] + free
        with np.errstate(invalid="ignore", divide="ignore"):
            root = np.sqrt(b * b - 4.0 * a * c)
            t = np.stack([(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)], axis=1)
        return np.where(np.isfinite(t), t, np.inf).astype(float)

    return candidates


def quartic_of_torus(major: float, minor: float) -> Callable[[Floats, Floats], Floats]:
    def one(o: Floats, d: Floats) -> Floats:
        dd, od, oo = d @ d, o @ d, o @ o + major**2 - minor**2
        whole = np.polymul([dd, 2.0 * od, oo], [dd, 2.0 * od, oo])
        ring = 4.0 * major**2 * np.array([d[:2] @ d[:2], 2.0 * o[:2] @ d[:2], o[:2] @ o[:2]])
        roots = np.roots(np.polysub(whole, ring))
        return np.where(np.abs(roots.imag) < 1e-7, roots.real, np.inf)

    return lambda o, d: np.array([one(*pair) for pair in zip(o, d, strict=True)])


def both(*parts: Callable[[Floats, Floats], Floats]) -> Callable[[Floats, Floats], Floats]:
    return lambda o, d: np.concatenate([part(o, d) for part in parts], axis=1)


ENDS = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])


def random_leaf(rng: np.random.Generator, reach: float = 1.0, kinds: str = "bsecot") -> Leaf:
    """Return a box, a sphere, an ellipsoid, a cylinder, a cone or a torus, within reach, at times stretched."""
    kind = rng.choice(list(kinds))
    if kind == "b":
        size = rng.uniform(0.4, 2.0, 3)
        sides = planes(np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([size, size]) / 2.0)
        found = surfel.Box(tuple(size)), to_box(*size), sides
    elif kind in "se":
        radii = np.full(3, rng.uniform(0.3, 1.2)) if kind == "s" else rng.uniform(0.3, 1.2, 3)
        shape = surfel.Sphere(radii[0]) if kind == "s" else surfel.Ellipsoid(tuple(radii))
        found = shape, to_ellipsoid(*radii), quadric(1.0 / radii**2, 0.0, -1.0)
    elif kind == "t":
        major = rng.uniform(0.4, 1.0)
        minor = major * rng.uniform(0.2, 0.9)
        found = surfel.Torus(major, minor), to_torus(major, minor), quartic_of_torus(major, minor)
    else:
        bottom, height = rng.uniform(0.2, 1.0), rng.uniform(0.4, 2.5)
        top = bottom if kind == "c" else rng.choice([0.0, 0.3]) * bottom
        shape = surfel.Cylinder(bottom, height) if kind == "c" else surfel.Cone(bottom, top, height)
        middle, slope = 0.5 * (bottom + top), (top - bottom) / height
        side = quadric(np.array([1.0, 1.0, -(slope**2)]), -2.0 * middle * slope, -(middle**2))
        found = shape, to_cone(bottom, top, height), both(planes(ENDS, np.full(2, 0.5 * height)), side)
    matrix = translation(rng.uniform(-reach, reach, 3)) @ rotation(rng.standard_normal(3), rng.uniform(0.0, 360.0))
    if rng.random() < 0.3:
        matrix = matrix @ scaling(rng.uniform(0.5, 1.7, 3)) @ rotation(rng.standard_normal(3), 50.0)
    if rng.random() < 0.2:
        matrix = matrix @ reflection(rng.standard_normal(3))
    return Leaf(found[0].transformed(matrix), matrix, *found[1:])


def half_space(rng: np.random.Generator) -> Leaf:
    normal = rng.standard_normal(3)
    normal, offset = normal / np.linalg.norm(normal), rng.uniform(-0.5, 0.5)
    shape = surfel.HalfSpace(tuple(normal), offset)
    sides = planes(normal[None], np.array([offset]))
    return Leaf(shape, np.eye(4), lambda p: p @ normal - offset, sides)


def random_tree(rng: np.random.Generator, leaves: int, **how) -> tuple[Shape, dict[int, Leaf]]:
    """Return a tree of so many leaves, some of them used twice, and the leaves by identity of their shapes."""
    made = [random_leaf(rng, **how) for _ in range(leaves)]
    known = {id(leaf.shape): leaf for leaf in made}
    parts = [leaf.shape for leaf in made]
    if leaves > 2 and rng.random() < 0.4:
        parts.append(parts[int(rng.integers(leaves))])
    if rng.random() < 0.3:
        cut = half_space(rng)
        known[id(cut.shape)] = cut
        parts[0] = parts[0] & cut.shape
    while len(parts) > 1:
        a, b = (parts.pop(int(rng.integers(len(parts)))) for _ in range(2))
        parts.append([a | b, a & b, a - b, surfel.Union(a, b)][rng.choice(4, p=[0.35, 0.15, 0.35, 0.15])])
    return parts[0], known


def inside(tree: Shape, leaves: dict[int, Leaf], points: Floats) -> NDArray[np.bool_]:
    """Tell which points lie in a tree, by what its operators mean."""
    if not isinstance(tree, Tree):
        return leaves[id(tree)].inside(points)
    parts = [inside(child, leaves, points) for child in tree.children]
    if tree.operation == "union":
        return np.any(parts, axis=0) if parts else np.zeros(len(points), bool)
    if tree.operation == "intersection":
        return np.all(parts, axis=0)
    return parts[0] & ~np.any(parts[1:], axis=0) if len(parts) > 1 else parts[0]


def judged(
    tree: Shape, leaves: dict[int, Leaf], lines: Lines
) -> tuple[NDArray[np.int64], Floats, NDArray[np.bool_], NDArray[np.int64], NDArray[np.bool_]]:
    """Return line, t, whether it enters, and leaf of each crossing in order, and which lines leave no doubt."""
    order = tree.leaves if isinstance(tree, Tree) else (tree,)
    found = [leaves[id(leaf)].places(lines) for leaf in order]
    t = np.concatenate(found, axis=1)
    of = np.concatenate([np.full(part.shape[1], k) for k, part in enumerate(found)])
    rank = np.argsort(t, axis=1, kind="stable")
    t, of = np.take_along_axis(t, rank, axis=1), of[rank]
    with np.errstate(invalid="ignore"):
        clear = ~(np.diff(t, axis=1) < 1e-7).any(axis=1)
    last = np.where(np.isfinite(t), t, -np.inf).max(axis=1, keepdims=True)
    ends = np.concatenate([t[:, :1] - 1.0, np.where(np.isfinite(t), t, last + 1.0), last + 2.0], axis=1)
    ends = np.where(np.isfinite(ends), ends, 0.0)  # of lines that meet nothing
    middle = 0.5 * (ends[:, 1:] + ends[:, :-1])
    points = lines.origins[:, None] + middle[..., None] * lines.directions[:, None]
    within = inside(tree, leaves, points.reshape(-1, 3)).reshape(middle.shape)
    line, at = np.nonzero((within[:, 1:] != within[:, :-1]) & np.isfinite(t))
    return line, t[line, at], within[line, at + 1], of[line, at], clear
