"""The moving least squares surface as published: places are projected by planes and a polynomial over the last one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surfel._numba import inner, rows, threads_for
from surfel._vec import dot, norm, tangent_frame
from surfel.core.cast import Booleans, Floats, as_count, as_number, as_positive
from surfel.core.errors import InputError
from surfel.index.hilbert import hilbert_order
from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.neighbourhood import neighbours_of
from surfel.inside.operand import Operand
from surfel.surface.planes import smallest_eigenpair, solve_spd

WIDTH = 0.35
"""Square of the kernel's width h over the squared distance to the k-th neighbour, where no h is given."""

CLOSE = 1e-3
"""The iteration has converged where a step, as taken, is shorter than this many distances to the k-th neighbour."""

_LEAP = 2.0  # a step is at most so many distances to the k-th neighbour long: a plane is good for no more
_LEAST = 1.0 / 64.0  # the smallest bias that damping leads to
_MONOMIALS = (1, 3, 6, 10, 15)


class Projection(NamedTuple):
    """Places projected onto the surface.

    Parameters
    ----------
    points : Floats, shape (m, 3)
        On the surface.
    normals : Floats, shape (m, 3)
        Unit normals of the surface there, oriented as the surfels nearby; zero where those cancel out.
    converged : Booleans, shape (m,)
        Whether the last step was shorter than a thousandth of the neighbourhood.
    """

    points: Floats
    normals: Floats
    converged: Booleans


class Settings(NamedTuple):
    """Of the surface and of the iteration; ``h`` is 0 where it follows the density."""

    degree: int
    h: float
    k: int
    bias: float
    steps: int


def project(
    points: ArrayLike,
    cloud: Operand | HasOperand,
    *,
    degree: int = 2,
    h: float | None = None,
    k: int = 20,
    bias: float = 1.0,
    steps: int = 30,
) -> Projection:
    """Project places onto the moving least squares surface of a cloud.

    From the nearest surfel q_0 on, the plane H_i that fits the k surfels nearest to q_i best, with weights
    ``exp(-d^2 / h^2)``, gives the next q as the foot of the place on H_i; of that step the share ``bias`` is taken.
    Where steps turn back, the share is halved, for that place alone. Over the last plane a polynomial g is fitted to
    the heights of the surfels, with the same weights, and the result is ``q + g(0, 0) n``.

    Parameters
    ----------
    points : array_like, shape (m, 3)
        Places, in the coordinates of the cloud.
    cloud : Operand or Surfels
        The cloud; at least one surfel.
    degree : int
        Of the polynomial, 0 to 4; 0 takes the foot on the plane. With fewer surfels than three for two coefficients
        it is lowered.
    h : float, optional
        Width of the Gaussian, in the units of the cloud; by default 0.59 times the distance from q to the k-th
        surfel, so that it follows an uneven density.
    k : int
        How many surfels are looked at, at least 3; all of them where there are fewer.
    bias : float
        The factor lambda: above 0 and at most 1.
    steps : int
        Most steps of the iteration. Places farther away than the radius of curvature need many.

    Returns
    -------
    Projection
        ``points, normals, converged``.

    Raises
    ------
    InputError
        If the cloud is empty, the points are not finite rows of three, or a parameter is out of its range.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*, sec. 2, items 1 to 3, after Alexa and after Pauly.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.mls import project
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((4000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> found = project([[0.0, 0.0, 1.1], [0.5, 0.5, 0.5]], Operand.of(p, p))
    >>> np.linalg.norm(found.points, axis=1).round(2).tolist()
    [1.0, 1.0]
    """
    operand = as_operand(cloud)
    settings = settings_for(operand, degree, h, k, bias, steps)
    given = operand.local(points)
    sorting = hilbert_order(given)
    places = given[sorting]
    found = project_local(operand, places, operand.points[neighbours_of(operand, places, 1)[1][:, 0]], settings)
    back = Projection(np.empty((len(given), 3)), np.empty((len(given), 3)), np.empty(len(given), bool))
    for target, part in zip(back, found, strict=True):
        target[sorting] = part
    back.points[:] += operand.origin
    return back


def project_local(operand: Operand, places: Floats, start: Floats, settings: Settings) -> Projection:
    """Project places that are minus the operand's origin and sorted along a curve, from the nearest surfels on."""
    degree, h, k, bias, steps = settings
    m = len(places)
    foot, normal = start.copy(), np.zeros((m, 3))
    step, share, moved = np.zeros((m, 3)), np.full(m, bias), np.full(m, np.inf)
    active = np.arange(m)
    for _ in range(steps):
        squares, near = neighbours_of(operand, foot[active], k)
        with threads_for(16 * len(active)):
            _step(
                len(active), operand.points, operand.normals, places, active, squares, near, h,
                foot, normal, step, share, moved,
            )  # fmt: skip
        active = active[moved[active] > CLOSE]
        if not len(active):
            break
    if degree > 0:
        squares, near = neighbours_of(operand, foot, k)
        with threads_for(32 * m):
            _lift(m, operand.points, squares, near, h, _MONOMIALS[degree], degree, foot, normal)
    return Projection(foot, normal, moved <= CLOSE)


def settings_for(operand: Operand, degree: int, h: float | None, k: int, bias: float, steps: int) -> Settings:
    """Return valid settings, with the degree and the k that the surfels allow.

    Raises
    ------
    InputError
        If the cloud is empty or a parameter is out of its range.
    """
    if not len(operand):
        raise InputError("a cloud without surfels has no surface to project onto")
    order = as_count(degree, "degree", 0, len(_MONOMIALS) - 1)
    wanted = min(as_count(k, "k", 3), len(operand))
    while order > 0 and 2 * wanted < 3 * _MONOMIALS[order]:
        order -= 1
    if not 0.0 < as_number(bias, "bias") <= 1.0:
        raise InputError(f"bias must be above 0 and at most 1; got {bias}")
    return Settings(order, 0.0 if h is None else as_positive(h, "h"), wanted, float(bias), as_count(steps, "steps", 1))


@rows
def _step(first, last, points, normals, places, active, squares, near, h, foot, normal, step, share, moved):
    k = near.shape[1]
    for row in range(first, last):
        i = active[row]
        reach = math.sqrt(squares[row, k - 1])
        px, py, pz, qx, qy, qz = places[i, 0], places[i, 1], places[i, 2], foot[i, 0], foot[i, 1], foot[i, 2]
        nx, ny, nz, mx, my, mz, side = plane_at(points, normals, squares[row], near[row], h, qx, qy, qz)
        over = dot(nx, ny, nz, px - mx, py - my, pz - mz)
        x, y, z = px - over * nx - qx, py - over * ny - qy, pz - over * nz - qz
        length = norm(x, y, z)
        back = x * step[i, 0] + y * step[i, 1] + z * step[i, 2] < 0.0
        if back and length > 0.25 * norm(step[i, 0], step[i, 1], step[i, 2]):
            share[i] = max(0.5 * share[i], _LEAST)
        part = share[i] * min(1.0, _LEAP * reach / length) if length > 0.0 else share[i]
        step[i, 0], step[i, 1], step[i, 2] = x, y, z
        foot[i, 0] += part * x
        foot[i, 1] += part * y
        foot[i, 2] += part * z
        sign = 1.0 if side > 0.0 else -1.0 if side < 0.0 else 0.0
        normal[i, 0], normal[i, 1], normal[i, 2] = sign * nx, sign * ny, sign * nz
        moved[i] = part * length / reach if reach > 0.0 else 0.0


@inner
def weight_of(squares, a, h):
    """Return the Gaussian weight of a neighbour; far from the surface all weights are raised by one factor."""
    wide = h * h if h > 0.0 else WIDTH * squares[len(squares) - 1]
    return math.exp((squares[0] - squares[a]) / wide) if wide > 0.0 else 1.0


@inner
def plane_at(points, normals, squares, near, h, x, y, z):
    """Return the plane that fits the neighbours of a place best: its normal, a place of it, and which side is out."""
    total = mx = my = mz = ax = ay = az = 0.0
    xx = xy = xz = yy = yz = zz = 0.0
    for a in range(len(near)):
        j = near[a]
        weight = weight_of(squares, a, h)
        dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
        total += weight
        mx += weight * dx
        my += weight * dy
        mz += weight * dz
        ax += weight * normals[j, 0]
        ay += weight * normals[j, 1]
        az += weight * normals[j, 2]
        xx += weight * dx * dx
        xy += weight * dx * dy
        xz += weight * dx * dz
        yy += weight * dy * dy
        yz += weight * dy * dz
        zz += weight * dz * dz
    mean = 1.0 / total
    mx, my, mz = mx * mean, my * mean, mz * mean
    _, nx, ny, nz = smallest_eigenpair(
        xx * mean - mx * mx, xy * mean - mx * my, xz * mean - mx * mz,
        yy * mean - my * my, yz * mean - my * mz, zz * mean - mz * mz,
    )  # fmt: skip
    return nx, ny, nz, x + mx, y + my, z + mz, dot(nx, ny, nz, ax, ay, az)


@rows
def _lift(first, last, points, squares, near, h, size, degree, foot, normal):
    """Add the polynomial's height to each foot, and tilt the normal by its slope."""
    f, matrix, right = np.empty(size), np.empty((size, size)), np.empty(size)
    k = near.shape[1]
    for i in range(first, last):
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        if squares[i, k - 1] <= 0.0 or (nx == 0.0 and ny == 0.0 and nz == 0.0):
            continue
        ex, ey, ez, fx, fy, fz = tangent_frame(nx, ny, nz)
        inverse = 1.0 / math.sqrt(squares[i, k - 1])
        matrix[:, :] = 0.0
        right[:] = 0.0
        total = 0.0
        for a in range(k):
            j = near[i, a]
            dx, dy, dz = points[j, 0] - foot[i, 0], points[j, 1] - foot[i, 1], points[j, 2] - foot[i, 2]
            u, v = dot(dx, dy, dz, ex, ey, ez) * inverse, dot(dx, dy, dz, fx, fy, fz) * inverse
            weight = weight_of(squares[i], a, h)
            _monomials(u, v, degree, f)
            total += weight
            for p in range(size):
                right[p] += weight * f[p] * dot(dx, dy, dz, nx, ny, nz)
                for q in range(p + 1):
                    matrix[p, q] += weight * f[p] * f[q]
        for p in range(size):
            matrix[p, p] += 1e-9 * total
        solve_spd(matrix, right)
        foot[i, 0] += right[0] * nx
        foot[i, 1] += right[0] * ny
        foot[i, 2] += right[0] * nz
        su, sv = right[1] * inverse, right[2] * inverse
        tx, ty, tz = nx - su * ex - sv * fx, ny - su * ey - sv * fy, nz - su * ez - sv * fz
        length = 1.0 / norm(tx, ty, tz)
        normal[i, 0], normal[i, 1], normal[i, 2] = tx * length, ty * length, tz * length


@inner
def _monomials(u, v, degree, f):
    """Write 1, u, v, u^2, u v, v^2, u^3, ..."""
    place = 0
    for total in range(degree + 1):
        for power in range(total + 1):
            f[place] = u ** (total - power) * v**power
            place += 1
