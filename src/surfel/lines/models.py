"""From points of the four-dimensional unit cube to lines of the invariant measure through a ball, a box or a cylinder.

Lines in space have one measure, up to a factor, that no rigid motion changes (Li, Wang, Martin and Bowyer, *Using
low-discrepancy sequences and the Crofton formula to compute surface areas of geometric models*, Computer-Aided Design
35, 2003, equation (1))::

    dL = cos(psi) ds dsigma

With it, ``int m dL = pi s`` for a surface of area s that a line crosses m times (equation (3)). A convex body of
surface S is crossed twice by each line that hits it: these lines have the measure pi S / 2, which is 2 pi^2 R^2 for a
ball. N lines that sample it evenly stand for pi S / (2 N) each, and ``area = sum(weights * crossings) / pi``.

Every line's origin is its point nearest to the centre of the body, whatever the model.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import threads_for
from surfel.core.cast import Floats, as_choice, as_count, as_number, as_positive, as_rows, as_vector
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.lines.cylinder import EnclosingCylinder, fill_cylinder
from surfel.lines.enclosing import Ball, OrientedBox
from surfel.lines.maps import fill_box, fill_chords, fill_offsets, fill_tangents
from surfel.lines.sequences import Sequence, shifted_points

MODELS = ("chord", "tangent", "offset")


def lines_through_ball(points01: ArrayLike, centre: ArrayLike, radius: float, model: str = "tangent") -> Lines:
    """Return lines through a ball, one for each point of the unit cube; even points give the invariant measure.

    Parameters
    ----------
    points01 : array_like, shape (m, 4)
        Points of the unit cube.
    centre : array_like, shape (3,)
        Centre of the ball.
    radius : float
        Its radius R, positive.
    model : {"tangent", "chord", "offset"}
        All three give the same measure of lines, and differ in how evenly a sequence fills it.

        - "chord": through two independent uniform points of the sphere (Li et al., section 3.1). A uniform point has a
          uniform height cos(beta) and longitude (Liu et al., *Quasi-Monte Carlo area of point-sampled surfaces*, 2006,
          equation (5)); a uniform angle beta would be wrong.
        - "tangent": a tangent of a concentric sphere (Li et al., section 3.2) with r = R sqrt(x_0),
          cos(theta) = 1 - 2 x_1, phi = 2 pi x_2, psi = pi x_3. In the paper's derivation abs(dr/dl) should read
          l / (4 r) and c should read 1 / (2 pi^2); the slips cancel.
        - "offset": a uniform direction, and a uniform point of the disk that the ball shows along it.

    Returns
    -------
    Lines
        m lines, with weights 2 pi^2 R^2 / m.

    Raises
    ------
    InputError
        If the points are not (m, 4) in [0, 1], the centre is not finite, the radius not positive or the model unknown.

    Examples
    --------
    >>> from surfel.lines.models import lines_through_ball
    >>> from surfel.lines.sequences import unit_points
    >>> lines = lines_through_ball(unit_points("niederreiter", 0, 1024), centre=(0, 0, 0), radius=2.0)
    >>> print(f"{2 * lines.weights.sum() / 3.141592653589793:.4f}")  # the sphere is crossed twice: its area
    50.2655
    """
    points = _as_unit_points(points01)
    ball = Ball(as_vector(centre, "centre"), as_positive(radius, "radius"))
    as_choice(model, "model", MODELS)
    return _ball_lines(points, ball, model, len(points))


def lines_through_box(points01: ArrayLike, box: OrientedBox) -> Lines:
    """Return lines through a box, one for each point of the unit cube; every one of them hits it.

    An oriented line enters a convex body once. With a uniform point of entry and a direction around the inward normal
    with density cos(psi) / pi the lines have the density of equation (1); so a direction comes with the probability
    of the area that the box shows along it, and no weight has to make up for it.

    Parameters
    ----------
    points01 : array_like, shape (m, 4)
        Points of the unit cube: x_0 chooses the face and one coordinate in it, x_1 the other, x_2 and x_3 a direction.
    box : OrientedBox
        Its surface must be positive; one of its sides may be 0.

    Returns
    -------
    Lines
        m lines, with weights pi S / (2 m), S the surface of the box.

    Raises
    ------
    InputError
        If the points are not (m, 4) in [0, 1] or the box has no surface.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.lines.enclosing import OrientedBox
    >>> from surfel.lines.models import lines_through_box
    >>> from surfel.lines.sequences import unit_points
    >>> box = OrientedBox(np.zeros(3), np.eye(3), np.array([1.0, 1.0, 1.0]))
    >>> lines = lines_through_box(unit_points("niederreiter", 0, 1024), box)
    >>> print(f"{2 * lines.weights.sum() / np.pi:.4f}")
    24.0000
    """
    points = _as_unit_points(points01)
    return _box_lines(points, box, len(points))


def lines_through_cylinder(points01: ArrayLike, cylinder: EnclosingCylinder) -> Lines:
    """Return lines through a cylinder, one for each point of the unit cube; every one of them hits it.

    As in :func:`lines_through_box`: a uniform point of entry, and a direction around the inward normal with density
    cos(psi) / pi.

    Parameters
    ----------
    points01 : array_like, shape (m, 4)
        Points of the unit cube: x_0 chooses the end or the height, x_1 the angle, x_2 and x_3 a direction.
    cylinder : EnclosingCylinder
        Its surface must be positive; its height may be 0.

    Returns
    -------
    Lines
        m lines, with weights pi S / (2 m), S the surface of the cylinder.

    Raises
    ------
    InputError
        If the points are not (m, 4) in [0, 1] or the cylinder has no surface.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.lines.cylinder import EnclosingCylinder
    >>> from surfel.lines.models import lines_through_cylinder
    >>> from surfel.lines.sequences import unit_points
    >>> body = EnclosingCylinder(np.zeros(3), np.eye(3), 1.0, 1.0)
    >>> lines = lines_through_cylinder(unit_points("niederreiter", 0, 1024), body)
    >>> print(f"{2 * lines.weights.sum() / np.pi**2:.4f}")
    6.0000
    """
    points = _as_unit_points(points01)
    return _cylinder_lines(points, cylinder, len(points))


def line_block(
    sequence: Sequence,
    model: str,
    body: Ball | OrientedBox | EnclosingCylinder,
    start: int,
    count: int,
    total: int,
    shift: ArrayLike | None = None,
) -> Lines:
    """Return lines ``start`` to ``start + count - 1`` of the ``total`` lines that measure with one shift.

    A measurement loops over (shift, block), sums weights times crossings over the blocks of a shift, and takes the
    mean of the shifts with :func:`surfel.lines.sequences.from_shifts`.

    Parameters
    ----------
    sequence : str or scipy.stats.qmc.QMCEngine
    See :func:`surfel.lines.sequences.unit_points`.
    model : {"tangent", "chord", "offset"}
    How a point becomes a line through a ball; a box and a cylinder have ways of their own.
    body : Ball, OrientedBox or EnclosingCylinder
    What the lines hit; all that is measured must lie inside.
    start, count : int
    Which lines.
    total : int
    How many lines the weights are for.
    shift : array_like, shape (4,), optional
    One row of :func:`surfel.lines.sequences.shifts`.

    Returns
    -------
    Lines
    ``count`` lines, with weights pi S / (2 total), S the surface of the body.

    Raises
    ------
    InputError
    If a number is out of its range, or the sequence, the model or the body cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.lines.enclosing import Ball
    >>> from surfel.lines.models import line_block
    >>> len(line_block("r4", "tangent", Ball(np.zeros(3), 1.0), start=4096, count=1024, total=65536))
    1024
    """
    as_choice(model, "model", MODELS)
    number = as_count(total, "total")
    points = shifted_points(sequence, start, count, 4, shift)
    if isinstance(body, OrientedBox):
        return _box_lines(points, body, number)
    if isinstance(body, EnclosingCylinder):
        return _cylinder_lines(points, body, number)
    if not isinstance(body, Ball):
        raise InputError(f"body must be a Ball, an OrientedBox or an EnclosingCylinder; got {type(body).__name__}")
    as_positive(body.radius, "the radius of the ball")
    return _ball_lines(points, body, model, number)


def _as_unit_points(value: ArrayLike) -> Floats:
    array = np.asarray(value)
    points = as_rows(array, "points01", len(array) if array.ndim else 0, 4)
    if len(points) and not (points.min() >= 0.0 and points.max() <= 1.0):  # NaN fails too
        raise InputError("points01 must lie between 0 and 1")
    return points


def _ball_lines(points: Floats, ball: Ball, model: str, total: int) -> Lines:
    lines = _empty(len(points), ball.surface, total)
    centre = np.ascontiguousarray(ball.centre, dtype=np.float64)
    fill = {"chord": fill_chords, "tangent": fill_tangents, "offset": fill_offsets}[model]
    with threads_for(len(points)):
        fill(len(points), points, centre, float(ball.radius), lines.origins, lines.directions)
    return lines


def _box_lines(points: Floats, box: OrientedBox, total: int) -> Lines:
    surface = as_number(box.surface, "the surface of the box")
    if surface <= 0.0:
        raise InputError(f"the box has no surface (half sides {box.half.tolist()}): no line can be drawn through it")
    lines = _empty(len(points), surface, total)
    with threads_for(len(points)):
        fill_box(len(points), points, box.centre, box.axes, box.half, lines.origins, lines.directions)
    return lines


def _cylinder_lines(points: Floats, body: EnclosingCylinder, total: int) -> Lines:
    surface = as_number(body.surface, "the surface of the cylinder")
    if surface <= 0.0:
        raise InputError(f"the cylinder has no surface (radius {body.radius:g}): no line can be drawn through it")
    lines = _empty(len(points), surface, total)
    centre = np.ascontiguousarray(body.centre, dtype=np.float64)
    with threads_for(len(points)):
        fill_cylinder(
            len(points), points, centre, np.ascontiguousarray(body.axes), float(body.radius), float(body.half_height),
            lines.origins, lines.directions,
        )  # fmt: skip
    return lines


def _empty(count: int, surface: float, total: int) -> Lines:
    weight = 0.5 * math.pi * surface / max(total, 1)
    return Lines(np.empty((count, 3)), np.empty((count, 3)), np.full(count, weight))
