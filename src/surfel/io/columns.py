"""Named and nameless columns as points, normals, colors, radii and attributes: one rule for every format."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.io.content import Content
from surfel.io.source import Source

Group = tuple[str, ...]
POINTS: list[Group] = [("x", "y", "z")]
NORMALS: list[Group] = [("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz")]
COLORS: list[Group] = [("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b")]
_ALPHA = dict(zip(COLORS, ("alpha", "diffuse_alpha", "a"), strict=True))  # each with the colors of its own naming
RADIUS = "radius"


def first_of(groups: list[Group], names: Iterable[str]) -> Group | None:
    """Return the first group whose names are all there."""
    known = set(names)
    return next((group for group in groups if known.issuperset(group)), None)


def content_by_name(
    columns: dict[str, NDArray[Any]], points: Floats, normals: Floats | None, notes: list[str]
) -> Content:
    """Sort named columns beside the points into colors, radii and attributes.

    Parameters
    ----------
    columns : dict of str to ndarray, shape (n,)
        All columns but those of the points and the normals.
    points, normals : ndarray of float64, shape (n, 3)
        What was recognised before.
    notes : list of str
        Goes into the content.
    """
    rest = dict(columns)
    content = Content(points, normals=normals, notes=notes)
    shades = _shades(rest)
    if shades:
        content.colors = np.stack([rest.pop(name) for name in shades], axis=1)
    if RADIUS in rest and rest[RADIUS].dtype.kind in "fiu":
        content.radii = rest.pop(RADIUS).astype(np.float64)
    content.attributes = rest
    return content


@dataclass
class Spread:
    """The lowest and the highest value of each column, and whether all are whole numbers; NaN where one is not finite.

    Roles of nameless columns and types of colors go by these, so that a file read in runs has them all alike.
    """

    low: Floats
    high: Floats
    whole: NDArray[np.bool_]

    @classmethod
    def of(cls, values: Floats) -> Spread:
        """Return those of a table of (n, k) numbers."""
        if len(values) == 0:
            nothing = np.full(values.shape[1], np.nan)
            return cls(nothing, nothing, np.ones(values.shape[1], bool))
        finite = np.where(np.isfinite(values).all(axis=0), 0.0, np.nan)
        whole = (values == np.floor(values)).all(axis=0)
        low, high = corners(values)
        return cls(low + finite, high + finite, whole)

    def joined(self, other: Spread) -> Spread:
        """Return those of both tables together."""
        return Spread(np.minimum(self.low, other.low), np.maximum(self.high, other.high), self.whole & other.whole)

    def some(self, columns: list[int]) -> tuple[float, float, bool]:
        """Return the lowest and the highest value of some columns and whether all of these are whole."""
        return float(self.low[columns].min()), float(self.high[columns].max()), bool(self.whole[columns].all())


def depends_on_values(names: list[str] | None, columns: int) -> bool:
    """Tell whether the role or the type of a column of a table depends on its values."""
    return columns - 3 in (3, 4, 6) if names is None else bool(_shades(names))


def content_of_table(values: Floats, names: list[str] | None, spread: Spread | None = None) -> Content:
    """Return the content of a table of numbers, by its column names or by the rule for nameless columns.

    The rule: the first three columns are x, y and z. One further column is an intensity. Three further columns are
    colors if they are whole numbers from 0 to 255 and not all below 2, else normals; six further columns are two such
    triples; four are an intensity and a triple. Any other number of columns becomes attributes ``column_4`` and so on.

    Parameters
    ----------
    values : ndarray of float64, shape (n, k)
        At least three columns.
    names : list of str, optional
        One for each column, in lower case, x, y and z among them.
    spread : Spread, optional
        Of all rows of the file where ``values`` are only a run of them.
    """
    if spread is None and depends_on_values(names, values.shape[1]):
        spread = Spread.of(values)
    if names is None:
        names = _names_by_rule(values.shape[1], spread)
    column = {name: i for i, name in enumerate(names)}
    places = [column.pop(name) for name in POINTS[0]]
    group = first_of(NORMALS, column)
    directions = [column.pop(name) for name in group] if group is not None else []
    rest = {name: np.ascontiguousarray(values[:, i]) for name, i in column.items()}
    shades = _shades(column)
    if shades and spread is not None:
        kind = _color_type(*spread.some([column[name] for name in shades]))
        rest.update({name: rest[name].astype(kind) for name in shades})
    normals = _together(values, directions) if directions else None
    points = values if places == [0, 1, 2] and values.shape[1] == 3 else _together(values, places)
    return content_by_name(rest, np.ascontiguousarray(points), normals, [])


def as_type(
    source: Source, what: str, name: str, values: Floats, kind: np.dtype[np.generic], columns: int = 1
) -> NDArray[Any]:
    """Return numbers that were read as doubles in the type that the header of their file declares.

    Raises
    ------
    FileFormatError
        If one is not of that type.
    """
    kind = kind.newbyteorder("=")
    if kind.kind == "f":
        with np.errstate(over="ignore"):
            return values.astype(kind)
    limits = np.iinfo(kind)  # type: ignore[type-var]
    wrong = ~((values >= limits.min) & (values <= limits.max) & (values == np.floor(values)))
    if kind.itemsize == 8:
        wrong |= np.abs(values) > 2.0**53  # beyond it a double does not hold every whole number
    if wrong.any():
        at = int(np.flatnonzero(wrong)[0])
        raise source.error(
            f"{name} is {values[at]:g}, which is no {kind.name}", f"{what} {at // columns}", "the file was changed"
        )
    return values.astype(kind)


def _together(values: Floats, columns: list[int]) -> Floats:
    """Return some columns as an array of their own."""
    first = columns[0]
    if columns == list(range(first, first + len(columns))):
        return values[:, first : first + len(columns)].copy()
    return values[:, columns]


def table_of(content: Content) -> tuple[list[str], list[NDArray[Any]], list[str]]:
    """Return the names and the columns of a content, and what is no column of numbers."""
    names, columns, lost = list(POINTS[0]), [content.points[:, i] for i in range(3)], []
    if content.normals is not None:
        names += NORMALS[0]
        columns += [content.normals[:, i] for i in range(3)]
    if content.colors is not None:
        names += [*COLORS[0], "alpha"][: content.colors.shape[1]]
        columns += [content.colors[:, i] for i in range(content.colors.shape[1])]
    if content.radii is not None:
        names.append(RADIUS)
        columns.append(content.radii)
    for name, values in content.attributes.items():
        if values.dtype.kind not in "fiub":
            lost.append(f"attribute {name!r} of type {values.dtype}")
            continue
        flat = flat_columns(values)
        for i in range(flat.shape[1]):
            names.append(name if values.ndim == 1 else f"{name}_{i}")
            columns.append(flat[:, i])
    return names, columns, lost


def flat_columns(values: NDArray[Any]) -> NDArray[Any]:
    """Return n values of any shape as n rows of columns."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _shades(names: Iterable[str]) -> list[str]:
    """Return the names that are colors, with the alpha of the same naming if it is there; none if there are none."""
    known = set(names)
    colors = first_of(COLORS, known)
    return [] if colors is None else [*colors, *({_ALPHA[colors]} & known)]


def _names_by_rule(columns: int, spread: Spread | None) -> list[str]:
    further = columns - 3
    names = list(POINTS[0])
    if further in (1, 4):
        names.append("intensity")
        further -= 1
    if further in (3, 6) and spread is not None:
        for first in range(len(names), columns, 3):
            group = COLORS[0] if _look_like_colors(*spread.some([first, first + 1, first + 2])) else NORMALS[0]
            names += [f"column_{first + i + 1}" for i in range(3)] if group[0] in names else group
        return names
    return names + [f"column_{i + 1}" for i in range(len(names), columns)]


def _look_like_colors(low: float, high: float, whole: bool) -> bool:
    return whole and low >= 0 and 1 < high <= 255


def _color_type(low: float, high: float, whole: bool) -> type[Any]:
    """Return the type of colors in text: bytes or words where all are whole numbers, else floats."""
    if whole and low >= 0:
        return np.uint8 if high <= 255 else np.uint16 if high <= 65535 else np.float64
    return np.float64
