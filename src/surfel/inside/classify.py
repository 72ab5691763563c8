"""Classifier: built once for a cloud, it tells which places are inside, outside or on it, moving ones included."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel.core.affine import as_affine
from surfel.core.cast import Booleans, Floats, as_choice, as_number, as_points, as_rows
from surfel.core.errors import InputError
from surfel.index.hilbert import hilbert_order
from surfel.inside import sheets
from surfel.inside.border import disk_radii
from surfel.inside.classes import Classes
from surfel.inside.coincidence import DISTANCE, on_sheets, on_surface
from surfel.inside.colour import Coloured, colour_space
from surfel.inside.judges import NAMES, choose, named
from surfel.inside.operand import Operand
from surfel.inside.recolour import recolour
from surfel.inside.sift import UNDECIDED, sift_each, sift_sorted
from surfel.inside.slabs import Slabs

_MARGIN = 0.25  # spacings that slabs keep from the surfels; more than makes a place be on the surface
_RIGID = 1e-6  # how far a rotation may be from orthonormal
_BY_NEIGHBOURS = ("nearest", "two-nearest", "two-cluster", "imls")  # judges that would look for far places to skip
_BY_SHEETS = ("nearest", "two-nearest", "two-cluster")  # in their place, near the surface, sheets do better

SHEETS = "sheets"
"""The judge by curved sheets (:mod:`surfel.inside.sheets`), which ``auto`` takes where normals can be trusted."""


class Decision(NamedTuple):
    """Which judge tells places near the surface apart, and why that one."""

    judge: str
    reason: str


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
        self.recoloured = 0 if coloured is None else int((coloured.grid.table >= 0).sum())
        self.operand = operand if coloured is None else coloured.operand
        self.flipped: Booleans = np.zeros(0, bool) if coloured is None else coloured.flipped
        self.conflict = 0.0 if coloured is None else coloured.conflict
        self._widest = float(self.operand.spacings.max(initial=0.0))
        self.leaky = False if coloured is None else coloured.leaky
        if coloured is not None and self._slabbed:
            here = coloured.operand
            self._slabs = Slabs.of(
                coloured.owners, coloured.doubt, here.points, here.normals, self._radii(), self._margin()
            )

    def _radii(self) -> Floats:
        assert self._coloured is not None
        return disk_radii(self.operand.spacings, self.operand.areas, self._coloured.grid.step)

    def _margin(self) -> float:
        return _MARGIN * self.operand.spacing

    @property
    def decision(self) -> Decision:
        """Which judge tells places near the surface apart, and why."""
        with self._lock:
            if self._decision is None:
                chosen = choose(self.operand)
                self._decision = Decision(SHEETS if chosen.name in _BY_SHEETS else chosen.name, chosen.reason)
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
        other = queries if isinstance(queries, Operand) else None
        places = other.points if other is not None else as_points(queries, "queries")  # type: ignore[arg-type]
        upright = _normals_of(other, normals, len(places))
        matrix = rigid(pose)
        far = as_number(reach, "reach")
        if far < 0.0:
            raise InputError(f"reach must not be negative; got {far:g}")
        if self._coloured is None or not len(places):
            return Classes.outside(len(places))
        motion = matrix[:3].copy()
        if other is not None:
            motion[:, 3] += matrix[:3, :3] @ other.origin
        motion[:, 3] -= self.operand.origin
        kind, near = self._sift(other, places, motion, far)
        judged = np.flatnonzero(kind == UNDECIDED)
        there = places[judged] @ motion[:, :3].T + motion[:, 3]
        value, found = self._judge(there, in_order=other is not None)
        kind[judged] = value < 0.0
        if upright is not None and len(judged):
            on, close = self._on_surface(there, upright[judged] @ motion[:, :3].T, value, found)
            kind[judged[close]] = np.where(on > 0, on, kind[judged[close]])
        return Classes(kind, near, judged, value)

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
            other._slabs = self._slabs.with_cells(
                patch.coloured.owners, patch.held, operand.points, operand.normals, other._radii(), other._margin()
            )
        return other

    def _sift(
        self, other: Operand | None, places: Floats, motion: Floats, reach: float
    ) -> tuple[NDArray[np.int8], Booleans]:
        assert self._coloured is not None
        grid, owners = self._coloured.grid, self._coloured.owners
        slabs = self._slabs if self._has_distances() else self._slabs.without_planes()  # in noise they say too much
        if other is None:
            return sift_each(grid, owners, slabs, places, motion, reach)
        return sift_sorted(grid, owners, slabs, other.spheres, places, motion, reach)

    def _has_distances(self) -> bool:
        """Tell whether the judge's values are distances: not those of judges for noise."""
        return self.decision.judge in (SHEETS, *_BY_NEIGHBOURS)

    def _judge(self, places: Floats, *, in_order: bool) -> tuple[Floats, sheets.OverSheets | None]:
        """Judge local places near the surface; those in a hole, where no surfel is, by the winding number."""
        if not len(places):
            return np.empty(0), None
        name, found = self.decision.judge, None
        if name == SHEETS:
            found = sheets.over_sheets(self.operand, places, None if in_order else hilbert_order(places))
            value = found.value
        else:
            skipping = {"skip": False} if name in _BY_NEIGHBOURS else {}
            value = named(name)(self.operand, places + self.operand.origin, **skipping).value
        assert self._coloured is not None
        if self._coloured.doubt is not None:
            from surfel.inside.leaks import in_doubt

            open_ = in_doubt(self._coloured.grid, self._coloured.doubt, places)
            value[open_] = named("winding")(self.operand, places[open_] + self.operand.origin).value
        return value, found

    def _on_surface(
        self, places: Floats, normals: Floats, value: Floats, found: sheets.OverSheets | None
    ) -> tuple[NDArray[np.int8], NDArray[np.int64]]:
        """Return which of those local places that may be on the surface are, and which may be."""
        if found is not None:
            close = np.flatnonzero(np.abs(value) < 2.0 * DISTANCE * self.operand.spacings[found.near[:, 0]])
            near = found.squares[close], found.near[close]
            return on_sheets(self.operand, places[close], normals[close], *near), close
        close = np.arange(len(places))
        if self._has_distances():
            close = np.flatnonzero(np.abs(value) < DISTANCE * self._widest)
        return on_surface(self.operand, places[close] + self.operand.origin, normals[close]), close

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


def rigid(pose: ArrayLike | None) -> Floats:
    """Return a rigid motion as a 4 x 4 matrix, none as the identity, or say what is wrong with it."""
    if pose is None:
        return np.eye(4)
    matrix = as_affine(pose)
    turn = matrix[:3, :3]
    if float(np.abs(turn @ turn.T - np.eye(3)).max()) > _RIGID:
        raise InputError(
            "pose must be a rigid motion: its 3 x 3 part a rotation; build a classifier for a scaled cloud"
        )
    return matrix
