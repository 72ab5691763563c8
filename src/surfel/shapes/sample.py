"""Points on the surface of a shape: at random, evenly apart, or so dense that none of the surface is far from one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import as_choice, as_count, as_positive
from surfel.core.errors import InputError
from surfel.shapes.base import Shape
from surfel.shapes.mesh import Mesh
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.primitive import Primitive
from surfel.shapes.sample_mesh import OfMesh, Samples, some_area
from surfel.shapes.tree import Tree

_CANDIDATES = 5  # for each point of blue noise
_APART = 0.72  # of the distance in a hexagonal pattern
_ROUNDS = 8
_MOST = 200_000_000


def sample(
    shape: Shape, n: int | None = None, kind: str = "random", seed: int = 0, *, radius: float | None = None
) -> Samples:
    """Sample the surface of a shape.

    Parameters
    ----------
    shape : Shape
        A mesh is sampled anywhere on its triangles, an exact solid and a tree anywhere on their surface; of a cloud,
        some of its points are chosen.
    n : int, optional
        How many points; give either ``n`` or ``radius``.
    kind : {"random", "blue"}
        Independent and uniform by area, or evenly apart: "blue" points on the same side of a surface keep at least
        0.7 of the distance that they would have in a hexagonal pattern, where the surface has room for that.
    seed : int
        The same seed gives the same points.
    radius : float, optional
        Take as many points as it needs for every point of a mesh to lie within ``radius`` of a sample on the same
        side; samples keep that distance.

    Returns
    -------
    Samples
        ``points, normals, triangles``; exactly ``n`` of them where ``n`` is given.

    Raises
    ------
    InputError
        If not one of ``n`` and ``radius`` is given, the shape has no area, or has fewer than ``n`` patches.

    Examples
    --------
    >>> import surfel
    >>> square = surfel.Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> points, normals, triangles = surfel.sample(square, 100, kind="blue")
    >>> points.shape, normals[0].tolist()
    ((100, 3), [0.0, 0.0, 1.0])
    """
    if not isinstance(shape, Shape):
        raise InputError(f"shape must be a Mesh, Surfels or another shape of surfel; got {type(shape).__name__}")
    as_choice(kind, "kind", ("random", "blue"))
    rng = np.random.default_rng(as_count(seed, "seed", 0))
    if (n is None) == (radius is None):
        raise InputError("give either n, the number of points, or radius, the distance that they should cover")
    source = _source_of(shape)
    if n is None:
        return _dense(source, as_positive(radius, "radius"), rng)
    count = as_count(n, "n")
    return source.random(count, rng) if kind == "random" else _blue(source, count, rng)


def _source_of(shape: Shape) -> Any:
    """Return what draws points from a shape."""
    if isinstance(shape, Mesh):
        return OfMesh(shape)
    if isinstance(shape, Tree | Primitive | Placed):
        from surfel.shapes.sample_solid import OfSolid

        return OfSolid(shape if isinstance(shape, Tree) else shape._alone)
    return _OfPatches(shape)


class _OfPatches:
    """Chooses from the patches of a shape, none of them twice."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape
        self.area = some_area(float(shape.patches().areas.sum()))

    def random(self, n: int, rng: np.random.Generator) -> Samples:
        """Return ``n`` patches, by area as far as none may come twice (the keys of Efraimidis and Spirakis, 2006)."""
        patches = self.shape.patches(max(n, 65_536))
        if len(patches) < n:
            raise InputError(f"n must be at most {len(patches)}, the number of the shape's patches; got {n}")
        with np.errstate(divide="ignore"):
            keys = rng.standard_exponential(len(patches)) / patches.areas
        rows = np.argpartition(keys, n - 1)[:n]
        return Samples(patches.points[rows], patches.normals[rows], rows.astype(np.int32))


def _blue(source: Any, n: int, rng: np.random.Generator) -> Samples:
    """Eliminate crowded candidates, then part the pairs that are still too near with candidates from the gaps."""
    from surfel.shapes.sample_apart import eliminate, keep_apart

    hexagonal = math.sqrt(2.0 * source.area / (math.sqrt(3.0) * n))
    drawn = source.random(_CANDIDATES * n, rng)
    order = eliminate(drawn.points, drawn.normals, n, hexagonal)
    kept = keep_apart(drawn.points, drawn.normals, order, n, _APART * hexagonal)
    for _ in range(_ROUNDS if not isinstance(source, _OfPatches) else 0):
        if len(kept) == n:
            break
        more = _joined(_rows(drawn, kept), source.random(_CANDIDATES * n, rng))
        drawn, order = more, np.arange(len(more.points), dtype=np.int32)
        kept = keep_apart(drawn.points, drawn.normals, order, n, _APART * hexagonal)
    if len(kept) < n:  # no room: the least crowded of the rest
        rest = order[~np.isin(order, kept)]
        kept = np.concatenate([kept, rest[: n - len(kept)]])
    return _rows(drawn, kept)


def _dense(source: Any, radius: float, rng: np.random.Generator) -> Samples:
    """Throw darts, then cover what is left, triangle by triangle."""
    from surfel.shapes.sample_apart import keep_apart
    from surfel.shapes.sample_cover import cover

    if not isinstance(source, OfMesh):
        raise InputError("radius needs a mesh: only there is a surface between the points")
    mesh = source.mesh
    darts = 3.0 * source.area / radius**2 + 16.0
    if darts > _MOST:
        raise InputError(f"radius {radius:g} asks for about {darts / 4:.1g} points; the most is {_MOST // 4:.0e}")
    drawn = source.random(int(darts), rng)
    every = np.arange(len(drawn.points), dtype=np.int32)
    thrown = _rows(drawn, keep_apart(drawn.points, drawn.normals, every, len(every), radius))
    return Samples(*cover(mesh.vertices[mesh.triangles], mesh.face_normals, *thrown, radius))


def _rows(samples: Samples, rows: NDArray[np.int32]) -> Samples:
    return Samples(samples.points[rows], samples.normals[rows], samples.triangles[rows])


def _joined(a: Samples, b: Samples) -> Samples:
    both = [np.concatenate([a[k], b[k]]) for k in range(3)]
    return Samples(both[0], both[1], both[2])
