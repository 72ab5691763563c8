"""A polynomial in three variables as the kernels take it: centred, scaled, grouped, with its derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, Integers
from surfel.roots.bernstein_basis import lobatto_nodes, values_to_bernstein

Exponents = tuple[int, int, int]

WHOLE = 20
"""Up to this degree a line's polynomial is found whole; beyond it, in pieces of degree :data:`PIECE`."""

PIECE = 16


class Form(NamedTuple):
    """A polynomial q in xi = (x - centre) / scale, at most 1 in size, and dq/dxi; terms grouped by powers of x and y.

    Parameters
    ----------
    frame : Floats, shape (4,)
        Centre and scale.
    coefficients, z : Floats and Integers, shape (n,)
        Of each term, of q and then of its three derivatives.
    starts : Integers, shape (g + 1,)
        The first term of each group.
    x, y : Integers, shape (g,)
        The exponents that the terms of a group share.
    parts : Integers, shape (5,)
        The first group of q, of dq/dx, dq/dy and dq/dz, and the end.
    degrees : Integers, shape (4,)
        The highest exponents of x, y and z, and the total degree.
    nodes, to_bernstein, tails : Floats, shape (m + 1,), (m + 1, m + 1) and (3, m + 1)
        Where a line's polynomial is evaluated, the matrix from there to the Bernstein form, and the one to the last
        three Chebyshev coefficients.
    """

    frame: Floats
    coefficients: Floats
    z: Integers
    starts: Integers
    x: Integers
    y: Integers
    parts: Integers
    degrees: Integers
    nodes: Floats
    to_bernstein: Floats
    tails: Floats


def form_of(terms: Mapping[Exponents, float], box: Floats) -> Form:
    """Return the form of a polynomial for the points of a box, shape (2, 3).

    The terms are moved to the middle of the box, exactly, where that makes them cancel less.
    """
    mantissa, exponent = math.frexp(0.5 * float((box[1] - box[0]).max()))
    scale = math.ldexp(1.0, exponent - (mantissa == 0.5))
    middle = [Fraction(round(64.0 * x / scale), 64) for x in (0.5 * box[0] + 0.5 * box[1]).tolist()]
    reach = [Fraction(x) for x in (np.abs(box).max(axis=0) / scale).tolist()]
    exact = {e: Fraction(c) * Fraction(scale) ** sum(e) for e, c in terms.items()}
    if any(middle):
        moved = _shifted(exact, middle)
        if 8 * _magnitude(moved, [Fraction(1)] * 3) < _magnitude(exact, reach):
            exact = moved
        else:
            middle = [Fraction(0)] * 3
    largest = max(map(abs, exact.values()))
    scaled = {e: float(c / largest) for e, c in exact.items()}
    frame = np.array([*(float(x) * scale for x in middle), scale])
    return _grouped({e: c for e, c in scaled.items() if c}, frame)


def _shifted(terms: dict[Exponents, Fraction], by: list[Fraction]) -> dict[Exponents, Fraction]:
    """Return the terms of p(x + by)."""
    for axis, step in enumerate(by):
        if not step:
            continue
        moved: dict[Exponents, Fraction] = {}
        for exponents, c in terms.items():
            degree = exponents[axis]
            for k in range(degree + 1):
                lower = _with(exponents, axis, k)
                moved[lower] = moved.get(lower, Fraction(0)) + c * math.comb(degree, k) * step ** (degree - k)
        terms = moved
    return terms


def _magnitude(terms: dict[Exponents, Fraction], reach: list[Fraction]) -> Fraction:
    """Bound the terms' sizes at the points of a box: what rounding is relative to."""
    return sum(
        (abs(c) * math.prod(r**e for r, e in zip(reach, es, strict=True)) for es, c in terms.items()), Fraction()
    )


def _grouped(terms: dict[Exponents, float], frame: Floats) -> Form:
    coefficients: list[float] = []
    z: list[int] = []
    groups: list[tuple[int, int, int]] = []  # the exponents of x and y, and the first term
    parts = []
    for part in (terms, *(_derivative(terms, axis) for axis in range(3))):
        parts.append(len(groups))
        last = None
        for (i, j, k), c in sorted(part.items()):
            if (i, j) != last:
                groups.append((i, j, len(z)))
                last = (i, j)
            coefficients.append(c)
            z.append(k)
    total = max(map(sum, terms))
    order = total if total <= WHOLE else PIECE
    return Form(
        frame=frame,
        coefficients=np.array(coefficients),
        z=np.array(z, np.int64),
        starts=np.array([*(start for _, _, start in groups), len(z)], np.int64),
        x=np.array([i for i, _, _ in groups], np.int64),
        y=np.array([j for _, j, _ in groups], np.int64),
        parts=np.array([*parts, len(groups)], np.int64),
        degrees=np.array([*(max(e[axis] for e in terms) for axis in range(3)), total], np.int64),
        nodes=lobatto_nodes(order).copy(),
        to_bernstein=values_to_bernstein(order).copy(),
        tails=_last_coefficients(order),
    )


def _derivative(terms: dict[Exponents, float], axis: int) -> dict[Exponents, float]:
    return {_with(e, axis, e[axis] - 1): c * e[axis] for e, c in terms.items() if e[axis]}


def _with(exponents: Exponents, axis: int, other: int) -> Exponents:
    i, j, k = exponents
    return (other, j, k) if axis == 0 else (i, other, k) if axis == 1 else (i, j, other)


def _last_coefficients(order: int) -> NDArray[np.float64]:
    """Return the matrix from values at the nodes to the Chebyshev coefficients of the three highest degrees."""
    k = np.arange(order + 1)
    ends = np.where((k == 0) | (k == order), 0.5, 1.0)
    degrees = np.maximum(order - np.arange(3), 0)[:, None]
    return np.asarray(np.where(degrees == order, 1.0, 2.0) / order * ends * np.cos(np.pi / order * degrees * k))
