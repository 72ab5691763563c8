"""What a safe spline remembers of its points: enough to let points come and go and to be fitted again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.bounding.residuals import Residuals
from surfel.core.cast import Floats, Integers, read_only
from surfel.core.errors import InputError

Margins = tuple[tuple[int, int], tuple[int, int]]
_KINDS: dict[str, type] = {"count": np.int64, "cells": np.int64, "gone": np.bool_}


@dataclass(frozen=True, eq=False)
class Memory:
    """For every micro-cell: how many points, and how far the worst lies beyond a reference spline.

    All points of a micro-cell lie on the safe side of ``reference + largest``. That is all that a new fit must know to
    be safe, and it does not grow with the number of points.

    Parameters
    ----------
    split : int
        Micro-cells along a side of a cell.
    reference : Floats, shape (n + 2, m + 2)
        Coefficients of the reference spline.
    largest : Floats, shape (a, b)
        Largest residual of the micro-cell, positive on the surface's side; -inf where it is empty.
    count : Integers, shape (a, b)
        Points in the micro-cell.
    uv, height : Floats, shape (a, b, 2) and (a, b)
        The point of the largest residual: where on the grid of the fit, and how high.
    weight : Floats, shape (n + 2, m + 2)
        Sum over all points of their weights on each coefficient: with it the mean gap of any spline is known.
    total : float
        Sum of the heights.
    cells : Integers, shape (2,)
        Cells of the grid of the fit, from which on points keep their micro-cells however the grid grows.
    gone : NDArray[np.bool_], shape (a, b)
        Whether the point of the largest residual was removed, while others of the micro-cell stay.
    """

    split: int
    reference: Floats
    largest: Floats
    count: Integers
    uv: Floats
    height: Floats
    weight: Floats
    total: float
    cells: Integers
    gone: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for name in ("reference", "largest", "count", "uv", "height", "weight", "cells", "gone"):
            kind = _KINDS.get(name, np.float64)
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=kind, order="C")))
        shape = self.largest.shape
        if not (
            self.largest.ndim == 2
            and self.count.shape == self.height.shape == self.gone.shape == shape
            and self.cells.shape == (2,)
            and self.uv.shape == (*shape, 2)
            and self.weight.shape == self.reference.shape
            and all(side == self.split * (wide - 3) for side, wide in zip(shape, self.reference.shape, strict=True))
        ):
            raise InputError("the parts of a spline's memory do not fit each other")

    @classmethod
    def of(cls, reference: Floats, residuals: Residuals, sign: float) -> Memory:
        """Return what is to be remembered of a comparison with a reference, in unsigned heights."""
        return cls(
            residuals.split,
            sign * reference,
            residuals.largest,
            residuals.count,
            residuals.uv,
            sign * residuals.height,
            residuals.mean_weights() * residuals.points,
            sign * float(residuals.total[0]),
            np.array(residuals.occupancy.shape),
            np.zeros(residuals.count.shape, np.bool_),
        )

    @property
    def points(self) -> int:
        """How many points are remembered."""
        return int(self.count.sum())

    def padded(self, wide: Margins) -> Memory:
        """Return the same on a grid with more cells before and after, along u and along v."""
        (before_u, after_u), (before_v, after_v) = wide
        k = self.split
        fine = ((k * before_u, k * after_u), (k * before_v, k * after_v))
        return replace(
            self,
            reference=np.pad(self.reference, wide, mode="edge"),
            largest=np.pad(self.largest, fine, constant_values=-np.inf),
            count=np.pad(self.count, fine),
            uv=np.pad(self.uv, (*fine, (0, 0))),
            height=np.pad(self.height, fine),
            weight=np.pad(self.weight, wide),
            gone=np.pad(self.gone, fine),
        )

    def mean_gap(self, coefficients: Floats, sign: float) -> float:
        """Return the mean gap between the points and a spline of the grid; ``sign`` is -1 for one below them."""
        points = max(self.points, 1)
        return sign * (float((self.weight * coefficients).sum()) - self.total) / points

    def to_arrays(self) -> dict[str, Any]:
        """Return everything as named arrays, for a file."""
        return {
            "split": np.int64(self.split),
            "reference": self.reference,
            "largest": self.largest,
            "count": self.count,
            "uv": self.uv,
            "height": self.height,
            "weight": self.weight,
            "total": np.float64(self.total),
            "cells": self.cells,
            "gone": self.gone,
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Any]) -> Memory:
        """Return the memory from what :meth:`to_arrays` gave.

        Raises
        ------
        InputError
            If the arrays do not fit each other.
        """
        try:
            return cls(
                split=int(arrays["split"]),
                reference=np.asarray(arrays["reference"]),
                largest=np.asarray(arrays["largest"]),
                count=np.asarray(arrays["count"]),
                uv=np.asarray(arrays["uv"]),
                height=np.asarray(arrays["height"]),
                weight=np.asarray(arrays["weight"]),
                total=float(arrays["total"]),
                cells=np.asarray(arrays["cells"]),
                gone=np.asarray(arrays["gone"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"the parts of a spline's memory do not fit each other: {error}") from error
