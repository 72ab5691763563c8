"""Measuring a mesh: in closed form, with nothing but rounding as error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from surfel.core.cast import Floats
from surfel.core.estimate import Estimate
from surfel.measuring.by_lines import LineResult
from surfel.measuring.line_sums import inertia_tensor
from surfel.measuring.measurement import Measurement
from surfel.shapes.mesh import Mesh

_EPS = 4.0 * float(np.finfo(np.float64).eps)


def measure_mesh(mesh: Mesh, found: tuple[LineResult, LineResult] | None) -> Measurement:
    """Measure a mesh: exactly, or by the lines that were cast.

    Volume and moments are integrals over the cone of each triangle and a point in the middle (the divergence theorem).

    Parameters
    ----------
    mesh : Mesh
        Open or closed.
    found : two LineResults, optional
        What lines of all directions told of the area, and parallel lines of the inside; they replace the exact values.
    """
    warnings = []
    if len(mesh.triangles) == 0:
        zero = Estimate(0.0, 0.0)
        return Measurement(zero, areas=(zero,), points=len(mesh.vertices), warnings=("the mesh has no triangles",))
    if mesh.inverted:
        warnings.append("the triangles face inward; the volume is given as if they faced outward")
    if not mesh.closed:
        warnings.append("the mesh is open: it has an area but no volume")
    exact = Measurement(
        area=_rounded(mesh.area, mesh.area),
        closed=mesh.closed,
        leak=0.0 if mesh.closed else math.nan,
        points=len(mesh.vertices),
        warnings=tuple(warnings),
    )
    if mesh.closed:
        volume, centroid, inertia = _moments(mesh)
        exact = replace(exact, volume=volume, centroid=centroid, inertia=inertia)
    if found is None:
        return replace(exact, areas=(exact.area,))
    counted, inside = found
    lined = replace(
        exact,
        area=counted.area,
        areas=(counted.area,),
        method="lines",
        lines=counted.lines + inside.lines,
        leak=inside.leak,
    )
    if not mesh.closed:
        return lined
    return replace(lined, volume=inside.volume, centroid=inside.centroid, inertia=inside.inertia)


def _moments(mesh: Mesh) -> tuple[Estimate, Estimate, Estimate]:
    low, high = mesh.bounds
    middle = 0.5 * low + 0.5 * high
    unit = float((high - low).max())
    a, b, c = np.moveaxis((mesh.vertices[mesh.triangles] - middle) / unit, 1, 0)
    cone = np.einsum("ij,ij->i", a, np.cross(b, c)) * (-1.0 if mesh.inverted else 1.0)
    total = a + b + c
    volume = float(cone.sum()) / 6.0
    first = (cone[:, None] * total).sum(axis=0) / 24.0
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    second = np.array([float((cone * _products(a, b, c, total, i, j)).sum()) for i, j in pairs]) / 120.0
    centre, tensor = inertia_tensor(volume, first, second)
    rounding = float(np.abs(cone).sum()) / 6.0
    return (
        _rounded(volume * unit**3, rounding * unit**3),
        Estimate(centre * unit + middle, np.full(3, _EPS * rounding / abs(volume) * unit) + _EPS * np.abs(middle)),
        Estimate(tensor * unit**5, np.full((3, 3), _EPS * rounding * unit**5)),
    )


def _products(a: Floats, b: Floats, c: Floats, total: Floats, i: int, j: int) -> Floats:
    return np.asarray(a[:, i] * a[:, j] + b[:, i] * b[:, j] + c[:, i] * c[:, j] + total[:, i] * total[:, j])


def _rounded(value: float, magnitude: float) -> Estimate:
    return Estimate(value, _EPS * abs(magnitude))
