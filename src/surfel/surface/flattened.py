"""What projection does to the area: what it flattens, what noise it leaves, and what it draws inward.

Noise along the surface blurs it as heat spreads. A point that has moved by sigma along a bent surface lies off it, so
that what is fitted to such points lies ``sigma^2 (k1 + k2) / 2`` to the inside of the bend, and has lost
``sigma^2 (k1 + k2)^2 / 2`` of its area. The roughness that is left is partly noise, and how much is known from spheres.
The rest is relief, and where some is left more has been flattened.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfel.core.cast import Floats

LEVELS = np.array([0.0, 0.05, 0.1, 0.1499, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, 1.0])
"""Noise, in spacings, of spheres that were measured; from 0.15 points are projected twice."""

AREA_LEFT = 1e-4 * np.array([0, 3.4, 13.7, 30, 30, 50, 70, 81, 84, 91, 91.5, 92, 74, 64, 47, 32, 18])
ROUGH_LEFT = 1e-4 * np.array([0, 3.2, 12, 23.8, 21, 32, 41, 44.8, 44.3, 46.8, 46, 45.2, 37.5, 32.7, 25, 18, 11])
BEND_LEFT = 1e-4 * np.array([0, 6, 22, 46.5, 66, 108, 140, 144, 127, 126, 111.5, 98.8, 63.5, 46, 24, 13, 6])
"""What noise of these levels adds to an area, to its roughness, and to the mean square of (k1 + k2) h."""

FLATTENED, FLATTENED_BY_NOISE = 1.0, 8.0
"""Relief that projection takes off, in units of the relief that it leaves: without noise, and more with each spacing
of it (fitted to the calibrating shapes)."""


class Restored(NamedTuple):
    """What is given back to each area, in units of it: flattened relief, and what bends have drawn in.

    The noise is a loss: what it had added. Each has the shape (n,).
    """

    relief: Floats
    drawn_in: Floats
    noise: Floats


def restored(rough: Floats, bend: Floats, spacing: Floats, levels: Floats) -> Restored:
    """Return what projection has taken off each area and left on it.

    Parameters
    ----------
    rough : Floats, shape (n,)
        Roughness after projection.
    bend : Floats, shape (n,)
        Sum of the principal curvatures.
    spacing : Floats, shape (n,)
        Local spacing.
    levels : Floats, shape (n,)
        Noise before projection, in spacings there.
    """
    area, left, bent = (np.interp(levels, LEVELS, column) for column in (AREA_LEFT, ROUGH_LEFT, BEND_LEFT))
    drawn_in = 0.5 * np.square(levels) * (np.minimum(np.square(bend * spacing), 1.0) - bent)
    return Restored((FLATTENED + FLATTENED_BY_NOISE * levels) * (rough - left), drawn_in, -area)
