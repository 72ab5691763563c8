"""Cases for judges: clouds drawn from closed meshes, spoilt in known ways, and places whose side the mesh tells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

import surfel
from benchmarks.clouds import generator
from benchmarks.shapes import NoDataError, read_mesh
from surfel.core.cast import Booleans, Floats
from surfel.inside.operand import Operand

PLACES = 25_000
SHARP_ANGLE = 0.3
"""Radians between two faces from which on the edge between them counts as sharp."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh of about unit size, whose parity is the truth."""

    name: str
    vertices: Floats
    triangles: NDArray[np.int64]

    @cached_property
    def mesh(self) -> surfel.Mesh:
        return surfel.Mesh(self.vertices, self.triangles)

    @cached_property
    def _faces(self) -> tuple[Floats, Floats]:
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1)
        return normal / np.where(length > 0.0, length, 1.0)[:, None], 0.5 * length

    @cached_property
    def _at_vertices(self) -> Floats:
        normal, area = self._faces
        total = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(total, self.triangles[:, k], normal * area[:, None])
        length = np.linalg.norm(total, axis=1)
        return total / np.where(length > 0.0, length, 1.0)[:, None]

    def draw(
        self, n: int, rng: np.random.Generator, smooth: bool, density: Callable[[Floats], Floats] | None = None
    ) -> tuple[Floats, Floats]:
        """Return n random points and unit normals: of the faces, or interpolated between those of the vertices."""
        normal, area = self._faces
        weight = area if density is None else area * density(self.vertices[self.triangles].mean(axis=1))
        face = rng.choice(len(area), n, p=weight / weight.sum())
        root, share = np.sqrt(rng.random(n)), rng.random(n)
        corner = np.stack([1.0 - root, root * (1.0 - share), root * share], axis=1)
        points = np.einsum("nk,nkx->nx", corner, self.vertices[self.triangles[face]])
        if not smooth:
            return points, normal[face]
        blend = np.einsum("nk,nkx->nx", corner, self._at_vertices[self.triangles[face]])
        length = np.linalg.norm(blend, axis=1)
        flat = length < 1e-9
        return points, np.where(flat[:, None], normal[face], blend / np.where(flat, 1.0, length)[:, None])

    def on_edges(self, n: int, rng: np.random.Generator) -> Floats:
        """Return random places on sharp edges, by length."""
        normal = self._faces[0]
        sides = np.sort(np.concatenate([self.triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
        face = np.tile(np.arange(len(self.triangles)), 3)
        order = np.lexsort(sides.T)
        sides, face = sides[order], face[order]
        pair = np.flatnonzero((sides[1:] == sides[:-1]).all(axis=1))
        cosine = np.einsum("ij,ij->i", normal[face[pair]], normal[face[pair + 1]])
        sharp = sides[pair[cosine < np.cos(SHARP_ANGLE)]]
        a, b = self.vertices[sharp[:, 0]], self.vertices[sharp[:, 1]]
        length = np.linalg.norm(b - a, axis=1)
        chosen = rng.choice(len(sharp), n, p=length / length.sum())
        share = rng.random((n, 1))
        return a[chosen] * share + b[chosen] * (1.0 - share)


@dataclass(frozen=True, eq=False)
class Case:
    """A cloud, places, and which of them are inside."""

    cloud: str
    places: str
    operand: Operand
    queries: Floats
    inside: Booleans


@dataclass(frozen=True)
class Cloud:
    """How to draw a cloud and spoil it, which places to judge, and how often to draw."""

    name: str
    solid: str
    smooth: bool = True
    surfels: int = 62_000
    uneven: float = 1.0
    noise: float = 0.0
    degrees: float = 0.0
    flipped: float = 0.0
    patch: float = 0.0
    places: tuple[str, ...] = ("all", "near")
    draws: int = 2


CLOUDS = (
    Cloud("bunny", "bunny"),
    Cloud("box", "box", smooth=False, places=("all", "edge")),
    Cloud("concave CSG", "csg", smooth=False, places=("all", "edge")),
    Cloud("thin plate", "plate", smooth=False),
    Cloud("uneven 1:30", "bunny", uneven=30.0),
    Cloud("noise .5 % + 10 degrees", "bunny", noise=0.0075, degrees=10.0),
    Cloud("20 % of the normals flipped", "bunny", flipped=0.2),
    Cloud("a 12 % patch flipped", "bunny", patch=0.12, draws=6),
    Cloud("armadillo", "armadillo"),
    Cloud("fertility", "fertility"),
    Cloud("fandisk", "fandisk", smooth=False, places=("all", "edge")),
    Cloud("112932", "112932", smooth=False, places=("all", "edge")),
    Cloud("armadillo, noise .5 % + 10 degrees", "armadillo", noise=0.0075, degrees=10.0),
    Cloud("fandisk, noise .5 % + 10 degrees", "fandisk", smooth=False, noise=0.006, degrees=10.0),
    Cloud("fertility, 20 % flipped", "fertility", flipped=0.2),
    Cloud("fandisk, 20 % flipped", "fandisk", smooth=False, flipped=0.2, places=("all", "edge")),
    Cloud("rocker-arm, uneven 1:30", "rocker-arm", uneven=30.0),
    Cloud("bunny, 3,000 surfels", "bunny", surfels=3000),
)


def cases_of(cloud: Cloud, count: int, draw: int = 0) -> Iterator[Case]:
    """Draw a cloud and places; the same ``draw`` gives the same ones.

    Raises
    ------
    NoDataError
        If its mesh is absent.
    """
    solid, rng = known_solid(cloud.solid), generator("judges", cloud.name, draw)
    points, normals = draw_cloud(solid, cloud, rng)
    operand = Operand.of(points, normals)
    spacing = float(np.sqrt(np.median(operand.areas)))
    for kind in cloud.places:
        queries = places_of(kind, solid, count, spacing, rng)
        yield Case(cloud.name, kind, operand, queries, solid.mesh.contains(queries))


def draw_cloud(solid: Solid, cloud: Cloud, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw a cloud and spoil it; noise is in units of the solid's longest side."""
    dense = None if cloud.uneven == 1.0 else lambda places: np.where(places[:, 0] < 0.0, 1.0, cloud.uneven)
    points, normals = solid.draw(cloud.surfels, rng, cloud.smooth, dense)
    points = points + rng.normal(0.0, cloud.noise, points.shape) if cloud.noise else points
    if cloud.degrees:
        normals = normals + rng.normal(0.0, np.tan(np.radians(cloud.degrees)) / np.sqrt(2.0), normals.shape)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
    away = np.linalg.norm(points - points[rng.integers(len(points))], axis=1)
    wrong = rng.random(len(points)) < cloud.flipped
    wrong |= away < np.quantile(away, cloud.patch) if cloud.patch else wrong
    return points, np.where(wrong[:, None], -normals, normals)


def places_of(kind: str, solid: Solid, count: int, spacing: float, rng: np.random.Generator) -> Floats:
    """Return places: "all" the surfels of a turned and shifted bunny, "near" within 2 spacings, "edge" at edges."""
    if kind == "edge":
        return solid.on_edges(count, rng) + rng.normal(0.0, 0.7 * spacing, (count, 3))
    if kind == "near":
        points, normals = solid.draw(count, rng, smooth=False)
        return points + normals * rng.uniform(-2.0, 2.0, (count, 1)) * spacing
    other = on_its_way(known_solid("bunny" if _is_there("bunny") else "box"))
    return other.draw(2 * count, rng, smooth=False)[0]


def on_its_way(solid: Solid) -> Solid:
    """Return a solid, turned and shifted, so that it meets others round the origin."""
    return Solid(solid.name, solid.vertices @ _TURN.T + [0.15, 0.05, 0.1], solid.triangles)


def _about(axis: Floats, angle: float) -> Floats:
    x, y, z = axis / np.linalg.norm(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)


_TURN = _about(np.array([1.0, 0.4, 0.2]), 1.1)


def _is_there(name: str) -> bool:
    try:
        known_solid(name)
    except NoDataError:
        return False
    return True


@cache
def known_solid(name: str) -> Solid:
    """Return a solid of about unit size round the origin by its name."""
    if name == "box":
        return _box(name, (0.9, 0.7, 0.6))
    if name == "plate":
        return _box(name, (0.9, 0.7, 0.012))
    if name == "csg":
        return _csg()
    mesh = read_mesh(name)
    vertices, inverse = np.unique(mesh.vertices, axis=0, return_inverse=True)
    triangles = inverse.ravel()[mesh.triangles].astype(np.int64)
    low, high = vertices[triangles].min(axis=(0, 1)), vertices[triangles].max(axis=(0, 1))
    closed = _with_caps((vertices - 0.5 * (low + high)) / (high - low).max(), triangles)
    solid = Solid(name, *closed)
    volume = np.einsum("ij,ij->", *(f(closed[0][closed[1]]) for f in (_first_corner, _twice_area)))
    return solid if volume > 0.0 else Solid(name, closed[0], closed[1][:, ::-1].copy())


def _first_corner(corners: Floats) -> Floats:
    return corners[:, 0]


def _twice_area(corners: Floats) -> Floats:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _with_caps(vertices: Floats, triangles: NDArray[np.int64]) -> tuple[Floats, NDArray[np.int64]]:
    """Close every hole by a fan from the middle of its border."""
    sides = {(int(a), int(b)) for row in triangles for a, b in zip(row, np.roll(row, -1), strict=True)}
    after = {b: a for a, b in sides if (b, a) not in sides}
    added, middles = [], [vertices]
    count = len(vertices)
    while after:
        start, end = after.popitem()
        loop = [start]
        while end != start and end in after:
            loop.append(end)
            end = after.pop(end)
        middles.append(vertices[loop].mean(axis=0, keepdims=True))
        added += [(loop[k], loop[(k + 1) % len(loop)], count) for k in range(len(loop))]
        count += 1
    faces = np.concatenate([triangles, np.array(added, np.int64).reshape(-1, 3)])
    return np.concatenate(middles), faces


def _box(name: str, edges: tuple[float, float, float]) -> Solid:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * edges
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [row for a, b, c, d in quads for row in ((a, b, c), (a, c, d))]
    return Solid(name, corners, np.array(triangles))


def _csg() -> Solid:
    """Return a box less a bore and less a notch: convex and concave edges, straight and round."""
    try:
        from manifold3d import Manifold
    except ImportError as error:
        raise NoDataError("the concave solid is made by manifold3d, which is not installed") from error

    body = Manifold.cube((0.9, 0.7, 0.6), True) - Manifold.cylinder(1.0, 0.2, 0.2, 128, True)
    mesh = (body - Manifold.cube((0.5, 0.5, 0.5), True).translate((0.35, 0.3, 0.3))).to_mesh()
    return Solid("csg", np.array(mesh.vert_properties)[:, :3].astype(float), np.array(mesh.tri_verts).astype(np.int64))
