"""Extremes: sizes and distances that pictures can hold; depths are float32, and so are their squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats
from surfel.core.errors import InputError
from surfel.rendering.camera import Camera

SMALLEST, LARGEST = 1e-15, 1e15
"""Sizes of scenes; single disks are a thousand times smaller or more, and their squares must be float32 numbers."""

_RANGE = f"pictures hold sizes and distances from {SMALLEST:g} to {LARGEST:g}"


def check_boxes(boxes: Sequence[Floats]) -> None:
    """Refuse shapes too large, too far from the origin or too small for a picture; endless sides do not count.

    Parameters
    ----------
    boxes : sequence of Floats, each of shape (2, 3)
        Round each of the shapes.

    Raises
    ------
    InputError
        If a box is of such a size.
    """
    for box in boxes:
        reach = float(np.abs(box[np.isfinite(box)]).max(initial=0.0))
        span = float((0.5 * box[1] - 0.5 * box[0]).max())  # half of it: the whole might overflow
        if reach > LARGEST:
            raise InputError(
                f"the shapes reach {reach:g} from the origin, and {_RANGE}; scale them down, by about {reach:.0e}"
            )
        if reach < SMALLEST and 0.0 < span < np.inf:
            raise InputError(
                f"the shapes span only {2.0 * span:g}, and {_RANGE}; scale them up, by about {1 / span:.0e}"
            )


def check_camera(camera: Camera, middle: ArrayLike) -> None:
    """Refuse a camera too far from what it looks at or from the middle of the scene, or too near to its target.

    Raises
    ------
    InputError
        If a distance is of such a size.
    """
    away = float(np.abs(np.stack([camera.eye, camera.target]) - np.asarray(middle)).max())
    if away > LARGEST:
        raise InputError(
            f"the camera or its target lies {away:g} from the middle of the shapes, and {_RANGE}; move it nearer, or "
            "scale shapes and camera down"
        )
    if camera.distance < SMALLEST:
        raise InputError(
            f"the camera is only {camera.distance:g} from its target, and {_RANGE}; move it away, or scale shapes and "
            "camera up"
        )
