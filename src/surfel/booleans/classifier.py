"""Classifier: built once for a cloud, it tells which surfels of another are inside, also while that one moves."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from surfel.core.cast import as_choice
from surfel.core.errors import InputError
from surfel.inside.both_ways import both_ways
from surfel.inside.classes import Classes
from surfel.inside.classify import Classifier as InnerClassifier
from surfel.inside.decision import SHEETS, Decision
from surfel.inside.judges import NAMES
from surfel.inside.unsorted import unsorted
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
        return unsorted(self._inner.classify(other.operand, pose=pose), other.operand.order)

    def both_ways(self, other: Classifier, pose: ArrayLike | None = None) -> tuple[Classes, Classes]:
        """Classify the surfels of two clouds, each by the other, at the same time: for clouds that keep moving.

        Parameters
        ----------
        other : Classifier
            That of the other cloud.
        pose : array_like, shape (4, 4), optional
            A rigid motion under which the other cloud is taken.

        Returns
        -------
        of_other, of_this : Classes
            Where the surfels of the other cloud lie in this one, and those of this one in the other, each in the order
            of its cloud.

        Raises
        ------
        InputError
            If it is no classifier, or the pose is not rigid.

        Examples
        --------
        >>> import numpy as np, surfel
        >>> p = np.random.default_rng(0).standard_normal((2000, 3))
        >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
        >>> large, small = surfel.Classifier(surfel.Surfels(p, p)), surfel.Classifier(surfel.Surfels(0.5 * p, p))
        >>> of_small, of_large = large.both_ways(small)
        >>> bool(of_small.inside.all()), bool(of_large.inside.any())
        (True, False)
        """
        if not isinstance(other, Classifier):
            raise InputError(f"other must be a surfel.Classifier; got {type(other).__name__}")
        of_other, of_this = both_ways(self._inner, other._inner, pose)
        return unsorted(of_other, other._inner.operand.order), unsorted(of_this, self._inner.operand.order)

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

    def plot(self, axis: str = "y", at: float | None = None, octree: int | None = None) -> Any:
        """Return a figure of matplotlib (extra ``plot``): a slice of space in cells, outside, inside and border.

        Parameters
        ----------
        axis : {"x", "y", "z"}
            What the slice is across.
        at : float, optional
            Where it is; by default in the middle of the points.
        octree : int, optional
            Show an octree of so many levels instead, 1 to 8, colored level by level as Adams and Dutre did (Gaal, sec.
            6.1); it is not what the classifier uses.

        Raises
        ------
        InputError
            If there is no such axis, the slice lies beyond the cells, or an octree of so many levels is none.
        MissingExtraError
            If matplotlib is not installed.
        """
        from surfel.booleans.figures import plot_space

        return plot_space(self._inner, axis, at, octree)
