"""What can be shown: shapes, trees of shapes, safe splines and results of Boolean operations, one or several."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from surfel.core.errors import InputError
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels


def as_shapes(given: Any) -> list[Shape]:
    """Return shapes; a safe spline as its sheet, the result of a Boolean operation as its surfels.

    Raises
    ------
    InputError
        If something is no shape.
    """
    if isinstance(given, Shape) or not isinstance(given, Iterable):
        given = [given]
    found: list[Shape] = []
    for thing in given:
        if callable(getattr(thing, "sheet", None)):
            found.append(thing.sheet())
        elif isinstance(getattr(thing, "surfels", None), Surfels):
            found.append(thing.surfels)
        elif isinstance(thing, Shape):
            found.append(thing)
        else:
            cure = "; wrap points as surfel.Surfels(points)" if isinstance(given, np.ndarray) else ""
            raise InputError(
                f"shapes can be shown, trees of shapes, or several of them; got {type(thing).__name__}{cure}"
            )
    return found
