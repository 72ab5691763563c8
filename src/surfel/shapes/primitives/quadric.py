"""Quadric: the solid of any polynomial of degree two."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import inverse as inverse_of
from surfel.core.cast import Floats, as_rows, read_only
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.shapes.primitives.ellipsoid import ellipsoid_area
from surfel.shapes.primitives.primitive import Primitive

_ZERO = 32.0 * np.finfo(float).eps
"""Eigenvalues below this share of the largest are taken for what rounding left of zero."""


class Canonical(NamedTuple):
    """A quadric in the frame of its axes, of the size of one.

    Parameters
    ----------
    form : Floats, shape (5,)
        a, b, c, d, e of ``a x^2 + b y^2 + c z^2 + d z + e <= 0``; c is zero where d is not.
    placement : Floats, shape (4, 4)
        From that frame to the quadric's own.
    """

    form: Floats
    placement: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Quadric(Primitive):
    """The points where ``[x y z 1] matrix [x y z 1]^T <= 0``.

    Ellipsoids, cylinders, cones, paraboloids, hyperboloids, slabs and half-spaces, also turned and moved. All but the
    ellipsoid are unbounded: they are measured within a tree that bounds them.

    Parameters
    ----------
    matrix : array_like, shape (4, 4)
        Symmetric and finite.

    Raises
    ------
    InputError
        If the matrix is not symmetric or not finite, or no point lies inside, or the polynomial is constant.

    Examples
    --------
    >>> import surfel
    >>> ball = surfel.Quadric([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, -4]])
    >>> round(ball.area, 6), ball.bounds.tolist()
    (50.265482, [[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]])
    """

    matrix: ArrayLike

    def __post_init__(self) -> None:
        matrix = np.array(as_rows(self.matrix, "matrix", 4, 4))
        if not np.isfinite(matrix).all():
            raise InputError("matrix must be finite")
        largest = float(np.abs(matrix).max())
        if np.abs(matrix - matrix.T).max() > 1e-12 * largest:
            raise InputError("matrix must be symmetric; the polynomial of M is that of (M + M.T) / 2")
        if not matrix[:3].any():
            raise InputError("matrix must hold more than a constant: it has no surface")
        object.__setattr__(self, "matrix", read_only(0.5 * matrix + 0.5 * matrix.T))
        if self._is_empty:
            raise InputError("the quadric is empty: the polynomial is nowhere negative; turn the sign of matrix")

    def __repr__(self) -> str:
        return f"Quadric({np.asarray(self.matrix).tolist()})"

    @cached_property
    def canonical(self) -> Canonical:
        """The quadric in the frame of its axes."""
        return _canonical(np.asarray(self.matrix))

    @property
    def _is_empty(self) -> bool:
        a, b, c, d, e = self.canonical.form
        return bool(min(a, b, c) >= 0.0 and d == 0.0 and e >= 0.0)

    @property
    def _is_everything(self) -> bool:
        a, b, c, d, e = self.canonical.form
        return bool(max(a, b, c) <= 0.0 and d == 0.0 and e <= 0.0)

    @property
    def _semiaxes(self) -> Floats | None:
        """The semi-axes of the ellipsoid that is the surface, if it is one."""
        form, placement = self.canonical
        if form[3] != 0.0 or not (min(form[:3]) > 0.0 or max(form[:3]) < 0.0) or form[0] * form[4] >= 0.0:
            return None
        size = float(np.linalg.norm(placement[:3, 0]))
        return np.asarray(size * np.sqrt(-form[4] / form[:3]))

    @cached_property
    def area(self) -> float:
        """The exact area; infinite for all but ellipsoids."""
        if self._is_everything:
            return 0.0
        radii = self._semiaxes
        return math.inf if radii is None else ellipsoid_area(radii)

    @property
    def volume(self) -> float:
        """The exact volume; infinite for all but ellipsoids."""
        radii = self._semiaxes
        if radii is None or self.canonical.form[0] < 0.0:
            return math.inf
        x, y, z = (float(radius) for radius in radii)
        return 4.0 / 3.0 * math.pi * x * y * z

    @cached_property
    def bounds(self) -> Floats:
        """The box round it, shape (2, 3): tight for ellipsoids and across axis-parallel cylinders, else infinite."""
        return read_only(self._bounds_under(np.eye(4)))

    def _bounds_under(self, matrix: Floats) -> Floats:
        form, placement = self.canonical
        frame = matrix @ placement
        box = np.array([[-np.inf] * 3, [np.inf] * 3])
        if form[3] != 0.0 or min(form[:3]) < 0.0:
            return box
        round_axes = form[:3] > 0.0
        linear = np.abs(frame[:3, :3])
        open_along = linear[:, ~round_axes].sum(axis=1) > _ZERO * linear.sum(axis=1)
        reach = np.sqrt(linear[:, round_axes] ** 2 @ (-form[4] / form[:3][round_axes]))
        reach[open_along] = np.inf
        return np.stack([frame[:3, 3] - reach, frame[:3, 3] + reach])

    def _cross_placed(self, lines: Lines, inverse: Floats) -> Crossings:
        from surfel.shapes.primitives.quadric_cross import cross_canonical

        form, placement = self.canonical
        to_canonical = inverse_of(placement)
        linear = to_canonical[:, :3]
        composed = np.column_stack([linear @ inverse[:, :3], linear @ inverse[:, 3] + to_canonical[:, 3]])
        return cross_canonical(lines, composed, form)


def _canonical(matrix: Floats) -> Canonical:
    """Turn and move a quadric to its axes: eigenvectors of the square part, then the square is completed."""
    square, linear, constant = matrix[:3, :3], matrix[:3, 3], float(matrix[3, 3])
    if np.array_equal(square, np.diag(np.diag(square))):
        values, vectors = np.diag(square).copy(), np.eye(3)
    else:
        values, vectors = np.linalg.eigh(square)
        values[np.abs(values) < _ZERO * np.abs(values).max()] = 0.0
    order = np.argsort(values == 0.0, kind="stable")
    values, vectors = values[order], vectors[:, order]
    slopes = vectors.T @ linear
    curved = values != 0.0
    centre = np.zeros(3)
    centre[curved] = -slopes[curved] / values[curved]
    rest = slopes * ~curved
    terms = np.abs(slopes[curved] ** 2 / values[curved]).sum() + abs(constant)
    level = constant - float((slopes[curved] ** 2 / values[curved]).sum())
    if abs(level) <= _ZERO * terms:
        level = 0.0  # a cone's apex, as rounding left it
    slope = float(np.linalg.norm(rest))
    if slope <= _ZERO * float(np.linalg.norm(slopes)):
        slope = 0.0
    if slope > 0.0:
        vectors = _turned(vectors, curved, rest / slope)
        values = np.append(values[curved], np.zeros(3 - int(curved.sum())))
        centre = np.append(centre[curved], np.zeros(3 - int(curved.sum())))
        centre[2] = -0.5 * level / slope
        level = 0.0
    return _of_size_one(values, 2.0 * slope, level, vectors, centre)


def _turned(vectors: Floats, curved: NDArray[np.bool_], flat: Floats) -> Floats:
    """Return the frame with its last axis along the slope, and the others, those with curvature first."""
    last = vectors @ flat
    kept = list(vectors[:, curved].T)
    for candidate in [*vectors[:, ~curved].T]:
        if len(kept) == 2:
            break
        across = candidate - (candidate @ last) * last
        for other in kept:
            across = across - (across @ other) * other
        if np.linalg.norm(across) > 0.5:
            kept.append(across / np.linalg.norm(across))
    return np.column_stack([*kept, last])


def _of_size_one(values: Floats, slope: float, level: float, vectors: Floats, centre: Floats) -> Canonical:
    """Choose the unit of length so that the terms are of like size, and scale the polynomial."""
    strongest = float(np.abs(values).max())
    if strongest > 0.0 and level != 0.0:
        size = math.sqrt(abs(level) / strongest)
    elif strongest > 0.0 and slope != 0.0:
        size = abs(slope) / strongest
    else:
        size = 1.0
    form = np.array([*(values * size * size), slope * size, level])
    placement = np.eye(4)
    placement[:3, :3] = size * vectors
    placement[:3, 3] = vectors @ centre
    return Canonical(read_only(form / np.abs(form).max()), read_only(placement))
