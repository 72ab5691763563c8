"""Interpolation: what surfels that are born at the cut take from those round them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.booleans.cells import frames_of
from surfel.booleans.part import Part
from surfel.core.cast import Floats

NEIGHBOURS = 8

_ALIKE = 0.5  # least cosine between normals of surfels that lie on one sheet


class Blend:
    """The surfels of a part round some places, and their weights.

    Parameters
    ----------
    part : Part
        The surfels.
    places : Floats, shape (q, 3)
        Near its surface.
    parents : NDArray[np.int64], shape (q,)
        For each place the row of the surfel that it was split off; only what lies on its sheet counts.
    """

    def __init__(self, part: Part, places: Floats, parents: NDArray[np.int64]) -> None:
        self.part = part
        self.parents = parents
        k = min(NEIGHBOURS, len(part))
        squares, self.near = part.operand.index.knn_of(places, k)
        alike = np.einsum("ij,ikj->ik", part.normals[parents], part.normals[self.near]) > _ALIKE
        least = 1e-6 * part.operand.spacings[parents][:, None] ** 2
        weight = np.where(alike, 1.0 / np.maximum(squares, np.maximum(least, 1e-300)), 0.0)
        lost = weight.sum(axis=1) <= 0.0
        self.near[lost, 0], weight[lost, 0] = parents[lost], 1.0
        self.places = places
        self.weight = _linear(weight, part, self.near, places, parents)

    def normals(self) -> Floats:
        """Return unit normals."""
        mean = np.einsum("ik,ikj->ij", self.weight, self.part.normals[self.near])
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        return np.where(length > 0.0, mean / np.where(length > 0.0, length, 1.0), self.part.normals[self.parents])

    def lifted(self) -> Floats:
        """Return the places moved onto the curved surface of the surfels round them."""
        normal = self.normals()
        offset = self.places[:, None] - self.part.points[self.near]
        over = 0.5 * np.einsum("ikj,ikj->ik", offset, self.part.normals[self.near] + normal[:, None])
        height = np.einsum("ik,ik->i", self.weight, over)
        return np.asarray(self.places - height[:, None] * normal)

    def values(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return interpolated values of the cloud: floats and colors; whole numbers and text are the nearest one's."""
        given = rows[self.part.order]
        if rows.dtype.kind != "f" or not np.isfinite(rows).all():
            return np.asarray(given[self.near[np.arange(len(self.near)), self.weight.argmax(axis=1)]])
        return np.asarray(np.einsum("ik,ik...->i...", self.weight, given[self.near]), rows.dtype)

    def colors(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return interpolated colors, also of whole numbers."""
        around = rows[self.part.order][self.near].astype(float)
        mean = np.einsum("ik,ikj->ij", self.weight, around)
        mean = np.clip(mean, around.min(axis=1), around.max(axis=1))
        return np.asarray((np.rint(mean) if rows.dtype.kind in "iu" else mean).astype(rows.dtype))

    def attributes(self, given: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Return all attributes."""
        return {name: self.values(value) for name, value in given.items()}


def _linear(weight: Floats, part: Part, near: NDArray[np.int32], places: Floats, parents: NDArray[np.int64]) -> Floats:
    """Return weights that give back what is linear along the tangent plane (moving least squares)."""
    across, along = frames_of(part.normals[parents])
    offset = part.points[near] - places[:, None]
    scale = np.maximum(part.operand.spacings[parents], 1e-300)[:, None]
    basis = np.stack(
        [
            np.ones(weight.shape),
            np.einsum("ikj,ij->ik", offset, across) / scale,
            np.einsum("ikj,ij->ik", offset, along) / scale,
        ],
        axis=2,
    )
    weight = weight / weight.max(axis=1, keepdims=True)
    matrix = np.einsum("ik,ikp,ikq->ipq", weight, basis, basis)
    matrix[:, [1, 2], [1, 2]] += 1e-6 * weight.sum(axis=1)[:, None]  # few or aligned neighbours give their mean
    factor = np.linalg.solve(matrix, np.broadcast_to(np.array([[1.0], [0.0], [0.0]]), (len(weight), 3, 1)))[..., 0]
    found = weight * np.einsum("ikp,ip->ik", basis, factor)
    return np.asarray(found / found.sum(axis=1, keepdims=True))
