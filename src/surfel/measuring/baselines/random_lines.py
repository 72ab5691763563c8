"""Cauchy-Crofton with one set of lines, as published: the Monte Carlo method, and its quasi-Monte Carlo rival."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_count
from surfel.core.errors import InputError
from surfel.lines.enclosing import Ball
from surfel.lines.models import line_block
from surfel.lines.sequences import Sequence
from surfel.measuring.baselines.baseline import Reading
from surfel.shapes.base import Shape

_BLOCK = 65_536
_ROOM = 1.0883  # of the ball round the corners of the bounds, as the paper took it: 18.849 for a cube of side 20


def random_lines(
    shape: Shape,
    effort: int,
    *,
    sequence: Sequence = "random",
    model: str = "tangent",
    ball: Ball | None = None,
    shift: ArrayLike | None = None,
    start: int = 0,
) -> Reading:
    """Count the crossings of lines through a ball (Li, Wang, Martin and Bowyer 2003, equation (4)).

    Parameters
    ----------
    shape : Shape
        Any shape.
    effort : int
        How many lines.
    sequence : str or scipy.stats.qmc.QMCEngine
        "random" for the Monte Carlo method, "niederreiter" for that of the paper.
    model : {"tangent", "chord", "offset"}
        How a point of the sequence becomes a line.
    ball : Ball, optional
        What the lines hit; by default a ball a little larger than that round the corners of the bounds.
    shift : array_like, shape (4,), optional
        Another random copy of the sequence.
    start : int
        Which line of the sequence is the first; further ones of "random" are independent of the first ones.

    Returns
    -------
    Reading
        Its elements are the lines.

    Examples
    --------
    >>> import surfel
    >>> from surfel.measuring.baselines import random_lines
    >>> area, lines, seconds = random_lines(surfel.Box(20), 10_000)
    >>> abs(area / 2400 - 1) < 0.05
    True
    """
    count = as_count(effort, "effort")
    body = ball or enclosing_ball(shape)
    started = time.perf_counter()
    area = (
        float(crossing_counts(shape, count, sequence, model, body, shift, start).sum()) * body.surface / (2.0 * count)
    )
    return Reading(area, count, time.perf_counter() - started)


def crossing_counts(
    shape: Shape,
    lines: int,
    sequence: Sequence,
    model: str,
    ball: Ball,
    shift: ArrayLike | None = None,
    start: int = 0,
) -> Floats:
    """Return how often each line crosses a shape, shape (lines,); their mean times half of the sphere is the area."""
    counts = np.empty(lines)
    for first in range(0, lines, _BLOCK):
        last = min(first + _BLOCK, lines)
        hits = shape._cross(line_block(sequence, model, ball, start + first, last - first, lines, shift))
        counts[first:last] = hits.weight_per_line()
    return counts


def enclosing_ball(shape: Shape) -> Ball:
    """Return the paper's reference ball: that round the corners of the bounds, 8.8 % larger.

    Raises
    ------
    InputError
        If the shape is unbounded.
    """
    low, high = np.asarray(shape.bounds)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InputError("the shape is unbounded; intersect it with a box")
    radius = _ROOM * 0.5 * math.sqrt(float(np.square(high - low).sum()))
    return Ball(0.5 * (low + high), radius or 1.0)
