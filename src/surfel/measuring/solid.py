"""Measuring exact solids, trees and sheets: elements or lines for the area, lines for what lies inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from surfel.core.errors import InputError
from surfel.core.estimate import Estimate, combine_errors
from surfel.core.execute import Progress
from surfel.measuring.by_lines import LineResult
from surfel.measuring.by_patches import active_leaves, measure_by_patches, measures_by_patches
from surfel.measuring.cloud import depth_error
from surfel.measuring.measurement import Measurement
from surfel.shapes.base import Shape
from surfel.shapes.extent import bounded
from surfel.shapes.placed import Placed
from surfel.shapes.primitives.primitive import Primitive
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree, postorder


@dataclass(frozen=True, eq=False)
class Work:
    """What was asked for: how many lines, from which seed, how narrow; and how lines are cast."""

    lines: int
    seed: int
    tolerance: float | None
    progress: Progress | None
    count_lines: Callable[[], LineResult]
    weigh_inside: Callable[[], LineResult]


def measure_solid(shape: Shape, method: str | None, work: Work) -> Measurement:
    """Measure an exact solid, a tree, or any sheet that lines can cross.

    Raises
    ------
    InputError
        If the shape is unbounded, or its area is asked by patches where a leaf has none.
    """
    if isinstance(shape, Primitive | Placed):
        shape = shape._alone
    if not isinstance(shape, Tree):
        return _measure_sheet(shape, method, work)
    box = bounded(shape)
    active = active_leaves(shape)
    if not active:
        zero = Estimate(0.0, 0.0)
        return Measurement(
            zero, zero, areas=tuple(zero for _ in shape.leaves), closed=True, leak=0.0, warnings=("the tree is empty",)
        )
    has_patches = measures_by_patches(shape)
    chosen = method or ("patches" if has_patches else "lines")
    if chosen == "patches" and not has_patches:
        raise InputError("a leaf of the tree is known by its equation alone and has no patches; take method='lines'")
    result = _area_of(shape, box, chosen, work)
    result = replace(result, points=sum(len(leaf) for leaf in shape.leaves if isinstance(leaf, Surfels)))
    if not _has_inside(shape):
        return replace(result, closed=False, warnings=("the tree is a sheet: it has an area but no volume",))
    return _with_inside(shape, result, work.weigh_inside())


def _area_of(tree: Tree, box: Any, method: str, work: Work) -> Measurement:
    if method == "patches":
        found = measure_by_patches(tree, box, work.lines, work.seed, work.tolerance, work.progress)
        return Measurement(found.area, areas=found.areas, method="patches")
    counted = work.count_lines()
    areas = tuple(
        _with_sampling(leaf, area) if isinstance(leaf, Surfels) else area
        for leaf, area in zip(tree.leaves, counted.areas, strict=True)
    )
    extra = combine_errors(
        *(
            _sampling_error(leaf, area)
            for leaf, area in zip(tree.leaves, counted.areas, strict=True)
            if isinstance(leaf, Surfels)
        )
    )
    area = _widened(counted.area, extra)
    return Measurement(area, areas=areas, method="lines", lines=counted.lines, leak=counted.leak)


def _with_sampling(cloud: Surfels, area: Estimate) -> Estimate:
    return _widened(area, _sampling_error(cloud, area))


def _sampling_error(cloud: Surfels, part: Estimate) -> float:
    """Return the error of a part of a cloud's area that comes from its sampling."""
    surface = cloud.surface
    if surface.local is None or surface.local.area == 0.0:
        return 0.0
    local, sampling = surface.known
    square = surface.scale**2
    return float(sampling.standard_error * square * np.sqrt(abs(float(part.value)) / (local.area * square)))


def _with_inside(tree: Tree, result: Measurement, found: LineResult) -> Measurement:
    """Add volume and moments; clouds add what their surface leaves open between the points."""
    clouds = [(k, leaf) for k, leaf in enumerate(tree.leaves) if isinstance(leaf, Surfels) and not leaf._is_sheet()]
    volume, centroid, inertia = found.volume, found.centroid, found.inertia
    leak = max([found.leak, *(leaf.surface.leak for _, leaf in clouds)])
    if clouds and float(volume.value) > 0.0:
        depth = combine_errors(*(depth_error(leaf.surface) * float(result.areas[k].value) for k, leaf in clouds))
        unsure = float(combine_errors(depth, 0.25 * leak * float(volume.value)))
        relative = unsure / float(volume.value)
        volume = _widened(volume, unsure)
        centroid = _widened(centroid, np.full(3, 0.5 * relative * float(np.cbrt(float(volume.value)))))
        inertia = _widened(inertia, np.abs(inertia.value) * relative)
    return replace(
        result,
        volume=volume,
        centroid=centroid,
        inertia=inertia,
        closed=True,
        leak=leak,
        lines=result.lines + found.lines,
    )


def _widened(estimate: Estimate, extra: Any) -> Estimate:
    if not np.any(extra):
        return estimate
    error = combine_errors(estimate.standard_error, extra)
    return replace(estimate, standard_error=error, freedom=np.inf)


def _measure_sheet(shape: Shape, method: str | None, work: Work) -> Measurement:
    """Measure a surface that is no solid by its own elements, or by lines."""
    if method == "lines":
        counted = work.count_lines()
        area, lines = counted.area, counted.lines
    else:
        total = float(shape._patches(work.lines).areas.sum())
        half = float(shape._patches(max(1, work.lines // 4)).areas.sum())
        area, lines = Estimate(total, abs(total - half) / 2.0), 0
    closed = not shape._is_sheet()
    result = Measurement(area, areas=(area,), method=method or "patches", lines=lines)
    if not closed:
        return replace(result, warnings=("the shape is a sheet: it has an area but no volume",))
    found = work.weigh_inside()
    return replace(
        result, volume=found.volume, centroid=found.centroid, inertia=found.inertia, closed=True, leak=found.leak,
        lines=lines + found.lines,
    )  # fmt: skip


def _has_inside(tree: Tree) -> bool:
    """Tell whether anything can lie inside: sheets bound nothing, nor does what they are intersected with."""
    solid: dict[int, bool] = {}
    for node in postorder(tree):
        if not isinstance(node, Tree):
            solid[id(node)] = not node._is_sheet()
            continue
        inputs = [solid[id(child)] for child in node.children]
        if node.operation == "union":
            solid[id(node)] = any(inputs)
        else:
            solid[id(node)] = all(inputs if node.operation == "intersection" else inputs[:1])
    return solid[id(tree)]
