"""Classifier: built once for a cloud, it tells which places are inside, outside or on it, moving ones included."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.cast import Booleans, Floats, as_choice, as_number, as_points, as_rows
from surfel.core.errors import InputError
from surfel.inside.classes import Classes
from surfel.inside.colour import Coloured, colour_space
from surfel.inside.decision import SHEETS, Decision
from surfel.inside.judges import NAMES
from surfel.inside.looks import Looks
from surfel.inside.moved import moved, rigid
from surfel.inside.near_surface import judged, on_which
from surfel.inside.operand import Operand
from surfel.inside.recolour import recolour
from surfel.inside.settle import UNDECIDED
from surfel.inside.sheets import OverSheets
from surfel.inside.sift import sift
from surfel.inside.slabs import Slabs

_MARGIN = 0.25  # spacings that slabs keep from the surfels; more than makes a place be on the surface


class Classifier:
    """Tells which places are inside a cloud; built once, then a query costs about what lies near the surface.

    Space is coloured when it is built (:mod:`surfel.inside.colour`). A query is sifted by the grid, whole blocks of
    surfels at a time; where a cell's surfels lie flat, two planes settle what is beyond them; a judge tells the rest.

    Parameters
    ----------
    operand : Operand
        The cloud; one without surfels has nothing inside.
    judge : str
        One of the judges, ``sheets``, or ``auto``: chosen from noise, flips and edges when the first place needs one.
    slabs : bool
        Settle places beyond the surfels of flat cells without a judge.

    Attributes
    ----------
    operand : Operand
        The cloud, with flipped normals turned.
    flipped : Booleans, shape (n,)
        Which of its sorted surfels were turned.
    conflict : float
        Share of the votes, by area, that contradict the colours of space, with normals as they were given, or are cast
        beside a hole. A clean closed cloud has about none and a clean open one few; flipped normals add their share.
    leaky : bool
        Whether inside and outside hang together, through a hole or an open border.

    Raises
    ------
    InputError
        If there is no judge of that name.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.classify import Classifier
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((2000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> ball = Classifier(Operand.of(p, p))
    >>> ball.classify([[0.0, 0.0, 0.5], [0.0, 0.0, 1.5]]).inside.tolist()
    [True, False]
    """

    def __init__(self, operand: Operand, judge: str = "auto", slabs: bool = True) -> None:
        self._wanted = as_choice(judge, "judge", ("auto", SHEETS, *NAMES))
        self._slabbed = bool(slabs)
        self._lock = threading.RLock()
        self._decision: Decision | None = None if judge == "auto" else Decision(judge, "it was asked for")
        self._take(operand, colour_space(operand) if len(operand) else None)

    def _take(self, operand: Operand, coloured: Coloured | None) -> None:
        """Adopt a coloured space and build the slabs."""
        self._coloured = coloured
        self._slabs = Slabs.none()
        self._looks: Looks | None = None
        self.recoloured = 0 if coloured is None else int((coloured.grid.table >= 0).sum())
        self.operand = operand if coloured is None else coloured.operand
        self.flipped: Booleans = np.zeros(0, bool) if coloured is None else coloured.flipped
        self.conflict = 0.0 if coloured is None else coloured.conflict
        self.leaky = False if coloured is None else coloured.leaky
        if coloured is not None and self._slabbed:
            here = coloured.operand
            self._slabs = Slabs.of(coloured.owners, here.points, here.normals, coloured.radii, self._margin())

    def _margin(self) -> float:
        return _MARGIN * self.operand.spacing

    @property
    def decision(self) -> Decision:
        """Which judge tells places near the surface apart, and why."""
        with self._lock:
            if self._decision is None:
                self._decision = Decision.of(self.operand)
            return self._decision

    def classify(
        self,
        queries: ArrayLike | Operand,
        normals: ArrayLike | None = None,
        pose: ArrayLike | None = None,
        reach: float = 0.0,
    ) -> Classes:
        """Tell which places are outside, inside or on the cloud.

        Parameters
        ----------
        queries : array_like, shape (q, 3), or Operand
            Places, in the coordinates of the cloud. Those of an operand are sifted by blocks, which is much faster,
            and the answers stand in its sorted order.
        normals : array_like, shape (q, 3), optional
            Their unit normals; an operand brings its own. Without them no place is on the surface.
        pose : array_like, shape (4, 4), optional
            A rigid motion under which the queries are taken.
        reach : float
            Places with border within this distance are ``near``, too.

        Raises
        ------
        InputError
            If a shape does not fit, a number is not finite, the pose is not rigid, or the reach is negative.
        """
        return self.classify_beside(queries, normals, pose, reach)[0]

    def classify_beside(
        self,
        queries: ArrayLike | Operand,
        normals: ArrayLike | None = None,
        pose: ArrayLike | None = None,
        reach: float = 0.0,
    ) -> tuple[Classes, OverSheets | None]:
        """Do what :meth:`classify` does, and hand on the surfels nearest to the judged places, where sheets did it."""
        other = queries if isinstance(queries, Operand) else None
        places = other.points if other is not None else as_points(queries, "queries")  # type: ignore[arg-type]
        upright = _normals_of(other, normals, len(places))
        matrix = rigid(pose)
        far = as_number(reach, "reach")
        if far < 0.0:
            raise InputError(f"reach must not be negative; got {far:g}")
        if self._coloured is None or not len(places):
            return Classes.outside(len(places)), None
        motion = matrix[:3].copy()
        if other is not None:
            motion[:, 3] += matrix[:3, :3] @ other.origin
        motion[:, 3] -= self.operand.origin
        kind, near = self._sift(other, places, motion, far)
        rows = np.flatnonzero(kind == UNDECIDED)
        there = moved(places, rows, motion, 1.0)
        value, found = judged(self._coloured, self.decision.judge, there, in_order=other is not None)
        kind[rows] = value < 0.0
        if upright is not None and len(rows):
            turned = moved(upright, rows, motion, 0.0)
            on, close = on_which(self._coloured, self.decision, there, turned, value, found)
            kind[rows[close]] = np.where(on > 0, on, kind[rows[close]])
        return Classes(kind, near, rows, value), found

    def edited(self, rows: ArrayLike, points: ArrayLike, normals: ArrayLike) -> Classifier:
        """Return a classifier of the cloud with some surfels moved or turned; their neighbourhood is coloured anew.

        Where that cannot be done (space leaked before, or leaks or parts now, or a surfel leaves the grid), everything
        is coloured anew. ``recoloured`` says how many bricks of 512 cells were.

        Parameters
        ----------
        rows : array_like of int, shape (m,)
            Rows of the cloud as it was given.
        points, normals : array_like, shape (m, 3)
            Where these surfels are now, and their unit normals.

        Raises
        ------
        InputError
            If a row does not exist or is named twice, or a shape does not fit.
        """
        given = np.asarray(rows)
        n = len(self.operand)
        if given.ndim != 1 or (len(given) and (given.dtype.kind not in "iu" or given.min() < 0 or given.max() >= n)):
            raise InputError(f"rows must be row numbers between 0 and {n - 1}; got type {given.dtype}")
        if len(np.unique(given)) < len(given):
            raise InputError("rows must not name a surfel twice")
        place = as_rows(points, "points", len(given)) - self.operand.origin
        upright = as_rows(normals, "normals", len(given))
        if not (np.isfinite(place).all() and np.isfinite(upright).all()):
            raise InputError("points and normals must be finite")
        if not len(given):
            return self
        sorted_row = np.empty(n, np.int64)
        sorted_row[self.operand.order] = np.arange(n)
        chosen = sorted_row[given]
        operand = self.operand.with_edits(chosen, place, upright)
        assert self._coloured is not None
        patch = recolour(self._coloured, operand, chosen)
        if patch is None:
            return Classifier(operand, self._wanted, self._slabbed)
        other = object.__new__(Classifier)
        other._wanted, other._slabbed, other._lock = self._wanted, False, threading.RLock()
        other._decision = self._decision
        other._take(operand, patch.coloured)
        other._slabbed, other.recoloured = self._slabbed, len(patch.place)
        if self._slabbed:
            owners, radii = patch.coloured.owners, patch.coloured.radii
            other._slabs = self._slabs.with_cells(
                owners, patch.held, operand.points, operand.normals, radii, other._margin()
            )
        return other

    def _sift(
        self, other: Operand | None, places: Floats, motion: Floats, reach: float
    ) -> tuple[NDArray[np.int8], Booleans]:
        slabs = (
            self._slabs if self.decision.has_distances else self._slabs.without_planes()
        )  # in noise they say too much
        return sift(self._laid_out(), slabs, None if other is None else other.spheres, places, motion, reach)

    def _laid_out(self) -> Looks:
        """Return the space as sifting reads it, made for the first places that are asked about."""
        with self._lock:
            if self._looks is None:
                assert self._coloured is not None
                self._looks = Looks.of(self._coloured.grid, self._coloured.owners, self._coloured.doubt)
            return self._looks

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        self._lock = threading.RLock()


def _normals_of(other: Operand | None, normals: ArrayLike | None, count: int) -> Floats | None:
    if other is not None:
        if normals is not None:
            raise InputError("normals must be left out where an operand is classified; it has its own")
        return other.normals
    return None if normals is None else as_rows(normals, "normals", count)
