"""measure(): area, volume and moments of a shape, with their errors."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from surfel._numba import compile_seconds
from surfel.core.cast import Floats, as_choice, as_count, as_positive
from surfel.core.errors import InputError
from surfel.core.estimate import Estimate, combine_errors
from surfel.core.execute import Progress
from surfel.lines.box import OrientedBox, oriented_box
from surfel.lines.bundles import Bundles
from surfel.lines.enclosing import Ball, smallest_ball
from surfel.lines.models import MODELS
from surfel.measuring.by_lines import SHIFTS, LineResult, ShiftedLines, measure_by_lines
from surfel.measuring.exact import measure_mesh
from surfel.measuring.measurement import Measurement
from surfel.shapes.base import Shape
from surfel.shapes.cloud_surface import CloudSurface
from surfel.shapes.mesh import Mesh
from surfel.shapes.surfels import CLOSED_BELOW, Surfels
from surfel.surface.sampling_error import HALVES_FROM, TOO_NOISY

FEW_POINTS = 100
"""With fewer points no interval is called reliable."""

METHODS = ("patches", "lines")


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
    progress: Progress | None = None,
) -> Measurement:
    """Measure a shape.

    Parameters
    ----------
    shape : Shape
        A cloud (:class:`~surfel.Surfels`) or a mesh (:class:`~surfel.Mesh`).
    method : {"patches", "lines"}, optional
        How the area is found: by the weighted sum of local patches (the default; exact on a mesh), or by counting how
        often lines cross the same patches. Volume and moments of a cloud always come from lines.
    lines : int
        How many lines to cast in all; they are shared out to 16 random shifts, which tell the error.
    tolerance : float, optional
        Double the lines until the half-width of the 95 % interval of what lines measure (the volume; the area with
        ``method="lines"``) is at most this share of its value.
    seed : int
        Of the random shifts.
    model : {"tangent", "chord", "offset"}
        How a point of the sequence becomes a line through the enclosing ball.
    sequence : str or scipy.stats.qmc.QMCEngine
        "niederreiter", "r4", "sobol", "halton", "random", or an engine.
    reference : {"auto", "ball", "box"}
        The convex body that lines are cast through; by default that with the smaller surface, so that fewer lines
        miss. Models other than "tangent" belong to the ball.
    progress : callable, optional
        Called with the share done and what is being done.

    Returns
    -------
    Measurement
        In the units of the input; see its attributes.

    Raises
    ------
    InputError
        If an argument cannot be used.
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
    if method is not None:
        as_choice(method, "method", METHODS)
    count = as_count(lines, "lines", 16, 1 << 34)
    number = as_count(seed, "seed", 0)
    goal = None if tolerance is None else as_positive(tolerance, "tolerance")
    as_choice(model, "model", MODELS)
    as_choice(reference, "reference", ("auto", "ball", "box"))
    if reference == "box" and model != "tangent":
        raise InputError(f"model {model!r} belongs to the ball; take reference='ball', or model='tangent'")

    def count_lines() -> LineResult:
        source = ShiftedLines.of(_body(shape, model, reference), model, sequence, number)
        return measure_by_lines(shape, source, count, tolerance=goal, goal="area", progress=progress)

    def weigh_inside() -> LineResult:
        points, margin = _hull(shape)
        source = Bundles.over(points, SHIFTS, number, margin)
        return measure_by_lines(shape, source, count, tolerance=goal, goal="volume", progress=progress)

    if isinstance(shape, Mesh):
        result = measure_mesh(
            shape, (count_lines(), weigh_inside()) if method == "lines" and len(shape.triangles) else None
        )
    elif isinstance(shape, Surfels):
        result = _measure_cloud(shape, method or "patches", count_lines, weigh_inside)
    else:
        raise InputError(f"shape must be a surfel.Surfels or a surfel.Mesh; got {type(shape).__name__}")
    compiling = compile_seconds() - compiled
    seconds = time.perf_counter() - started - compiling
    return replace(result, seed=number, seconds=seconds, compile_seconds=compiling)


def _measure_cloud(
    cloud: Surfels, method: str, count_lines: Callable[[], LineResult], weigh_inside: Callable[[], LineResult]
) -> Measurement:
    """Measure a cloud: its patches for the area, lines for what only lines can tell."""
    surface = cloud.surface
    known = Measurement(
        area=Estimate(0.0, 0.0),
        method=method,
        points=len(cloud) + cloud.dropped,
        cleaning={"non_finite": cloud.dropped, **surface.cleaning, "without_normal": _without_normal(cloud)},
        spacing=surface.spacing,
        noise=surface.noise,
    )
    if known.points == 0:
        return replace(known, areas=(known.area,), warnings=("the cloud is empty",))
    cleaned = _cleaning_warnings(known.cleaning, known.points)
    local = surface.local
    if local is None or local.area == 0.0:
        what = "lie at fewer than four places" if local is None else "lie on a line, or too far apart to tell a surface"
        area = Estimate.unknown(f"the {len(cloud)} points {what}: they show no surface")
        return replace(known, area=area, areas=(area,), warnings=(area.reason, *cleaned))
    counted = count_lines() if method == "lines" else None
    found = weigh_inside()
    area = _area_of_cloud(surface, counted)
    warnings = [area.reason] if area.reason else []
    closed = found.leak < CLOSED_BELOW and found.volume.value > 0.0
    result = replace(
        known,
        area=area,
        areas=(area,),
        closed=closed,
        leak=found.leak,
        lines=found.lines + (0 if counted is None else counted.lines),
    )
    if found.volume.value > 0.0 and cloud.solid is not False and (closed or cloud.solid):
        volume, centroid, inertia = _solid_of_cloud(surface, found, area, closed)
        result = replace(result, volume=volume, centroid=centroid, inertia=inertia)
        if volume.reason:
            warnings.append(f"volume: {volume.reason}")
    elif cloud.solid is None and found.leak < 0.5:
        warnings.append(
            f"no volume: {found.leak:.1%} of the lines that hit pass an odd number of sheets, so the surface is open; "
            "say that it is a solid (solid=True, --solid) to have a volume all the same"
        )
    elif cloud.solid is not False and math.isnan(found.leak):
        warnings.append(f"no volume: none of {found.lines:,} lines hit the surface; cast more")
    if surface.ambiguous_signs:
        warnings.append(
            f"the signs of the normals are ambiguous: {surface.ambiguous_signs:.1%} of the neighbours contradict each "
            "other; areas and volumes do not depend on them, in and out along a line do"
        )
    if surface.noise > 0.1:
        warnings.append(f"the points lie off the surface by {surface.noise:.2f} spacings; they were projected onto it")
    warnings.extend(cleaned)
    return replace(result, warnings=tuple(warnings))


def _area_of_cloud(surface: CloudSurface, counted: LineResult | None) -> Estimate:
    """Join the error of the sampling with that of the lines."""
    square = surface.scale**2
    local, sampling = surface.known
    value, error = local.area * square, sampling.standard_error * square
    if counted is not None:
        value, error = float(counted.area.value), float(combine_errors(error, counted.area.standard_error))
    reasons = []
    points = len(local.areas)
    if points < FEW_POINTS:
        reasons.append(f"only {points} points")
    elif points < HALVES_FROM:
        reasons.append(f"{points} points are too few to be halved, which tells how well they sample the shape")
    if surface.two_sheets:
        reasons.append(
            f"what reads as noise of {local.noise:.2f} spacings is two sheets nearer to each other than the points of "
            "one: the area is that of about one of them"
        )
    elif local.noise > TOO_NOISY:
        reasons.append(f"noise of {local.noise:.2f} spacings hides the surface")
    if points >= HALVES_FROM and error * 1.96 > 0.25 * value:
        reasons.append(f"the sampling is too coarse for the shape: {_coarse(surface)}")
    return Estimate(value, error, reliable=not reasons, reason="; ".join(reasons))


def _coarse(surface: CloudSurface) -> str:
    """Say what tells that the points lie too far apart."""
    _, sampling = surface.known
    if sampling.thinning + sampling.halves > math.hypot(sampling.border, sampling.roughness, sampling.noise):
        return "halving it changes the area a lot"
    return "the surface is rough or ragged at the distance of the points"


def _solid_of_cloud(
    surface: CloudSurface, found: LineResult, area: Estimate, closed: bool
) -> tuple[Estimate, Estimate, Estimate]:
    """Add to the lines' errors what the surface between the points leaves open, and what leaks away."""
    depth = _depth_error(surface)
    volume = float(found.volume.value)
    unsure = float(combine_errors(depth * float(area.value), 0.25 * found.leak * volume))
    relative = unsure / volume
    size = float(np.cbrt(volume))
    reason = "" if closed else f"the surface is open: {found.leak:.1%} of the lines that hit leak"

    def widened(estimate: Estimate, extra: Any) -> Estimate:
        error = combine_errors(estimate.standard_error, extra)
        return replace(estimate, standard_error=error, freedom=math.inf, reliable=not reason, reason=reason)

    return (
        widened(found.volume, unsure),
        widened(found.centroid, np.full(3, 0.5 * relative * size)),
        widened(found.inertia, np.abs(found.inertia.value) * relative),
    )


def _depth_error(surface: CloudSurface) -> float:
    """Return the standard error of where the surface lies, along its normal: a share of how far patches bend."""
    local, _ = surface.known
    spacing = local.hood.spacing
    bend = spacing * np.sqrt(np.maximum(local.cells.rough, 0.0)) * 0.25
    noise = local.noise * float(np.median(spacing)) * 0.05
    return float(
        math.hypot(0.05 * float(np.average(bend, weights=np.maximum(local.areas, 0.0) + 1e-300)), noise)
    ) * float(surface.scale)


def _body(shape: Shape, model: str, reference: str) -> Ball | OrientedBox:
    """Return the convex body that lines of all directions are cast through."""
    points, margin = _hull(shape)
    ball = smallest_ball(points).grown(margin)
    if reference == "ball" or (reference == "auto" and model != "tangent"):
        return ball
    box = oriented_box(points).grown(margin)
    return box if reference == "box" or box.surface < ball.surface else ball


def _hull(shape: Shape) -> tuple[Floats, float]:
    """Return points whose convex hull, grown by a margin, holds all that can be crossed."""
    if isinstance(shape, Surfels):
        patches = shape.surface.patches
        return patches.points[patches.areas != 0.0], 2.0 * shape.surface.spacing
    vertices: Floats = shape.vertices  # type: ignore[attr-defined]
    return vertices, 1e-6 * float(np.abs(vertices - vertices.mean(axis=0)).max())


def _without_normal(cloud: Surfels) -> int:
    return 0 if cloud.normals is None else int((~cloud.normals.any(axis=1)).sum())


def _cleaning_warnings(cleaning: Any, points: int) -> list[str]:
    texts = {
        "non_finite": "points had coordinates that are not finite and were left out",
        "duplicates": "points repeat the place of another and were counted once",
        "strays": "points belong to no surface and were left out",
    }
    return [f"{cleaning[key]:,} of {points:,} {text}" for key, text in texts.items() if cleaning.get(key)]
