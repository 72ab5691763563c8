"""Classifier: built once for a cloud, it tells which surfels of another are inside, also while that one moves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.cast import as_choice
from surfel.core.errors import InputError
from surfel.inside.classes import Classes
from surfel.inside.classify import Classifier as InnerClassifier
from surfel.inside.decision import SHEETS, Decision
from surfel.inside.judges import NAMES
from surfel.inside.operand import Operand
from surfel.shapes.surfels import Surfels


class Classifier:
    """Tells which surfels of other clouds are inside a cloud; a query costs about what lies near the surface.

    Parameters
    ----------
    cloud : Surfels
        The cloud; it is taken for a solid. Clips are honoured.
    judge : str
        Which judge tells places near the surface apart; ``auto`` takes the cloud's own, or chooses one.

    Raises
    ------
    InputError
        If it is no cloud, or there is no judge of that name.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> p = np.random.default_rng(0).standard_normal((2000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> ball = surfel.Surfels(p, p)
    >>> space = surfel.Classifier(ball)
    >>> small = surfel.Surfels(0.5 * p, p)
    >>> bool(space.classify(small).inside.all())
    True
    >>> away = np.eye(4)
    >>> away[0, 3] = 3.0
    >>> bool(space.classify(small, pose=away).inside.any())
    False
    """

    def __init__(self, cloud: Surfels, judge: str = "auto") -> None:
        if not isinstance(cloud, Surfels):
            raise InputError(f"cloud must be a surfel.Surfels; got {type(cloud).__name__}")
        as_choice(judge, "judge", ("auto", SHEETS, *NAMES))
        self._inner = cloud._classifier(cloud.judge or "auto" if judge == "auto" else judge)

    @classmethod
    def _of(cls, inner: InnerClassifier) -> Classifier:
        made = object.__new__(cls)
        made._inner = inner
        return made

    @property
    def leaky(self) -> bool:
        """Whether inside and outside hang together, through a hole or an open border."""
        return self._inner.leaky

    @property
    def conflict(self) -> float:
        """The share of the cloud's surface that contradicts the colors of space or lies beside a hole."""
        return self._inner.conflict

    @property
    def decision(self) -> Decision:
        """The judge, and why that one."""
        return self._inner.decision

    @property
    def recolored(self) -> int:
        """How many bricks of 512 cells were colored when this was made; after an edit, few."""
        return self._inner.recoloured

    def classify(
        self, other: Surfels | ArrayLike, pose: ArrayLike | None = None, normals: ArrayLike | None = None
    ) -> Classes:
        """Tell which surfels are outside, inside or on the cloud.

        Parameters
        ----------
        other : Surfels, or array_like of shape (q, 3)
            A cloud, whose index is built once and kept, or places.
        pose : array_like, shape (4, 4), optional
            A rigid motion under which they are taken.
        normals : array_like, shape (q, 3), optional
            Of places; a cloud brings its own.

        Returns
        -------
        Classes
            In the order of what was given.

        Raises
        ------
        InputError
            If a shape does not fit, or the pose is not rigid.
        """
        if not isinstance(other, Surfels):
            return self._inner.classify(other, normals=normals, pose=pose)
        if normals is not None:
            raise InputError("normals must be left out where a cloud is classified; it has its own")
        return _as_given(self._inner.classify(other.operand, pose=pose), other.operand)

    def edited(self, rows: ArrayLike, points: ArrayLike, normals: ArrayLike) -> Classifier:
        """Return the classifier of the cloud with some surfels moved or turned; only what is near is colored anew.

        Parameters
        ----------
        rows : array_like of int, shape (m,)
            Rows of the cloud.
        points, normals : array_like, shape (m, 3)
            Where these surfels are now, and their unit normals.

        Raises
        ------
        InputError
            If a row does not exist or is named twice, or a shape does not fit.
        """
        return Classifier._of(self._inner.edited(rows, points, normals))

    def plot(self, axis: str = "y", at: float | None = None) -> Any:
        """Return a figure of matplotlib (extra ``plot``): a slice of space in cells, outside, inside and border.

        Parameters
        ----------
        axis : {"x", "y", "z"}
            What the slice is across.
        at : float, optional
            Where it is; by default in the middle of the points.

        Raises
        ------
        InputError
            If there is no such axis, or the slice lies beyond the cells.
        MissingExtraError
            If matplotlib is not installed.
        """
        from surfel.booleans.figures import plot_space

        return plot_space(self._inner, axis, at)


def _as_given(found: Classes, operand: Operand) -> Classes:
    """Bring the answers from the order of the index to that of the cloud."""
    order = operand.order
    kind, near = np.empty_like(found.kind), np.empty_like(found.near)
    kind[order], near[order] = found.kind, found.near
    rows: NDArray[np.int64] = order[found.judged].astype(np.int64)
    ascending = np.argsort(rows)
    return Classes(kind, near, rows[ascending], found.value[ascending])
