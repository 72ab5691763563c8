"""Surfels of exact solids: drawn evenly, and only where the tree may keep or cut them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.core.patches import Patches
from surfel.shapes.base import Shape
from surfel.shapes.elements import can_be_sampled, elements_of, rough_area
from surfel.shapes.extent import half_space_of
from surfel.shapes.mesh import Mesh
from surfel.shapes.primitives.primitive import square_points
from surfel.shapes.sample_apart import eliminate, keep_apart
from surfel.shapes.sample_lines import OfLines
from surfel.shapes.sample_mesh import OfMesh
from surfel.shapes.surfels import Surfels

DEFAULT = 65_536
"""About so many surfels has the largest leaf of a tree without clouds, where no spacing was asked for."""

_CANDIDATES = 5
_APART = 0.72
_MOST = 20_000_000
_GRID = 64  # squares along each side of the unit square that is mapped to a surface
_FINEST = 60  # so often are the squares divided that reach into the box
_SQUARES = 50_000  # and no further where there are so many: those over an edge never become small
_PILOT = 4  # places in each square

_PLACES = np.array([[0.02, 0.02], [0.98, 0.02], [0.02, 0.98], [0.98, 0.98], [0.5, 0.5]])

Keep = Callable[[Floats, Floats], NDArray[np.bool_]]
"""Tells which places, with their normals, are wanted."""


def surfels_of(leaf: Shape, box: Floats, spacing: float, wanted: Keep, seed: int) -> Surfels:
    """Draw the surfels of an exact solid or a mesh.

    Candidates are drawn by area, five for each surfel, from those parts of the surface that lie in the box, and
    crowded ones are eliminated; so only what is wanted costs.

    Parameters
    ----------
    leaf : Shape
        A primitive or a mesh; one that is known by its equation alone is crossed with lines.
    box : Floats, shape (2, 3)
        Where the surface is of account.
    spacing : float
        How far apart the surfels lie: each stands for the square of that.
    wanted : callable
        Tells which candidates may be kept or cut.
    seed : int
        Of the candidates.

    Raises
    ------
    InputError
        If more than 4 million surfels would be needed.
    """
    rng = np.random.default_rng((seed, 17))
    margin = 3.0 * spacing
    region = box + np.array([[-margin], [margin]])
    draw, area = _source(leaf, region)
    count = _CANDIDATES * area / spacing**2
    if count > _MOST:
        raise InputError(
            f"a spacing of {spacing:g} asks for about {count / _CANDIDATES:.2g} surfels on a {type(leaf).__name__}; "
            "give a larger one"
        )
    points, normals = draw(math.ceil(count), rng)
    here = ((points >= region[0]) & (points <= region[1])).all(axis=1)
    points, normals = points[here], normals[here]
    keep = wanted(points, normals) if len(points) else np.zeros(0, bool)
    points, normals = np.ascontiguousarray(points[keep]), np.ascontiguousarray(normals[keep])
    if not len(points):
        return Surfels(points, normals, np.empty(0))
    number = max(1, round(len(points) / _CANDIDATES))
    hexagonal = math.sqrt(2.0 / math.sqrt(3.0)) * spacing
    order = eliminate(points, normals, number, hexagonal)
    kept = keep_apart(points, normals, order, len(order), _APART * hexagonal)
    return Surfels(points[kept], normals[kept])


Draw = Callable[[int, np.random.Generator], tuple[Floats, Floats]]


def size_of(leaf: Shape, box: Floats) -> float:
    """Return about the area of an exact solid, a half-space's and an equation's in the box."""
    return rough_area(leaf, box) if can_be_sampled(leaf) else OfLines(leaf, box).area


def _source(leaf: Shape, region: Floats) -> tuple[Draw, float]:
    """Return what draws from a leaf, and of which area."""
    if isinstance(leaf, Mesh):
        return _of_mesh(leaf, region)
    if can_be_sampled(leaf):
        return _of_squares(leaf, region)
    lines = OfLines(leaf, region)
    return lines.random, lines.area


def _of_mesh(mesh: Mesh, region: Floats) -> tuple[Draw, float]:
    """Draw from the triangles that meet the region."""
    corners = mesh.vertices[mesh.triangles]
    meets = ((corners.max(axis=1) >= region[0]) & (corners.min(axis=1) <= region[1])).all(axis=1)
    part = mesh if meets.all() else Mesh(mesh.vertices, mesh.triangles[meets])
    normals = mesh.face_normals[meets]
    if not part.area > 0.0:
        return _nothing, 0.0
    source = OfMesh(part)

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        found = source.random(n, rng)
        return found.points, normals[found.triangles]

    return draw, part.area


def _of_squares(leaf: Shape, region: Floats) -> tuple[Draw, float]:
    """Draw from the squares of the parameter plane whose images come near the region."""
    if half_space_of(leaf) is not None:
        return _of_plane(leaf, region)
    corners, sides, densest = _squares_near(leaf, region)
    if not len(corners):
        return _nothing, 0.0
    areas = densest * sides.prod(axis=1)
    area = float(areas.sum())
    chance = areas / area

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        square = rng.choice(len(corners), n, p=chance)
        found = elements_of(leaf, corners[square] + sides[square] * rng.random((n, 2)), region)
        taken = rng.random(n) * densest[square] < _densities(found, n)
        return found.points[taken], found.normals[taken]

    return draw, area


def _of_plane(leaf: Shape, region: Floats) -> tuple[Draw, float]:
    area = float(elements_of(leaf, square_points(4), region).areas.sum())

    def draw(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        found = elements_of(leaf, rng.random((n, 2)), region)
        return found.points, found.normals

    return (draw, area) if area > 0.0 else (_nothing, 0.0)


def _squares_near(leaf: Shape, region: Floats) -> tuple[Floats, Floats, Floats]:
    """Divide the rectangles that reach into the region, until they are small against it.

    Each is halved across the direction in which its image is longer, so that none is lost in slivers at a pole.

    Returns
    -------
    corners, sides : Floats, shape (k, 2)
        The lower left corner of each rectangle, and how wide and high it is.
    densest : Floats, shape (k,)
        At least the area for a unit of the parameter plane that any place in it has.
    """
    ticks = np.arange(_GRID) / _GRID
    corners = np.stack([axis.ravel() for axis in np.meshgrid(ticks, ticks, indexing="ij")], axis=1)
    sides = np.full(corners.shape, 1.0 / _GRID)
    diagonal = float(np.linalg.norm(region[1] - region[0]))
    for depth in range(_FINEST + 1):
        uv = (corners[:, None] + sides[:, None] * _PLACES).reshape(-1, 2)
        found = elements_of(leaf, uv, region)
        at = found.points.reshape(-1, len(_PLACES), 3)
        middle = at.mean(axis=1)
        size = 2.0 * np.linalg.norm(at - middle[:, None], axis=2).max(axis=1)
        gap = np.maximum(np.maximum(region[0] - middle, middle - region[1]), 0.0)
        near = np.linalg.norm(gap, axis=1) <= size
        share = float(near.mean())
        corners, sides, at, size = corners[near], sides[near], at[near], size[near]
        densest = 1.15 * _densities(found, len(uv)).reshape(-1, len(_PLACES)).max(axis=1)[near]
        small = size < 0.25 * diagonal
        if depth == _FINEST or not 0 < len(corners) < _SQUARES or small.all() or (depth == 0 and share > 0.5):
            return corners, sides, densest
        wide = np.linalg.norm(at[:, 1] - at[:, 0], axis=1) + np.linalg.norm(at[:, 3] - at[:, 2], axis=1)
        high = np.linalg.norm(at[:, 2] - at[:, 0], axis=1) + np.linalg.norm(at[:, 3] - at[:, 1], axis=1)
        axis = np.where(wide >= high, 0, 1)
        large = np.flatnonzero(~small)
        sides[large, axis[large]] *= 0.5
        second = corners[large].copy()
        second[np.arange(len(large)), axis[large]] += sides[large, axis[large]]
        corners, sides = np.concatenate([corners, second]), np.concatenate([sides, sides[large]])
    raise AssertionError("the last round returns")


def _densities(found: Patches, n: int) -> Floats:
    """Return the area for a unit of the parameter plane at each element of n."""
    return np.asarray(found.areas * n)


def _nothing(n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    return np.empty((0, 3)), np.empty((0, 3))
