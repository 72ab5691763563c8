"""Overlays: scans laid over each other, told by how the points lie.

The points of one scan keep their distance from each other. Where a second scan lies over the first its points fall
anywhere between them. So a cloud of several scans is in good order where one scan sees the surface, and looks random
where two do; no sampling of one kind does both.
"""

from __future__ import annotations

import numpy as np

from surfel.surface.neighbourhoods import Neighbourhoods

RANDOM_BELOW, REGULAR_ABOVE = 0.55, 0.75
"""Mean of nearest distance over spacing, over a neighbourhood: 0.45 to 0.6 where points lie at random, 0.7 to 0.9 where
they keep their distance."""

SHARE = 0.1
"""How much of the cloud must look so, and so."""


def is_overlay(hood: Neighbourhoods) -> bool:
    """Tell whether a tenth of the points lie as scans lie, and another tenth as scans over scans do.

    Scans that cover the same parts throughout, or keep no distance themselves, are not recognised so.
    """
    apart = np.sqrt(hood.squared[:, 0]) / np.where(hood.spacing > 0.0, hood.spacing, 1.0)
    low, high = np.quantile(apart[hood.near].mean(axis=1), [SHARE, 1.0 - SHARE])
    return bool(low < RANDOM_BELOW and high > REGULAR_ABOVE)
