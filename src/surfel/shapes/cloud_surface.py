"""What is learnt from a cloud's points, each thing once, on first use."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from surfel.core.box import corners
from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.core.patches import Patches
from surfel.index.bvh import TriangleBvh
from surfel.lines.bundles import Bundles
from surfel.shapes.bulge import Bulge, bulge_of
from surfel.shapes.sheets import CloudCrossings, crossings_of
from surfel.surface.close_sheets import SHARE_FITTED, faces_one_way, has_close_sheets, is_thin_plate
from surfel.surface.fans import STAR, Fans, build_fans
from surfel.surface.left_strays import NONE_LEFT, LeftStrays
from surfel.surface.neighbourhoods import Neighbourhoods, cleaned
from surfel.surface.noise import is_two_sheets
from surfel.surface.orient import Orientation, orient
from surfel.surface.overlay import is_overlay
from surfel.surface.patches import LocalPatches, local_patches
from surfel.surface.sampling_error import SamplingError, sampling_error
from surfel.surface.trusted import Trusted, trusted_normals

if TYPE_CHECKING:
    from surfel.shapes.clips import Clips

Value = TypeVar("Value")


SLIVER = 0.05
"""Surfels of which a cut has left less than this share of the median area add it to the others."""

_LARGEST = 1e100  # half extents beyond, and below one over it, have no cube


class CloudSurface:
    """The surface of a cloud, in the coordinates of the cloud unless said otherwise.

    Inside, the cloud is centred and scaled by a power of two to an extent of about 1, so that any units and offsets
    give the same digits. The order of the work: clean, estimate the patches, judge their error; and only for lines:
    fans, their tree, and the orientation.

    Parameters
    ----------
    points : Floats, shape (n, 3)
        Finite coordinates.
    normals : Floats, shape (n, 3), optional
        Unit normals, zero where unknown.
    clips : Clips, optional
        What cut the surfels off: they stand for what is left of their cells, and no border is added at a cut.
    """

    def __init__(self, points: Floats, normals: Floats | None, clips: Clips | None = None) -> None:
        self._given = normals
        self._clips = clips
        self._count = len(points)
        self._lock = threading.RLock()
        self._known: dict[str, Any] = {}
        low, high = corners(points) if len(points) else np.zeros((2, 3))
        self.origin = 0.5 * low + 0.5 * high
        extent = float((0.5 * high - 0.5 * low).max())
        if extent > 0.0 and not 1.0 / _LARGEST < extent < _LARGEST:
            raise InputError(
                f"the points span {extent:g} to either side of their middle, whose cube no float holds; scale them"
            )
        self.scale = 2.0 ** math.frexp(extent)[1] if extent > 0.0 else 1.0
        self._points = (points - self.origin) / self.scale

    @property
    def cleaning(self) -> Mapping[str, int]:
        """How many duplicates and strays were left out."""
        return self._cleaned[1]

    @property
    def left_strays(self) -> LeftStrays:
        """What strays that were not told from the surface are likely to add to the area, in scaled units."""
        hood = self._cleaned[0]
        return NONE_LEFT if hood is None else hood.left

    @property
    def rows(self) -> NDArray[np.int64]:
        """The rows of the cloud that cleaning left, ascending; none where there is no surface."""
        hood = self._cleaned[0]
        return np.empty(0, np.int64) if hood is None else np.sort(hood.rows)

    @property
    def noise(self) -> float:
        """Standard deviation of the points off the surface, in spacings; NaN where there is no surface."""
        return math.nan if self.local is None else self.local.noise

    @property
    def trusted(self) -> Trusted:
        """The given normals, as far as the points bear them out."""
        hood = self._cleaned[0]
        if hood is None or self._given is None:
            return Trusted(self._given)
        given = self._given
        return self._once("trusted", lambda: trusted_normals(hood, given))

    @property
    def two_sheets(self) -> bool:
        """Whether what reads as noise is two sheets of points nearer to each other than their spacing."""
        hood, noise = self._cleaned[0], self.noise
        return hood is not None and self._once("two_sheets", lambda: is_two_sheets(hood.index, noise))

    @property
    def thin(self) -> bool:
        """Whether the given normals tell two sides of a plate, too near to each other for both to be measured."""
        hood, local, normals = self._cleaned[0], self.local, self.trusted.normals
        if hood is None or local is None or normals is None or local.sheets:
            return False
        given, layers = normals[hood.rows], local.layers
        return self._once("thin", lambda: is_thin_plate(hood, given) or (layers and not faces_one_way(hood, given)))

    @property
    def is_overlay(self) -> bool:
        """Whether the points lie as those of several scans do, some of which overlap.

        The parts of a Boolean's result, which are cut off, are sampled each in its own way.
        """
        hood = self._cleaned[0]
        return hood is not None and self._clips is None and self._once("is_overlay", lambda: is_overlay(hood))

    @property
    def overlaid(self) -> bool:
        """Whether layers of points that face the same way, by the given normals, lie closer than their points."""
        hood, local = self._cleaned[0], self.local
        normals = self.trusted.normals
        if hood is None or local is None or normals is None or not local.sheets:
            return False
        given = normals[hood.rows]
        return self._once("overlaid", lambda: faces_one_way(hood, given))

    @property
    def crowded(self) -> bool:
        """Whether sheets lie so close, of a cloud without normals, that their points cannot be told apart."""
        local = self.local
        if local is None or self.trusted.normals is not None:
            return False
        return self._once("crowded", lambda: has_close_sheets(local.hood, local.normals, SHARE_FITTED))

    @property
    def spacing(self) -> float:
        """Typical distance between neighbouring points; NaN where there is no surface."""
        return math.nan if self.local is None else float(np.median(self.local.hood.spacing)) * self.scale

    @property
    def local(self) -> LocalPatches | None:
        """The patches, centred and scaled, in the order of their index; None for less than four points."""
        hood = self._cleaned[0]
        if hood is None:
            return None
        return self._once("local", lambda: self._carried(self._estimated(hood)))

    @property
    def error(self) -> SamplingError | None:
        """How far the area may be off, in scaled units; None where there is no surface."""
        hood = self._cleaned[0]
        if hood is None:
            return None
        return self._once("error", lambda: sampling_error(hood, self.trusted.normals, self._estimated(hood)))

    def _estimated(self, hood: Neighbourhoods) -> LocalPatches:
        given = self.trusted
        return self._once("estimated", lambda: local_patches(hood, given.normals, star=STAR, fitted=given.fitted))

    def _carried(self, found: LocalPatches) -> LocalPatches:
        """Return the patches with the areas that clipped surfels carry."""
        areas = None if self._clips is None else self._clips.areas
        if areas is None:
            return found
        kept = areas[found.hood.rows]
        total = float(kept.sum())  # what slivers stand for is shared out to the others
        return replace(found, areas=kept * (float(areas.sum()) / total if total else 1.0) / self.scale**2)

    @property
    def known(self) -> tuple[LocalPatches, SamplingError]:
        """The local patches and the error of their area; an InputError where there is no surface."""
        local, error = self._surface(), self.error
        assert error is not None  # there is one wherever there are patches
        return local, error

    @property
    def patches(self) -> Patches:
        """One patch for each point, in the order of the cloud; what cleaning left out has no area."""
        return self._once("patches", self._all_patches)

    @property
    def ambiguous_signs(self) -> float:
        """Share of neighbours whose propagated signs contradict each other; 0 where few do or none were propagated."""
        with self._lock:
            found: Orientation | None = self._known.get("orientation")
        return found.conflict if found is not None and found.ambiguous else 0.0

    @property
    def orientation(self) -> Orientation:
        """Signs for the normals, in the order of the index."""
        local = self._surface()
        return self._once("orientation", lambda: orient(local.hood.points, local.normals, local.hood.near))

    def cross(self, lines: Lines) -> CloudCrossings:
        """Return every hit of every line on the fans, weighted by its share of the area."""
        if self.local is None:
            nothing = np.empty(0)
            return CloudCrossings(
                np.zeros(len(lines) + 1, np.int64),
                nothing,
                nothing,
                nothing,
                np.empty(0, np.int32),
                nothing,
                nothing,
                np.empty((0, 3)),
            )
        fans, tree, normals, spacing = self._once("fans", self._crossable)
        inner = Lines((lines.origins - self.origin) / self.scale, lines.directions, lines.weights)
        hits = tree.cross(inner.origins, inner.directions, barycentric=True)
        found = crossings_of(inner, hits, fans.vertices, normals, spacing, fans.triangles, fans.weights, fans.votes)
        return CloudCrossings(
            found.offsets, found.t * self.scale, found.cosine, found.weight, found.leaf, found.share,
            found.gap * self.scale, found.normal,
        )  # fmt: skip

    @property
    def bulge(self) -> Bulge:
        """The volume between the triangles that lines cross and the curved surface that they stand for."""
        return self._once("bulge", self._bulge)

    @property
    def leak(self) -> float:
        """Share of the lines that hit which pass an odd number of sheets, on a few lines; NaN where none hit."""
        return self._once("leak", self._leak_of_few_lines)

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Tell which points lie inside: by the parity of the sheets on one side, on most of three lines."""
        votes = np.zeros(len(points), np.int64)
        for direction in _GENERIC:
            lines = Lines(points, np.tile(direction, (len(points), 1)), np.ones(len(points)))
            events = self.cross(lines).merged()
            after = np.bincount(events.lines[events.t > 0.0], minlength=len(points))
            votes += after % 2
        return np.asarray(votes >= 2)

    @property
    def _cleaned(self) -> tuple[Neighbourhoods | None, dict[str, int]]:
        return self._once("cleaned", self._clean)

    def _clean(self) -> tuple[Neighbourhoods | None, dict[str, int]]:
        """Leave out duplicates and strays, and slivers that a cut has left: they would crowd its edge."""
        areas = None if self._clips is None else self._clips.areas
        if areas is None or not len(areas):
            return cleaned(self._points, self._given)
        large = np.flatnonzero(areas >= SLIVER * np.median(areas))
        hood, counts = cleaned(self._points[large], None if self._given is None else self._given[large])
        return (None if hood is None else replace(hood, rows=large[hood.rows])), counts

    def _surface(self) -> LocalPatches:
        local = self.local
        if local is None:
            raise InputError(f"{self._count} points show no surface; at least four distinct ones are needed")
        return local

    def _all_patches(self) -> Patches:
        points, normals, areas = self._points.copy(), np.zeros_like(self._points), np.zeros(self._count)
        if self.local is not None:
            hood = self.local.hood
            points[hood.rows] = hood.points + hood.index.origin
            normals[hood.rows] = self._signed(self.local)
            areas[hood.rows] = self.local.areas
        return Patches(points * self.scale + self.origin, normals, areas * self.scale**2)

    def _signed(self, local: LocalPatches) -> Floats:
        """Give the normals the signs of the given ones; those of unknown sign that of the orientation."""
        known = self.trusted.normals
        if known is None:
            return self.orientation.normals
        given = known[local.hood.rows]
        side = np.sign(np.einsum("ij,ij->i", given, local.normals))
        if (side == 0.0).any():
            oriented = self.orientation.normals
            return np.where(side[:, None] == 0.0, oriented, local.normals * side[:, None])
        return np.asarray(local.normals * side[:, None])

    def _leak_of_few_lines(self) -> float:
        """Cast the same lines, turned and shifted by a fixed seed, whoever asks."""
        if self.local is None:
            return math.nan
        hood = self.local.hood
        place = (hood.points + hood.index.origin) * self.scale + self.origin
        source = Bundles.over(place, _BUNDLES, 0, 2.0 * self.spacing)
        sheets = [
            self.cross(source.lines(bundle, 0, _LEAK_LINES, _LEAK_LINES)).merged().counts for bundle in range(_BUNDLES)
        ]
        weights = np.repeat([source.measure(bundle) for bundle in range(_BUNDLES)], _LEAK_LINES)
        counts = np.concatenate(sheets)
        hit = float(weights[counts > 0].sum())
        return float(weights[counts % 2 == 1].sum()) / hit if hit else math.nan

    def _crossable(self) -> tuple[Fans, TriangleBvh, Floats, Floats]:
        local = self._surface()
        fans = build_fans(local.hood.points, local.normals, local.areas, local.cells.star, local.cells.joined)
        normals = np.ascontiguousarray(self._signed(local)[fans.owner])
        vertices = fans.vertices + local.hood.index.origin
        return (
            fans._replace(vertices=vertices),
            TriangleBvh(vertices, fans.triangles),
            normals,
            local.hood.spacing[fans.owner],
        )

    def _bulge(self) -> Bulge:
        fans, _, normals, _ = self._once("fans", self._crossable)
        found = bulge_of(fans, normals)
        return Bulge(*(volume * self.scale**3 for volume in found))

    def _once(self, name: str, make: Callable[[], Value]) -> Value:
        with self._lock:
            if name not in self._known:
                self._known[name] = make()
            return self._known[name]  # type: ignore[no-any-return]


_BUNDLES, _LEAK_LINES = 16, 256  # 4096 lines tell a leak of 2 % to about 0.3 %

_GENERIC = np.array([[0.57232, 0.31415, 0.75736], [-0.67513, 0.69314, 0.25264], [0.16181, -0.83462, 0.52651]])
_GENERIC /= np.linalg.norm(_GENERIC, axis=1, keepdims=True)
