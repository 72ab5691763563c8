"""Asking a cloud what lies inside it, in the pose in which that was learnt."""

from __future__ import annotations

import numpy as np

from surfel.core.cast import Floats
from surfel.inside.classes import Classes
from surfel.inside.operand import Operand
from surfel.shapes.surfels import Surfels

_UNMOVED = np.eye(4)


def asked(
    cloud: Surfels,
    queries: Floats | Operand,
    normals: Floats | None = None,
    pose: Floats = _UNMOVED,
    reach: float = 0.0,
) -> Classes:
    """Ask what lies inside a cloud, in the coordinates of the one that it was before it was turned and shifted.

    Parameters
    ----------
    cloud : Surfels
        Which is asked.
    queries, normals, reach
        As of its classifier.
    pose : Floats, shape (4, 4)
        From the queries to the world.
    """
    rest, motion = cloud._at_rest
    return rest.classifier.classify(queries, normals, np.linalg.inv(motion) @ pose, reach)
