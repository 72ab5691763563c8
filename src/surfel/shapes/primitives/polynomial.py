"""Polynomial: the solid where a polynomial in x, y and z is negative, or its surface as a sheet."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, as_number
from surfel.core.crossings import Crossings
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.shapes.base import Shape
from surfel.shapes.primitives.polynomial_form import Exponents, Form, form_of
from surfel.shapes.primitives.primitive import Primitive

if TYPE_CHECKING:
    from surfel.shapes.primitives.polynomial_lines import Chords

Terms = tuple[tuple[Exponents, float], ...]

_SAME = np.eye(4)[:3]


@dataclass(frozen=True, eq=False)
class Polynomial(Primitive):
    """A polynomial surface of any degree inside of a bounded shape.

    Parameters
    ----------
    terms : mapping of (i, j, k) to float
        ``sum c x^i y^j z^k``; the solid is where it is negative.
    within : Shape
        A closed bounded shape (a box, a sphere, a tree) outside of which nothing is taken.
    capped : bool
        True (the default) makes the solid, whose surface includes what it cuts out of the surface of ``within``; False
        makes a sheet, the part of the polynomial's zero set inside ``within``.

    Raises
    ------
    InputError
        If there are no terms, an exponent is no whole number or negative, a coefficient is not finite, the polynomial
        is constant, or ``within`` is no shape, unbounded or a sheet.

    Notes
    -----
    Inside is where the polynomial is negative, not where it is zero: it is solved as if an infinitely small positive
    number were added. So a line that touches the surface crosses it 0 or 2 times, never once, and a sheet that runs
    along the boundary of ``within`` belongs to it where ``within`` lies on the negative side.

    Beyond the first degrees most polynomials are only as good as their coefficients: place the shape near the origin
    and move it by :meth:`translated` instead of writing out (x - 1000)^6.

    Examples
    --------
    >>> import surfel
    >>> lemon = {(2, 0, 0): 1.0, (0, 0, 2): 1.0, (0, 3, 0): -1.0, (0, 4, 0): 3.0, (0, 5, 0): -3.0, (0, 6, 0): 1.0}
    >>> solid = surfel.Polynomial(lemon, within=surfel.Box((1.0, 2.5, 1.0)))  # x^2 + z^2 = y^3 (1 - y)^3
    >>> lines = surfel.Lines.of([[0.0, 0.5, 0.0]], [[1.0, 0.0, 0.0]], 1.0)
    >>> solid.cross(lines).t
    array([-0.125,  0.125])
    """

    terms: Terms
    within: Shape
    capped: bool = True

    def __init__(
        self,
        terms: Mapping[Exponents, float] | Iterable[tuple[Exponents, float]],
        within: Shape,
        capped: bool = True,
    ) -> None:
        if not isinstance(capped, bool | np.bool_):
            raise InputError(f"capped must be True or False; got {capped!r}")
        object.__setattr__(self, "terms", _as_terms(terms))
        object.__setattr__(self, "within", _as_region(within))
        object.__setattr__(self, "capped", bool(capped))

    @property
    def solid(self) -> bool:
        """Whether there is an inside; else the shape is a sheet."""
        return self.capped

    @property
    def degree(self) -> int:
        """The highest sum of exponents."""
        return max(sum(exponents) for exponents, _ in self.terms)

    @property
    def bounds(self) -> Floats:
        """The box round ``within``, shape (2, 3)."""
        return self.within.bounds

    def _bounds_under(self, matrix: Floats) -> Floats:
        return self.within.transformed(matrix).bounds

    @cached_property
    def _form(self) -> Form:
        return form_of(dict(self.terms), self.bounds)

    @cached_property
    def _placed_within(self) -> dict[bytes, Shape]:
        return {}

    def _within_under(self, inverse: Floats) -> Shape:
        """Return ``within`` as it lies in the world; the last few placements are kept."""
        if np.array_equal(inverse, _SAME):
            return self.within
        known, key = self._placed_within, inverse.tobytes()
        placed = known.get(key)
        if placed is None:
            square = np.eye(4)
            square[:3] = inverse
            placed = self.within.transformed(np.concatenate([np.linalg.inv(square)[:3], [[0.0, 0.0, 0.0, 1.0]]]))
            if len(known) >= 8:
                known.clear()
            known[key] = placed
        return placed

    def _cross_placed(self, lines: Lines, inverse: Floats) -> Crossings:
        from surfel.shapes.primitives.polynomial_lines import cross_chords

        around = self._within_under(inverse)
        line, chords = _chords_of(lines, around._sheets(around._cross(lines)))
        counts, t, cosine = cross_chords(self._form, chords, inverse, self.capped)
        each = np.bincount(line, counts, len(lines)).astype(np.int64)
        offsets = np.zeros(len(lines) + 1, np.int64)
        np.cumsum(each, out=offsets[1:])
        return Crossings(offsets, t, cosine, np.ones(len(t)), np.zeros(len(t), np.int32))

    def _cross(self, lines: Lines) -> Crossings:
        return self._cross_placed(lines, _SAME)

    def _hull(self) -> tuple[Floats, float]:
        return self.within._hull()

    def _contains(self, points: Floats) -> NDArray[np.bool_]:
        if not self.capped:
            raise InputError("a sheet has no inside; make the polynomial a solid (capped=True) or leave contains out")
        from surfel.shapes.primitives.polynomial_values import values_at

        return np.asarray(self.within._contains(points) & (values_at(self._form, points) < 0.0))

    def __getstate__(self) -> dict[str, Any]:
        return {"terms": self.terms, "within": self.within, "capped": self.capped}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def _chords_of(lines: Lines, crossings: Crossings) -> tuple[NDArray[np.int64], Chords]:
    """Return the parts of lines inside of a shape, and the line of each; an odd last hit of a leak is left out."""
    from surfel.shapes.primitives.polynomial_lines import Chords

    offsets, t, cosine = crossings.offsets, crossings.t, crossings.cosine
    counts = np.diff(offsets)
    odd = counts % 2 == 1
    if odd.any():
        kept = np.ones(len(t), bool)
        kept[offsets[1:][odd] - 1] = False
        t, cosine, counts = t[kept], cosine[kept], counts - odd
    line = np.repeat(np.arange(len(lines)), counts // 2)
    pairs = np.array(t.reshape(-1, 2), order="C"), np.array(cosine.reshape(-1, 2), order="C")
    return line, Chords(lines.origins[line], lines.directions[line], *pairs)


def _as_terms(value: Any) -> Terms:
    """Return the terms sorted by exponents, those that are zero left out."""
    try:
        items = list(value.items() if isinstance(value, Mapping) else value)
        pairs = [(tuple(exponents), c) for exponents, c in items]
    except (TypeError, ValueError) as error:
        raise InputError(
            f"terms must be a mapping such as {{(2, 0, 0): 1.0, (0, 0, 0): -1.0}}; got {value!r}"
        ) from error
    terms: dict[Exponents, float] = {}
    for exponents, c in pairs:
        key = _as_exponents(exponents)
        if key in terms:
            raise InputError(f"the term {key} occurs twice; add its coefficients up")
        terms[key] = as_number(c, f"the coefficient of term {key}")
    kept = tuple(sorted((key, c) for key, c in terms.items() if c != 0.0))
    if not kept:
        raise InputError("terms must not be empty or all zero; give at least one, such as {(2, 0, 0): 1.0}")
    if all(sum(key) == 0 for key, _ in kept):
        raise InputError("a constant polynomial has no surface; to have all of within, use that shape itself")
    return kept


def _as_exponents(value: tuple[Any, ...]) -> Exponents:
    try:
        exponents = tuple(operator.index(e) for e in value)
    except TypeError as error:
        raise InputError(
            f"exponents must be whole numbers (a polynomial has no other powers); got {value!r}"
        ) from error
    if len(exponents) != 3:
        raise InputError(f"each term needs three exponents, of x, y and z; got {value!r}")
    if min(exponents) < 0:
        raise InputError(f"exponents must not be negative; got {value!r}; multiply the equation by the denominator")
    return exponents[0], exponents[1], exponents[2]


def _as_region(within: Any) -> Shape:
    if not isinstance(within, Shape):
        raise InputError(f"within must be a shape, such as surfel.Box(2.0); got {type(within).__name__}")
    if within._is_sheet():
        raise InputError("within must be a solid; a sheet or an open mesh has no inside")
    box = within.bounds
    if not np.isfinite(box).all():
        raise InputError("within must be bounded; intersect it with a box first, such as within & surfel.Box(10.0)")
    if not (box[1] > box[0]).all():
        raise InputError(f"within must have an inside; its box is {box.tolist()}")
    return within
