"""Marching cubes over the tree's function: scikit-image's, which the extra ``bench`` brings."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from surfel._numba import rows, threads_for
from surfel._vec import norm
from surfel.core.cast import Floats, as_count
from surfel.core.errors import MissingExtraError
from surfel.measuring.baselines.baseline import Reading
from surfel.measuring.baselines.functions import PLANE, gradient_at, value_at
from surfel.measuring.baselines.implicit import AND, Implicit, implicit_of
from surfel.shapes.base import Shape

_ROOM = 1.5  # cells left free on every side


def marching_cubes(shape: Shape, effort: int) -> Reading:
    """Find the area of a tree by the triangles of marching cubes (Lorensen and Cline, 1987).

    A tree's function is the least and the greatest of those of its leaves, each divided by the length of its gradient,
    which makes it a distance to first order.

    Parameters
    ----------
    shape : Shape
        A tree of half-spaces, boxes, spheres, ellipsoids, cylinders, cones, quadrics and tori.
    effort : int
        Cubes along each side of the cube round the solid, at least 4.

    Returns
    -------
    Reading
        Its elements are the triangles.

    Raises
    ------
    InputError
        If the tree is unbounded, or a leaf has no implicit function here.
    MissingExtraError
        If scikit-image is not installed.

    Examples
    --------
    >>> import surfel
    >>> from surfel.measuring.baselines import marching_cubes
    >>> area, triangles, seconds = marching_cubes(surfel.Sphere(10), 40)  # doctest: +SKIP
    """
    cubes = as_count(effort, "effort", 4)
    measure = _measure()
    started = time.perf_counter()
    implicit = implicit_of(shape)
    low, high = np.asarray(shape.bounds)
    size = float((high - low).max())
    if not len(implicit.tokens) or size == 0.0:
        return Reading(0.0, 0, time.perf_counter() - started)
    step = size / (cubes - 2.0 * _ROOM)
    start = 0.5 * (low + high) - 0.5 * step * cubes
    field = field_on_grid(implicit, start, step, cubes + 1)
    if field.min() >= 0.0:
        return Reading(0.0, 0, time.perf_counter() - started)
    vertices, faces, _, _ = measure.marching_cubes(field, 0.0, spacing=(step, step, step))
    area = float(measure.mesh_surface_area(vertices, faces))
    return Reading(area, len(faces), time.perf_counter() - started)


def _measure() -> Any:
    try:
        from skimage import measure
    except ImportError as error:
        raise MissingExtraError("scikit-image", "bench") from error
    return measure


def field_on_grid(implicit: Implicit, start: Floats, step: float, points: int) -> Floats:
    """Return the tree's function on a cubic grid, shape (points, points, points): negative inside."""
    field = np.empty((points, points, points))
    with threads_for(field.size):
        _fill(points, implicit.functions, implicit.tokens, start, float(step), field)
    return field


@rows
def _fill(first, last, functions, tokens, start, step, field):
    stack = np.empty(len(tokens) + 1)
    points = field.shape[1]
    for i in range(first, last):
        x = start[0] + step * i
        for j in range(points):
            y = start[1] + step * j
            for k in range(points):
                z = start[2] + step * k
                top = -1
                for token in tokens:
                    if token >= 0:
                        row = functions[token >> 1]
                        value = value_at(row, x, y, z)
                        if row[0] != PLANE:  # whose gradient has length one
                            gx, gy, gz = gradient_at(row, x, y, z)
                            value /= norm(gx, gy, gz) + 1e-9 * step
                        top += 1
                        stack[top] = -value if token & 1 else value
                    else:
                        top -= 1
                        if token == AND:
                            stack[top] = max(stack[top], stack[top + 1])
                        else:
                            stack[top] = min(stack[top], stack[top + 1])
                field[i, j, k] = stack[0]
