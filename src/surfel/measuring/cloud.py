"""Measuring a cloud: its patches for the area, lines for what only lines can tell."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from surfel.core.estimate import Estimate, combine_errors
from surfel.measuring.by_lines import LineResult
from surfel.measuring.measurement import Measurement
from surfel.shapes.cloud_surface import CloudSurface
from surfel.shapes.surfels import CLOSED_BELOW, Surfels
from surfel.surface.sampling_error import HALVES_FROM, TOO_NOISY
from surfel.surface.trusted import Trusted

FEW_POINTS = 100
"""With fewer points no interval is called reliable."""

TOLD = 0.005
"""Share of single normals that were replaced from which it is said."""

REPLACED = 0.03
"""Standard error of the area for normals that were replaced, as a share of theirs: one in ten is not found."""

LEFT = 0.001
"""Share of the area that strays are likely to have added from which it is said."""

GAPS = 0.01
"""Share of the area that spans gaps wider than chance makes them, from which it is said."""

RAGGED = 0.025
"""Roughness of the points as they are, as a share of the area, above which neighbours do not lie on one surface."""

TOO_COARSE = 0.12
"""An interval wider than this share of the value, to either side, means that the points do not show the shape."""

COARSE = 0.25
"""Share of the error of the area that is one of the volume: detail that costs area costs volume as well."""

LEAKED = 0.25
"""Standard error of the volume for lines that leak, as a share of it times theirs."""

OVER_SMOOTH, OVER_EDGES = 0.1, 0.3
"""Standard errors of the volume between the triangles and the curved surface, as shares of it."""


def measure_cloud(
    cloud: Surfels, method: str, count_lines: Callable[[], LineResult], weigh_inside: Callable[[], LineResult]
) -> Measurement:
    """Measure a cloud: its patches for the area, lines for what only lines can tell."""
    surface = cloud.surface
    known = Measurement(
        area=Estimate(0.0, 0.0),
        method=method,
        points=len(cloud) + cloud.dropped,
        cleaning={
            "non_finite": cloud.dropped,
            **surface.cleaning,
            "without_normal": _without_normal(cloud),
            "wrong_normals": surface.trusted.wrong,
        },
        spacing=surface.spacing,
        noise=surface.noise,
    )
    if known.points == 0:
        return replace(known, areas=(known.area,), warnings=("the cloud is empty",))
    cleaned = [
        *_normals_warnings(surface.trusted, len(surface.rows)),
        *_cleaning_warnings(known.cleaning, known.points),
    ]
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
    left = surface.left_strays.expected * surface.scale**2
    if left > LEFT * float(area.value):
        warnings.append(
            "not all strays near the surface can be told from it: those that are left are likely to make "
            f"the area {left / float(area.value):.1%} too large, for which its interval is wider"
        )
    gaps = surface.known[1].gaps / local.area
    if gaps > GAPS:
        warnings.append(
            f"gaps several times as wide as the points lie apart, {gaps:.1%} of the area beyond what chance makes, "
            "count as surface, for which the interval is wider; parts that were never scanned do not belong to it"
        )
    if surface.is_overlay:
        warnings.append(
            "parts of the surface are covered by one scan, and parts by several laid over each other: "
            "layers nearer than half a spacing count once, as noise; farther ones would count each"
        )
    warnings.extend(cleaned)
    return replace(result, warnings=tuple(warnings))


def _area_of_cloud(surface: CloudSurface, counted: LineResult | None) -> Estimate:
    """Join the error of the sampling with that of the lines."""
    square = surface.scale**2
    local, sampling = surface.known
    value, error = local.area * square, sampling.standard_error * square
    replaced = 0 if surface.trusted.refused else surface.trusted.wrong
    left = surface.left_strays.half_width * square / 1.959964
    error = float(combine_errors(error, REPLACED * replaced / len(local.areas) * value, left))
    if counted is not None:
        value, error = float(counted.area.value), float(combine_errors(error, counted.area.standard_error))
    reasons = []
    points = len(local.areas)
    if points < FEW_POINTS:
        reasons.append(f"only {points} points")
    elif points < HALVES_FROM:
        reasons.append(f"{points} points are too few to be halved, which tells how well they sample the shape")
    if surface.overlaid:
        reasons.append(
            "layers that face the same way lie closer than their points, as of scans laid over each other: "
            "each counts, so the area is that of all layers together; merge the scans, or leave out the normals"
        )
    if surface.two_sheets:
        reasons.append(
            f"what reads as noise of {local.noise:.2f} spacings is two sheets nearer to each other than the points of "
            "one, a thin plate or scans laid over each other: the area is that of about one of them"
        )
    elif surface.thin:
        reasons.append(
            "points whose normals face away from each other lie nearer than half a spacing, as those of the two sides "
            "of a thin plate do: the area is that of about one of them"
        )
    elif points >= HALVES_FROM and surface.crowded:
        reasons.append(
            "sheets lie nearer to each other than about two spacings of their points, which without normals cannot be "
            "told apart; give normals, or more points"
        )
    elif local.noise > TOO_NOISY:
        reasons.append(f"noise of {local.noise:.2f} spacings hides the surface")
    ragged = not local.projected and local.roughness > RAGGED * local.area
    if points >= HALVES_FROM and (ragged or error * 1.96 > TOO_COARSE * value):
        reasons.append(f"the sampling is too coarse for the shape: {_coarse(surface)}")
    return Estimate(value, error, reliable=not reasons, reason="; ".join(reasons))


def _coarse(surface: CloudSurface) -> str:
    """Say what tells that the points lie too far apart."""
    local, sampling = surface.known
    if sampling.thinning + sampling.halves > TOO_COARSE * local.area:
        return "halving it changes the area a lot"
    return "the surface is rough or ragged at the distance of the points"


def _solid_of_cloud(
    surface: CloudSurface, found: LineResult, area: Estimate, closed: bool
) -> tuple[Estimate, Estimate, Estimate]:
    """Add to the lines' errors what the surface between the points leaves open, and what leaks away."""
    volume, depth = float(found.volume.value), depth_error(surface) * float(area.value)
    coarse = COARSE * float(area.standard_error) / float(area.value) * volume
    over = surface.bulge
    parts = depth, coarse, LEAKED * found.leak * volume, OVER_SMOOTH * over.smooth, OVER_EDGES * over.edges
    unsure = float(combine_errors(*parts))
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


def depth_error(surface: CloudSurface) -> float:
    """Return the standard error of where the surface lies, along its normal: a share of how far patches bend."""
    local, _ = surface.known
    spacing = local.hood.spacing
    bend = spacing * np.sqrt(np.maximum(local.cells.rough, 0.0)) * 0.25
    noise = local.noise * float(np.median(spacing)) * 0.05
    return float(
        math.hypot(0.05 * float(np.average(bend, weights=np.maximum(local.areas, 0.0) + 1e-300)), noise)
    ) * float(surface.scale)


def _without_normal(cloud: Surfels) -> int:
    return 0 if cloud.normals is None else int((~cloud.normals.any(axis=1)).sum())


def _normals_warnings(trusted: Trusted, points: int) -> list[str]:
    """Say which of the given normals were not believed; a few that differ may be fine detail."""
    if trusted.refused:
        return [
            f"the given normals do not belong to the points, which fitted ones describe better: {trusted.wrong:,} of "
            f"{points:,} differ from those of all neighbours, the others are typically "
            f"{math.degrees(trusted.slant):.1f} degrees off, and more where edges were rounded off; they were left out"
        ]
    if trusted.wrong > TOLD * points:
        return [
            f"{trusted.wrong:,} of the given normals differ from those of all neighbours, whose points show no edge "
            "there; others were fitted in their place"
        ]
    return []


def _cleaning_warnings(cleaning: Any, points: int) -> list[str]:
    texts = {
        "non_finite": "points had coordinates that are not finite and were left out",
        "duplicates": "points repeat the place of another and were counted once",
        "strays": "points belong to no surface and were left out",
    }
    return [f"{cleaning[key]:,} of {points:,} {text}" for key, text in texts.items() if cleaning.get(key)]
