"""Memory: large arrays of a picture, which take over the memory of pictures that are gone.

Fresh memory comes page by page from the system, which clears each page at its first touch: of a picture of a million
pixels that is a sixth of its time. So what a picture leaves behind is kept for the next one of the same size.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_LARGE, _HUGE = 1 << 19, 1 << 26  # bytes: smaller arrays numpy keeps itself, and larger ones are not to be kept at all
_KEPT = 3  # pieces of a size
_SIZES = 12

_free: dict[int, deque[NDArray[np.uint8]]] = {}


def room(shape: int | tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array that holds anything; its memory is used again when the last view of it is gone."""
    size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * np.dtype(dtype).itemsize
    if not _LARGE <= size <= _HUGE:
        return np.empty(shape, dtype)
    try:
        block = _free[size].pop()
    except (KeyError, IndexError):
        block = np.empty(size, np.uint8)
    # what all views refer to, and what dies with the last of them
    owner = (ctypes.c_byte * size).from_buffer(block.data)
    weakref.finalize(owner, _given_back, block).atexit = False
    return np.frombuffer(memoryview(owner), dtype).reshape(shape)


def _given_back(block: NDArray[np.uint8]) -> None:
    """Keep a piece of memory; without a lock, for it may be called wherever Python collects what is gone."""
    if block.nbytes not in _free and len(_free) >= _SIZES:
        _free.clear()
    _free.setdefault(block.nbytes, deque(maxlen=_KEPT)).append(block)
