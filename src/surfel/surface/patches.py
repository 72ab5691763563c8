"""The local patches of a cloud: every point's share of the area, found without a mesh.

The estimator, in the order of its steps: neighbours; normals where none are given; the noise level, and projection
where it matters; the tangent Voronoi cell of each point, unfolded over sharp edges; corrections for curvature and
roughness; and the mass that the outermost points of a border stand for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.surface.border_mass import border_mass, in_blocks
from surfel.surface.cells import FACET, JUMP, SPARSER, Cells, clip_cells, reach_of
from surfel.surface.close_sheets import has_close_sheets
from surfel.surface.denoise import Denoised, denoise, matters
from surfel.surface.flattened import restored
from surfel.surface.layers import layers_level
from surfel.surface.neighbourhoods import Neighbourhoods
from surfel.surface.noise import noise_level
from surfel.surface.normals import fitted_normals
from surfel.surface.rounding import rounding_level
from surfel.surface.steps import DENIED_BELOW, given_level, step_level
from surfel.surface.twist import LOOSE, STRICT, largest_twist
from surfel.surface.uneven_noise import uneven_level

SHARED = 1.4
"""How much farther the points of one of two close sheets lie apart than the spacing, which counts those of both."""

FAR, BEYOND, FAR_BEYOND = 64, 128, 512
"""Neighbours that cells are asked again with where the nearest do not settle them; and where, besides, the points lie
denser than those that come next, or so many times denser that these are not among the first."""

STEEP_JUMP, STEEP_SHARE, STEEP_FEW = 3.0, 0.005, 12
"""How many times farther apart points lie beyond a jump of density that is as steep; what share of them is denser than
what counts as dense, and how many are sparser than what counts as sparse."""

FINE_RELIEF_GIVEN, FINE_RELIEF_FITTED = 0.75, 1.0
"""How much of the roughness that the normals show between points counts. Given normals show all of it, some of which
the cells, unrolled over it, have already; normals fitted to the points are smoother (tuned on the bunny)."""

WIDENED, WIDENED_FROM = 0.58, 0.13
"""By how much of a square spacing each spacing of noise, above so many, widens the border at an open point (fitted to
the open ones of the calibrating shapes)."""


@dataclass(frozen=True, eq=False)
class LocalPatches:
    """The patches of a cloud, in the order of ``hood``, and what went into them.

    Parameters
    ----------
    hood : Neighbourhoods
        Of the points (projected, where there was noise).
    normals : Floats, shape (n, 3)
        Unit normals of either sign.
    areas : Floats, shape (n,)
        Each patch's share of the area; their sum is the area.
    cells : Cells
        The tangent Voronoi cells behind the areas.
    border : Floats, shape (n,)
        The part of the areas that stands for borders.
    doubt : Floats, shape (n,)
        By how much more or less that may be, where the points may be those of a grid, on the border or inside it.
    share : float
        What each open point along a border added, in cells.
    roughness : float
        Sum of cell area times roughness.
    noise : float
        In mean spacings; as estimated before projection.
    falls : float
        The power of the spacing with which the noise, in spacings there, falls.
    random_border : bool
        Whether the points lie inside the border by chance, not on it.
    projected : bool
        Whether noise was taken off.
    sheets : bool
        Whether the given normals told close sheets from noise.
    layers : bool
        Whether points lie above each other, as those of scans do that do not quite fit.
    """

    hood: Neighbourhoods
    normals: Floats
    areas: Floats
    cells: Cells
    border: Floats
    doubt: Floats
    share: float
    roughness: float
    noise: float
    random_border: bool
    projected: bool
    sheets: bool = False
    layers: bool = False
    falls: float = 0.0
    restored: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def area(self) -> float:
        """The area of the cloud's surface."""
        return float(self.areas.sum())


def local_patches(
    hood: Neighbourhoods,
    normals: Floats | None = None,
    noise: float | None = None,
    star: int = 0,
    *,
    fitted: Floats | None = None,
    sheets: bool = False,
    falls: float = 0.0,
) -> LocalPatches:
    """Estimate the patches of a cloud.

    Parameters
    ----------
    hood : Neighbourhoods
        Of distinct points, at least four.
    normals : Floats, shape (m, 3), optional
        Unit normals of either sign, zero where unknown, in the order of the original cloud.
    noise : float, optional
        The noise level in spacings, where it is known already.
    star : int
        How many neighbours round each cell to keep, for the fans.
    fitted : Floats, shape (n, 3), optional
        What :func:`surfel.surface.normals.fitted_normals` gives, where that is known already and none are given.
    sheets : bool
        Where the noise level is known: whether the normals told close sheets from noise.
    falls : float
        Where the noise level is known: the power of the spacing with which it falls.

    Returns
    -------
    LocalPatches
        In the order of its neighbourhoods.
    """
    level, layers = noise, False
    if level is None:
        level, sheets, layers = _level(hood, normals)
        level, falls = uneven_level(hood, level)
    if matters(level, hood.order):
        smooth = denoise(hood, level, falls)
        found = _patches_of(smooth.hood, smooth.normals, level, star, smooth)
        return replace(found, falls=falls, layers=layers)
    known = None if normals is None else normals[hood.rows]
    return _patches_of(hood, known, level, star, fitted=fitted, sheets=sheets)


def _level(hood: Neighbourhoods, normals: Floats | None) -> tuple[float, bool, bool]:
    """Return the noise of the points, whether good normals tell sheets that lie closer than their points, and whether
    there are layers.

    Such sheets look like noise, which good normals deny. They do not deny what is known of the points alone: that they
    were rounded, or lie above each other.
    """
    level, steps = noise_level(hood.index), step_level(hood)
    layers = layers_level(hood, parts=normals is None)
    known = max(rounding_level(hood), layers)
    level = max(known, steps if steps > 0.0 and level < DENIED_BELOW else max(level, steps))
    if normals is None:
        return level, False, layers > 0.0
    given = given_level(hood, normals[hood.rows])
    if given >= DENIED_BELOW:
        return level, False, layers > 0.0
    if has_close_sheets(hood, normals[hood.rows]):
        return min(level, given), True, False
    return min(level, max(given, known)), False, layers > 0.0


def _patches_of(
    hood: Neighbourhoods,
    normals: Floats | None,
    noise: float,
    star: int,
    smooth: Denoised | None = None,
    *,
    fitted: Floats | None = None,
    sheets: bool = False,
) -> LocalPatches:
    """Estimate the patches of points that are as clean as they will get."""
    projected = smooth is not None
    relief = FINE_RELIEF_FITTED if normals is None else FINE_RELIEF_GIVEN
    twist = STRICT if sheets else LOOSE if projected or normals is None else largest_twist(hood, normals)
    through = 0 if projected or normals is None else 2  # fitted normals are mixed up where planes meet
    normals = _completed(hood, normals) if fitted is None else fitted
    left = 0.0 if projected else noise
    cells = _settled_cells(hood, normals, star, 2 if projected else 1, twist, through, left)
    border, doubt, share, random_border = border_mass(hood, normals, cells, noise, gaps=through > 0)
    areas = cells.area * (1.0 + cells.curved)
    rough = areas * cells.rough
    back = [0.0] * 4
    if smooth is not None:
        parts = [areas * share for share in restored(cells.rough, smooth.bend, hood.spacing, smooth.levels)]
        parts.append(_noisy_border(cells, hood.spacing, smooth.levels, random_border))
        back = [float(part.sum()) for part in parts]
        areas = areas + sum(parts) + border
    else:
        areas = areas + border + relief * _fine_relief(hood, cells) * rough
    roughness = float(rough.sum())
    return LocalPatches(
        hood, normals, areas, cells, border, doubt, share, roughness, noise, random_border, projected, sheets,
        restored=(back[0], back[1], back[2], back[3]),
    )  # fmt: skip


def _fine_relief(hood: Neighbourhoods, cells: Cells) -> float:
    """Return how far the roughness that the normals show between points is to be counted, from 0 to 1.

    Random samples have relief between them. The vertices of a scanned mesh, which lie in good order, are its relief;
    but the normals of exact facets, known by many neighbours that share a plane, belong to samples all the same.
    """
    facets = float(((cells.uncovered & FACET) > 0).mean())
    return max(float(np.interp(hood.order, [0.6, 0.75], [1.0, 0.0])), float(np.interp(facets, [0.02, 0.1], [0.0, 1.0])))


def _completed(hood: Neighbourhoods, normals: Floats | None) -> Floats:
    """Return the given normals with the unknown ones fitted; all of them fitted where none are given."""
    if normals is None:
        return fitted_normals(hood)
    unknown: NDArray[np.bool_] = ~np.any(normals, axis=1)
    upright = _upright(normals)
    if not unknown.any():
        return upright
    return np.where(unknown[:, None], fitted_normals(hood), upright)


def _upright(normals: Floats) -> Floats:
    """Give every normal the sign of its last component that is not zero: flips change no bit then."""
    x, y, z = normals.T
    down = (z < 0.0) | ((z == 0.0) & ((y < 0.0) | ((y == 0.0) & (x < 0.0))))
    return np.ascontiguousarray(normals * np.where(down, -1.0, 1.0)[:, None])


def _settled_cells(
    hood: Neighbourhoods, normals: Floats, star: int, proof: int, twist: float, through: int, noise: float
) -> Cells:
    """Clip every cell by its near neighbours, then those that farther ones might change by more of them.

    Beside a jump of density most neighbours of a point lie on its own side; what is left open there is asked again.
    """
    n, k = hood.near.shape
    reach = reach_of(hood.order) * (SHARED if twist == STRICT else 1.0)
    cells = Cells.empty(n, star)

    def clip(rows: NDArray[np.int32], neighbours: NDArray[np.int32], *, final: bool) -> None:
        clip_cells(
            cells, hood.points, normals, hood.near, hood.spacing, rows, neighbours, reach, proof,
            final=final, twist=twist, through=through, noise=noise,
        )  # fmt: skip

    clip(np.arange(n, dtype=np.int32), hood.near, final=k == n - 1)
    if k == n - 1:
        return cells
    for rows in in_blocks(np.flatnonzero(cells.secure == 0).astype(np.int32)):
        clip(rows, hood.index.knn(min(FAR, n - 1), rows)[1], final=True)
    dense, few = float(np.quantile(hood.spacing, STEEP_SHARE)), min(STEEP_FEW, n)
    sparse = float(np.partition(hood.spacing, -few)[-few])
    for beyond in (BEYOND, FAR_BEYOND) if sparse > STEEP_JUMP * dense else (BEYOND,):
        for rows in in_blocks(np.flatnonzero(cells.closed == 0).astype(np.int32)):
            wide = hood.index.knn(min(beyond, n - 1), rows)[1]
            beside = (hood.spacing[wide] > JUMP * hood.spacing[rows, None]).sum(axis=1) >= SPARSER
            clip(rows[beside], wide[beside], final=True)
    return cells


def _noisy_border(cells: Cells, spacing: Floats, levels: Floats, random_border: bool) -> Floats:
    """Return, as a loss, by how much noise, projected along bent normals, has widened the border at each open point."""
    if not random_border:
        return np.zeros(len(levels))
    widened = WIDENED * np.maximum(0.0, levels - WIDENED_FROM)
    return np.where(cells.closed == 0, -widened * spacing * spacing, 0.0)
