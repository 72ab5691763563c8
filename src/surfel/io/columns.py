"""Named and nameless columns as points, normals, colors, radii and attributes: one rule for every format."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.content import Content

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


def content_of_table(values: Floats, names: list[str] | None) -> Content:
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
    """
    if names is None:
        names = _names_by_rule(values)
    column = {name: i for i, name in enumerate(names)}
    places = [column.pop(name) for name in POINTS[0]]
    group = first_of(NORMALS, column)
    directions = [column.pop(name) for name in group] if group is not None else []
    rest = {name: np.ascontiguousarray(values[:, i]) for name, i in column.items()}
    shades = _shades(column)
    kind = _color_type(values[:, [column[name] for name in shades]]) if shades else None
    rest.update({name: rest[name].astype(kind) for name in shades if kind is not None})
    normals = values[:, directions] if directions else None
    points = values if places == [0, 1, 2] and values.shape[1] == 3 else values[:, places]
    return content_by_name(rest, np.ascontiguousarray(points), normals, [])


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


def _names_by_rule(values: Floats) -> list[str]:
    further = values.shape[1] - 3
    names = list(POINTS[0])
    if further in (1, 4):
        names.append("intensity")
        further -= 1
    if further in (3, 6):
        for first in range(len(names), values.shape[1], 3):
            group = COLORS[0] if _look_like_colors(values[:, first : first + 3]) else NORMALS[0]
            names += [f"column_{first + i + 1}" for i in range(3)] if group[0] in names else group
        return names
    return names + [f"column_{i + 1}" for i in range(len(names), values.shape[1])]


def _look_like_colors(values: Floats) -> bool:
    if len(values) == 0 or not np.isfinite(values).all():
        return False
    low, high = values.min(), values.max()
    return bool(low >= 0 and 1 < high <= 255 and (values == np.floor(values)).all())


def _color_type(values: Floats) -> type[Any]:
    """Return the type of colors in text: bytes or words where all are whole numbers, else floats."""
    if len(values) and np.isfinite(values).all() and values.min() >= 0 and (values == np.floor(values)).all():
        return np.uint8 if values.max() <= 255 else np.uint16 if values.max() <= 65535 else np.float64
    return np.float64
