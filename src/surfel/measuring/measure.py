"""measure(): area, volume and moments of a shape, with their errors."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from surfel._numba import compile_seconds
from surfel.core.box import corners
from surfel.core.cast import as_choice, as_count, as_positive
from surfel.core.errors import InputError
from surfel.core.execute import Progress
from surfel.io.las_crs import refuse_degrees
from surfel.lines.box import OrientedBox, oriented_box
from surfel.lines.bundles import Bundles
from surfel.lines.cylinder import EnclosingCylinder, enclosing_cylinder
from surfel.lines.enclosing import Ball, smallest_ball
from surfel.lines.models import MODELS
from surfel.measuring.by_lines import SHIFTS, LineResult, ShiftedLines, measure_by_lines
from surfel.measuring.cloud import measure_cloud
from surfel.measuring.exact import measure_mesh
from surfel.measuring.measurement import Measurement
from surfel.measuring.solid import Work, measure_solid
from surfel.shapes.base import Shape
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree

METHODS = ("patches", "lines", "qmca")
_WORTH_A_SEARCH = 1 << 17
"""Looking for a tilted box or a cylinder takes as long as some ten thousand lines."""

REFERENCES = ("auto", "ball", "box", "cylinder")


def measure(
    shape: Shape,
    *,
    method: str | None = None,
    lines: int = 65_536,
    tolerance: float | None = None,
    seed: int = 0,
    model: str = "tangent",
    sequence: Any = "niederreiter",
    reference: str = "auto",
    radius_factor: float = 1.5,
    depth: int = 4,
    cells: str = "line",
    density: str = "even",
    denoise: int = 0,
    progress: Progress | None = None,
) -> Measurement:
    """Measure a shape.

    Parameters
    ----------
    shape : Shape
        A cloud, a mesh, an exact primitive, or any Boolean tree of these; or what has a ``sheet()``, as a safe spline
        does.
    method : {"patches", "lines", "qmca"}, optional
        How the area is found. By patches: the weighted sum of a cloud's cells, the triangles of a mesh, and of a tree
        those elements of its leaves' surfaces that it keeps. By lines: by counting crossings (Cauchy and Crofton).
        Patches are the default, but for trees with a leaf that is known by its equation alone (a quadric, a
        polynomial). Volume and moments come from lines in either case; only those of a mesh are summed exactly. "qmca"
        is the method of Liu et al. (2006) for clouds, as published: an area without an error bar, to compare with.
    lines : int
        How many lines to cast, and as many elements for the area of a tree; they are shared out to 16 random shifts,
        which tell the error.
    tolerance : float, optional
        Double them until the half-width of the 95 % interval is at most this share of the value, for the area as for
        the volume; for a cloud or a mesh, whose area does not come from lines, for the volume.
    seed : int
        Of the random shifts.
    model : {"tangent", "chord", "offset"}
        How a point of the sequence becomes a line through the enclosing ball.
    sequence : str or scipy.stats.qmc.QMCEngine
        "niederreiter", "r4", "sobol", "halton", "random", or an engine.
    reference : {"auto", "ball", "box", "cylinder"}
        The convex body that lines are cast through; by default that with the smallest surface, so that the fewest
        lines miss. Models other than "tangent" belong to the ball.
    radius_factor : float
        Of "qmca" alone, as all that follow: lambda, the radius of the cylinder round a line over the size of a gap in
        the samples (the largest radius of the surfels, or the mean distance to the nearest neighbour).
    depth : int
        Of the octree, 1 to 10.
    cells : {"line", "cylinder"}
        Whether points are looked for in the cells that a line meets, as printed, or that its cylinder meets.
    density : {"even", "uneven", "resampled"}
        One radius for all points, one for each cell, or points inserted where there are few.
    denoise : int
        Passes of the bilateral filter; a warning says how far it moved the points.
    progress : callable, optional
        Called with the share done and what is being done.

    Returns
    -------
    Measurement
        In the units of the input; see its attributes.

    Raises
    ------
    InputError
        If an argument cannot be used, or a tree is unbounded.
    ConvergenceError
        If the tolerance cannot be reached.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> rng = np.random.default_rng(0)
    >>> p = rng.standard_normal((20000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> m = surfel.measure(surfel.Surfels(p))
    >>> abs(m.area.value / (4 * np.pi) - 1) < 0.002
    True
    """
    started, compiled = time.perf_counter(), compile_seconds()
    as_sheet = getattr(shape, "sheet", None)
    if callable(as_sheet):
        shape = as_sheet()
    if method is not None:
        as_choice(method, "method", METHODS)
    count = as_count(lines, "lines", 16, 1 << 34)
    number = as_count(seed, "seed", 0)
    goal = None if tolerance is None else as_positive(tolerance, "tolerance")
    as_choice(model, "model", MODELS)
    as_choice(reference, "reference", REFERENCES)
    if reference in ("box", "cylinder") and model != "tangent":
        raise InputError(f"model {model!r} belongs to the ball; take reference='ball', or model='tangent'")

    def as_published(cloud: Surfels) -> Measurement:
        from surfel.measuring.qmca import Qmca, measure_qmca, refuse_other

        refuse_other(reference, goal)
        options = Qmca(radius_factor, depth, cells, density, denoise).checked()
        return measure_qmca(cloud, options, count, number, model, sequence, progress)

    def count_lines() -> LineResult:
        source = ShiftedLines.of(_body(shape, model, reference, count), model, sequence, number)
        return measure_by_lines(shape, source, count, tolerance=goal, goal="area", progress=progress)

    def weigh_inside() -> LineResult:
        points, margin = shape._hull()
        source = Bundles.over(points, SHIFTS, number, margin)
        return measure_by_lines(shape, source, count, tolerance=goal, goal="volume", progress=progress)

    _refuse_degrees(shape)
    if method == "qmca" and isinstance(shape, Shape) and not isinstance(shape, Surfels):
        raise InputError(f"method 'qmca' measures clouds, and this is a {type(shape).__name__}; leave the method out")
    if isinstance(shape, Mesh):
        result = measure_mesh(
            shape, (count_lines(), weigh_inside()) if method == "lines" and len(shape.triangles) else None
        )
    elif isinstance(shape, Surfels) and method == "qmca":
        result = as_published(shape)
    elif isinstance(shape, Surfels):
        result = measure_cloud(shape, method or "patches", count_lines, weigh_inside)
    elif isinstance(shape, Shape):
        work = Work(count, number, goal, progress, count_lines, weigh_inside)
        result = measure_solid(shape, method, work)
    else:
        raise InputError(f"shape must be a surfel shape (a cloud, a mesh, a solid, a tree); got {type(shape).__name__}")
    compiling = compile_seconds() - compiled
    seconds = time.perf_counter() - started - compiling
    again = partial(
        _with_lines, shape, method=method, seed=number, model=model, sequence=sequence, reference=reference,
        radius_factor=radius_factor, depth=depth, cells=cells, density=density, denoise=denoise,
    )  # fmt: skip
    return replace(result, seed=number, seconds=seconds, compile_seconds=compiling, _again=again)


def _with_lines(shape: Shape, lines: int, **named: Any) -> Measurement:
    return measure(shape, lines=lines, **named)


def _body(shape: Shape, model: str, reference: str, lines: int) -> Ball | OrientedBox | EnclosingCylinder:
    """Return the convex body that lines of all directions are cast through; few lines are not worth a long search."""
    points, margin = shape._hull()
    if reference == "box":
        return oriented_box(points).grown(margin)
    if reference == "cylinder":
        return enclosing_cylinder(points).grown(margin)
    ball = smallest_ball(points).grown(margin)
    if reference == "ball" or model != "tangent":
        return ball
    if lines < _WORTH_A_SEARCH and len(points) < lines:
        low, high = corners(points)
        upright = OrientedBox(0.5 * (low + high), np.eye(3), 0.5 * (high - low))
        box = upright.grown(margin)
        return box if box.surface < ball.surface else ball
    box, cylinder = oriented_box(points).grown(margin), enclosing_cylinder(points).grown(margin)
    bodies: tuple[Ball | OrientedBox | EnclosingCylinder, ...] = (ball, box, cylinder)
    return bodies[int(np.argmin([body.surface for body in bodies]))]


def _refuse_degrees(shape: object) -> None:
    """Refuse clouds whose coordinates are angles: their areas mean nothing."""
    leaves = shape.leaves if isinstance(shape, Tree) else (shape,)
    for leaf in leaves:
        crs = leaf.provenance.get("crs") if isinstance(leaf, Surfels) else None
        if crs:
            refuse_degrees(str(crs))
