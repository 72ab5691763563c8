"""A cloud as the judges of :mod:`surfel.inside` see it: oriented, at the middles of what clips leave."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError
from surfel.inside.operand import Operand

if TYPE_CHECKING:
    from surfel.shapes.surfels import Surfels


def operand_of(cloud: Surfels) -> Operand:
    """Return the operand of a cloud, one row for each surfel.

    Where a clip cuts a surfel off, the judges see it at the middle of what is left, so that nothing hangs over the cut.
    """
    places = cloud.points if cloud.clips is None else cloud.points + cloud.clips.places
    return Operand.of(places, outward_normals(cloud))


def outward_normals(cloud: Surfels) -> Floats:
    """Return the given normals; where none are known, fitted ones with propagated signs."""
    given = cloud.normals
    known = np.zeros(0, bool) if given is None else _known(given)
    if given is not None and known.all():
        return given
    try:
        found = cloud.surface.patches.normals
    except InputError:  # too few points to show a surface
        return np.zeros((len(cloud), 3)) if given is None else given
    return found if given is None else np.where(known[:, None], given, found)


def _known(normals: Floats) -> Booleans:
    """Tell which normals are not zero; column by column, for numpy is slow along short rows."""
    x, y, z = normals.T
    return np.asarray((x != 0.0) | (y != 0.0) | (z != 0.0))
