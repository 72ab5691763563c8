"""Both ways: two clouds, each told by the other which of its surfels lie where, at the same time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats
from surfel.core.together import together
from surfel.inside.classes import Classes
from surfel.inside.classify import Classifier
from surfel.inside.moved import rigid
from surfel.inside.operand import Operand


def both_ways(one: Classifier, other: Classifier, pose: ArrayLike | None = None) -> tuple[Classes, Classes]:
    """Classify the surfels of two clouds, each by the other.

    Parameters
    ----------
    one, other : Classifier
        The clouds.
    pose : array_like, shape (4, 4), optional
        A rigid motion that takes the other cloud to where it lies in the coordinates of the first.

    Returns
    -------
    of_other, of_one : Classes
        Where the surfels of the other cloud lie in the first one, and those of the first in the other; in sorted order.

    Raises
    ------
    InputError
        If the pose is not rigid.
    """
    there = rigid(pose)
    back = np.eye(4)
    back[:3, :3] = there[:3, :3].T
    back[:3, 3] = -there[:3, :3].T @ there[:3, 3]

    def classify(way: tuple[Classifier, Operand, Floats]) -> Classes:
        classifier, operand, motion = way
        return classifier.classify(operand, pose=motion)

    ways = [(one, other.operand, there), (other, one.operand, back)]
    of_other, of_one = together(classify, ways, [len(way[1]) for way in ways])
    return of_other, of_one
