"""QMCA, the quasi-Monte Carlo area of a point-sampled surface, as published; to compare with, not to rely on.

Liu, Yong, Zhang, Yan and Sun, *A quasi-Monte Carlo method for computing areas of point-sampled surfaces*,
Computer-Aided Design 38, 2006. The page "QMCA as published" lists where its text is open and how it is read here.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from surfel.core.cast import Floats, as_choice, as_count, as_positive
from surfel.core.errors import InputError
from surfel.core.estimate import Estimate
from surfel.core.execute import Progress, blocks, run_blocks
from surfel.index.octree import DEEPEST
from surfel.lines.enclosing import Ball, smallest_ball
from surfel.lines.models import line_block
from surfel.lines.sequences import shifts
from surfel.measuring.measurement import Measurement
from surfel.shapes.clusters import CELLS, Reading
from surfel.shapes.lpsi import Lpsi, normals_for
from surfel.shapes.surfels import CLOSED_BELOW, Surfels

DENSITIES = ("even", "uneven", "resampled")
NO_ERROR = "the published method has no error bar: its counter's own error stays, however many lines are cast"
_BLOCK = 65_536
_ROOMY = 2.0  # cells of so many radii lose few points of the cylinder


class Qmca(NamedTuple):
    """The parameters of the method.

    Parameters
    ----------
    radius_factor : float
        lambda of equation (7).
    depth : int
        Of the octree.
    cells : {"line", "cylinder"}
        Which boundary cells are looked into; see :class:`~surfel.shapes.clusters.Reading`.
    density : {"even", "uneven", "resampled"}
        What is done about uneven sampling: nothing, an uneven cylinder, or inserted points (section 5.1).
    denoise : int
        Passes of the bilateral filter (section 5.2).
    """

    radius_factor: float = 1.5
    depth: int = 4
    cells: str = "line"
    density: str = "even"
    denoise: int = 0

    def checked(self) -> Qmca:
        """Return the same, or raise an :class:`~surfel.InputError` that says what cannot be used."""
        return Qmca(
            as_positive(self.radius_factor, "radius_factor"),
            as_count(self.depth, "depth", 1, DEEPEST),
            as_choice(self.cells, "cells", CELLS),
            as_choice(self.density, "density", DENSITIES),
            as_count(self.denoise, "denoise", 0, 100),
        )


def measure_qmca(
    cloud: Surfels, options: Qmca, lines: int, seed: int, model: str, sequence: Any, progress: Progress | None = None
) -> Measurement:
    """Estimate the area of a cloud by s = s_1 n / n_1 (equation (3)).

    Parameters
    ----------
    cloud : Surfels
        The points; their normals must point outward, as the counter depends on it.
    options : Qmca
        The parameters of the method.
    lines : int
        How many lines: one set, not sixteen.
    seed : int
        0 takes the sequence as it stands, as the paper does; other seeds shift it at random.
    model, sequence
        As for :func:`surfel.measure`.
    progress : callable, optional
        Called with the share done.
    """
    known = Measurement(
        area=Estimate(0.0, 0.0), method="qmca", points=len(cloud) + cloud.dropped, lines=lines, seed=seed
    )
    cleaning = {"non_finite": cloud.dropped}
    if known.points == 0:
        return replace(known, areas=(known.area,), cleaning=cleaning, warnings=("the cloud is empty",))
    prepared, warnings = _prepared(cloud, options, cleaning)
    if prepared is None:
        area = Estimate.unknown(f"the {len(cloud)} points show no surface")
        return replace(known, area=area, areas=(area,), cleaning=cleaning, warnings=(area.reason,))
    counter, ball = prepared
    counts = _count(counter, ball, lines, seed, model, sequence, progress)
    area = Estimate.unknown(NO_ERROR, float(counts.sum()) / (2.0 * lines) * ball.surface)
    hit = int((counts > 0.0).sum())
    leak = float((counts % 2.0 == 1.0).sum()) / hit if hit else math.nan
    return replace(
        known, area=area, areas=(area,), leak=leak, closed=leak < CLOSED_BELOW, cleaning=cleaning,
        warnings=(area.reason, *warnings),
    )  # fmt: skip


def _prepared(cloud: Surfels, options: Qmca, cleaning: dict[str, int]) -> tuple[tuple[Lpsi, Ball] | None, list[str]]:
    """Return the octree and the enclosing ball of the points, filtered or resampled; None where there is no surface."""
    warnings: list[str] = []
    normals, known = normals_for(cloud)
    cleaning["without_normal"] = len(cloud) - len(normals)
    points = cloud.points[known]
    radii = None if cloud.radii is None else cloud.radii[known]
    if len(points) < 2 or (points == points[0]).all():
        return None, warnings
    if options.denoise:
        points, normals = _denoised(points, normals, options.denoise, warnings)
    if options.density == "resampled":
        points, normals = _resampled(points, normals, warnings)
        radii = None
    counter = Lpsi.of(
        points, normals, radii, radius_factor=options.radius_factor, depth=options.depth,
        cylinder="uneven" if options.density == "uneven" else "even", reading=Reading(options.cells),
    )  # fmt: skip
    cleaning["duplicates"] = len(points) - len(counter.normals)
    if options.cells == "line" and counter.cell < _ROOMY * counter.radius:
        warnings.append(
            f"the cells of the octree, {counter.cell:.3g} wide, are small for a cylinder of radius "
            f"{counter.radius:.3g}: lines lose points beside the cells that they meet; take a smaller depth or "
            "cells='cylinder'"
        )
    return (counter, smallest_ball(points).grown(counter.radius)), warnings


def _denoised(points: Floats, normals: Floats, passes: int, warnings: list[str]) -> tuple[Floats, Floats]:
    from surfel.surface.bilateral import bilateral

    found = bilateral(points, normals, passes)
    warnings.append(
        f"the bilateral filter moved the points by {float(np.median(found.moved)):.3g} in the median and "
        f"{float(found.moved.max()):.3g} at most"
    )
    return found.points, found.normals


def _resampled(points: Floats, normals: Floats, warnings: list[str]) -> tuple[Floats, Floats]:
    from surfel.index.neighbours import PointIndex
    from surfel.surface.resample import resample

    spacing = float(np.sqrt(PointIndex(points).knn(1)[0][:, 0]).mean())
    more, sides = resample(points, normals, spacing)
    warnings.append(f"{len(more) - len(points):,} points were inserted where the {len(points):,} given ones are sparse")
    return more, sides


def _count(
    counter: Lpsi, ball: Ball, lines: int, seed: int, model: str, sequence: Any, progress: Progress | None
) -> Floats:
    """Return how often each line meets the points."""
    shift = shifts(seed, 1)[0] if seed else None

    def block(span: tuple[int, int]) -> Floats:
        return counter.counts(line_block(sequence, model, ball, span[0], span[1] - span[0], lines, shift))

    return np.concatenate(run_blocks(block, blocks(lines, _BLOCK), None, progress, "casting lines"))


def refuse_other(reference: str, tolerance: float | None) -> None:
    """Refuse what the published method does not know."""
    if reference not in ("auto", "ball"):
        raise InputError(f"method 'qmca' casts its lines through the enclosing ball; got reference={reference!r}")
    if tolerance is not None:
        raise InputError("method 'qmca' has no error bar that a tolerance could be reached by; say how many lines")
