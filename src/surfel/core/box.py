"""The box round points, with its sides along the axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_TOGETHER = 64


def corners(points: NDArray[Any]) -> NDArray[Any]:
    """Return the lowest and the highest corner, shape (2, k), of the box round (n, k) points.

    Many rows at a time, laid end to end: numpy reduces the long axis of a narrow table many times slower.

    Parameters
    ----------
    points : NDArray, shape (n, k)
        At least one point; a coordinate that is NaN somewhere gives NaN.

    Examples
    --------
    >>> corners(np.array([[0.0, 5.0], [2.0, 1.0]])).tolist()
    [[0.0, 1.0], [2.0, 5.0]]
    """
    n, k = points.shape
    whole = n - n % _TOGETHER
    found = []
    for least in (np.minimum, np.maximum):
        rest = points[whole:]
        if whole:
            wide = least.reduce(points[:whole].reshape(whole // _TOGETHER, _TOGETHER * k), axis=0)
            rest = np.concatenate([wide.reshape(_TOGETHER, k), rest])
        found.append([least.reduce(column) for column in rest.T])
    return np.array(found, points.dtype)
