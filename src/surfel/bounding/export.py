"""A safe spline for other programs: SciPy's evaluator, and an exact NURBS surface in a 3DM file.

The graph of the spline is itself a spline surface: its control points lie at the Greville abscissae, at the heights of
the coefficients. The ends are clamped on the way, which most readers expect and which changes two coefficients at each
end: with the blossom F of a uniform cubic, F(0, 0, 0) and F(0, 0, 1) take the place of F(-2, -1, 0) and F(-1, 0, 1).
"""

from __future__ import annotations

import tempfile
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from surfel.bounding.trim import outlines
from surfel.core.cast import Floats
from surfel.core.errors import InputError, MissingExtraError, SurfelError

if TYPE_CHECKING:
    from surfel.bounding.height_spline import HeightSpline
    from surfel.bounding.spline import SafeSpline

_NAME = "safe spline"
_VERSION = 7
_STEPS = 8  # corners of an outline's polyline to a cell
_PAD = 64.0 * float(np.finfo(np.float64).eps)


def to_scipy(spline: HeightSpline) -> Any:
    """Return the spline as :class:`scipy.interpolate.NdBSpline` over its domain, NaN outside."""
    from scipy.interpolate import NdBSpline

    n, m = spline.shape
    knots = np.arange(-3.0, n + 3.0), np.arange(-3.0, m + 3.0)
    return NdBSpline(knots, np.array(spline.coefficients), 3, extrapolate=False)


def to_3dm(spline: SafeSpline, path: str | PathLike[str]) -> None:
    """Write the surface and the outlines of its trim; what was written is read back and verified first."""
    rhino = _rhino()
    from surfel.io.atomic import replacing

    raised = spline.coefficients + _outward_pad(spline)
    points = control_points(spline, raised)
    knots = [_knots(count) for count in spline.shape]
    model = rhino.File3dm()
    model.Objects.AddSurface(_surface(rhino, points, knots), _named(rhino, _NAME))
    for polygon in outlines(spline.trim):
        model.Objects.AddPolyline(_polyline(rhino, spline, raised, polygon), _named(rhino, "trim"))
    with tempfile.TemporaryDirectory(prefix="surfel-") as folder:
        written = Path(folder) / "surface.3dm"
        if not model.Write(str(written), _VERSION):
            raise SurfelError(f"rhino3dm could not write {written}")
        _verify(spline, *read_surface(written), knots)
        data = written.read_bytes()
    with replacing(path) as stream:
        stream.write(data)


def control_points(spline: SafeSpline, coefficients: Floats) -> Floats:
    """Return the control points of the graph with clamped ends in world coordinates, shape (n + 2, m + 2, 3)."""
    clamped = _clamped(_clamped(coefficients).T).T
    u, v = (_greville(count) for count in spline.shape)
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    return spline.frame.to_world(places, clamped.ravel()).reshape(*clamped.shape, 3)


def read_surface(path: str | PathLike[str]) -> tuple[Floats, list[list[float]]]:
    """Return the control points, shape (n + 2, m + 2, 3), and the knots of the surface in a file of :func:`to_3dm`."""
    rhino = _rhino()
    model = rhino.File3dm.Read(str(path))
    for item in model.Objects if model is not None else ():
        surface = item.Geometry
        if isinstance(surface, rhino.NurbsSurface) and item.Attributes.Name == _NAME:
            grid = surface.Points
            points = [[grid[i, j] for j in range(grid.CountV)] for i in range(grid.CountU)]
            knots = [[knots[i] for i in range(len(knots))] for knots in (surface.KnotsU, surface.KnotsV)]
            return np.array([[[p.X, p.Y, p.Z] for p in row] for row in points]), knots
    raise SurfelError(f"{path}: holds no surface named {_NAME!r}")


def _rhino() -> Any:
    try:
        import rhino3dm
    except ImportError as error:
        raise MissingExtraError("rhino3dm", "cad") from error
    return rhino3dm


def _outward_pad(spline: SafeSpline) -> float:
    """Return by how much to move the surface away from the points before its control points are rounded.

    A control point is off by some units in the last place of its largest coordinate; sideways that moves the surface
    by as much times its slope.
    """
    slopes = [np.abs(np.diff(spline.coefficients, axis=axis)).max() * spline.frame.scale[axis] for axis in (0, 1)]
    reach = np.abs(control_points(spline, spline.coefficients)).max()
    pad = _PAD * float(reach) * (1.0 + float(max(slopes)))
    if not np.isfinite(pad):
        raise InputError("the surface is too steep for its coordinates to be written; move the points to the origin")
    return -pad if spline.side == "below" else pad


def _clamped(coefficients: Floats) -> Floats:
    """Return the coefficients along the first axis for knots that are clamped at both ends."""
    b = coefficients.copy()
    for end, one, two, three in ((0, 0, 1, 2), (-1, -1, -2, -3)):
        step = 1 if end == 0 else -1
        b[end] = (coefficients[one] + 4.0 * coefficients[two] + coefficients[three]) / 6.0
        b[end + step] = (2.0 * coefficients[two] + coefficients[three]) / 3.0
    return b


def _greville(count: int) -> Floats:
    """Return where the control points lie along the domain."""
    inner = np.arange(1.0, count - 1.0)
    return np.concatenate([[0.0, 1.0 / 3.0], inner, [count - 1.0 - 1.0 / 3.0, count - 1.0]])


def _knots(count: int) -> list[float]:
    """Return the knots as 3DM counts them: without the first and the last of the usual list."""
    last = float(count - 1)
    return [0.0, 0.0, *np.arange(count, dtype=np.float64).tolist(), last, last]


def _surface(rhino: Any, points: Floats, knots: list[list[float]]) -> Any:
    rows, columns = points.shape[:2]
    surface = rhino.NurbsSurface.Create(3, False, 4, 4, rows, columns)
    for target, values in zip((surface.KnotsU, surface.KnotsV), knots, strict=True):
        for i, knot in enumerate(values):
            target[i] = knot
    for i in range(rows):
        for j in range(columns):
            surface.Points[i, j] = rhino.Point4d(*points[i, j].tolist(), 1.0)
    return surface


def _named(rhino: Any, name: str) -> Any:
    attributes = rhino.ObjectAttributes()
    attributes.Name = name
    return attributes


def _polyline(rhino: Any, spline: SafeSpline, raised: Floats, polygon: Floats) -> Any:
    """Return an outline of the trim on the surface."""
    from surfel.bounding.evaluate import values

    ends = np.concatenate([polygon, polygon[:1]])
    steps = np.maximum(np.abs(np.diff(ends, axis=0)).max(axis=1) * _STEPS, 1.0).astype(int)
    parts = [np.linspace(a, b, step, endpoint=False) for a, b, step in zip(ends[:-1], ends[1:], steps, strict=True)]
    uv = np.concatenate([*parts, ends[:1]])
    points = spline.frame.to_world(uv, values(raised, uv))
    return [rhino.Point3d(*point) for point in points.tolist()]


def _verify(spline: SafeSpline, points: Floats, knots: list[list[float]], wanted: list[list[float]]) -> None:
    """Raise unless the surface that was read back lies beyond the spline by more than rounding can take away.

    Both have the same basis, whose functions are not negative: one lies beyond the other if its coefficients do.
    """
    pad = abs(_outward_pad(spline))
    beyond = points @ spline.direction - _clamped(_clamped(spline.coefficients).T).T
    outward = -beyond if spline.side == "below" else beyond
    apart = points - control_points(spline, spline.coefficients)
    aside = apart - (apart @ spline.direction)[..., None] * spline.direction
    near = 0.125 * _PAD * float(np.abs(points).max())
    if knots != wanted or not (outward > 0.25 * pad).all() or not (np.abs(aside) <= near).all():
        raise SurfelError(
            "the surface that was read back from the file is not the one that was written; nothing is kept"
        )
