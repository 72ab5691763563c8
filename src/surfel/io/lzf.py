"""LZF, the compression of binary PCD: unpacked strictly, within the bytes that are there.

The format of M. Lehmann's LibLZF: a control byte c < 32 is followed by c + 1 literal bytes; otherwise a copy of
(c >> 5) + 2 bytes (for 7, of one more byte's value besides) from ((c & 31) << 8) + the next byte + 1 bytes back.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import kernel
from surfel.io.source import Bytes


def unpack(data: Bytes, size: int) -> Bytes | None:
    """Return the ``size`` bytes that were packed, or None where the data are damaged or are not of that size.

    The data are walked through once before, so that nothing is allocated for a size that they do not have.
    """
    if _walk(data, np.empty(0, np.uint8), False) != size:
        return None
    out = np.empty(size, np.uint8)
    _walk(data, out, True)
    return out


@kernel
def _walk(data, out, keep):
    """Walk through the data; return the size that they unpack to, or -1 where they are damaged."""
    p, q, stop = 0, 0, len(data)
    while p < stop:
        c = np.int64(data[p])
        p += 1
        if c < 32:
            c += 1
            if p + c > stop:
                return -1
            if keep:
                for i in range(c):
                    out[q + i] = data[p + i]
            p += c
            q += c
            continue
        length = c >> 5
        if length == 7:
            if p >= stop:
                return -1
            length += np.int64(data[p])
            p += 1
        if p >= stop:
            return -1
        back = ((c & 31) << 8) + np.int64(data[p]) + 1
        p += 1
        length += 2
        if back > q:
            return -1
        if keep:
            for i in range(length):  # byte after byte: a copy may reach into itself
                out[q + i] = out[q - back + i]
        q += length
    return q
