"""A parallel radix sort of non-negative integers: the same result on any number of threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surfel._numba import kernel, rows, threads_for

_DIGIT_BITS = 12  # 4096 counters a thread stay in the first cache, their write streams in the second


def index_bits(items: int) -> int:
    """Return how many low bits of a packed key hold the numbers 0 to ``items - 1``."""
    return max(1, int(items - 1).bit_length())


def sort_packed(packed: NDArray[np.int64], low: int, bits: int) -> NDArray[np.int64]:
    """Sort integers by the ``bits`` bits above their ``low`` lowest, keeping the order of equal ones.

    A key that is packed above the row number, ``key << low | row``, is sorted with the row in one array: half of the
    memory traffic of a sort of pairs, and equal keys end in the order of their rows.

    Parameters
    ----------
    packed : NDArray[np.int64], shape (n,)
        Non-negative; used as scratch, its contents are lost.
    low : int
        How many of the lowest bits do not take part.
    bits : int
        How many bits do.

    Returns
    -------
    NDArray[np.int64], shape (n,)
        The sorted integers.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.index.radix import sort_packed
    >>> keys = np.array([5, 1, 5, 0])
    >>> (sort_packed(keys << 2 | np.arange(4), low=2, bits=3) & 3).tolist()
    [3, 1, 0, 2]
    """
    passes = max(1, -(-bits // _DIGIT_BITS))
    digit = -(-bits // passes)
    target = np.empty_like(packed)
    with threads_for(len(packed)) as threads:
        slots = np.empty((threads, 1 << digit), np.int64)
        for shift in range(low, low + passes * digit, digit):
            _count_digits(threads, packed, shift, slots)
            _start_buckets(slots)
            _move(threads, packed, shift, slots, target)
            packed, target = target, packed
    return packed


@rows
def _count_digits(first, last, packed, shift, slots):
    chunks, buckets = slots.shape
    n = len(packed)
    for chunk in range(first, last):
        own = slots[chunk]
        own[:] = 0
        for i in range(n * chunk // chunks, n * (chunk + 1) // chunks):
            own[np.uint64((packed[i] >> shift) & (buckets - 1))] += 1


@kernel
def _start_buckets(slots):
    """Turn counts into first places: by bucket, and by chunk within a bucket, which keeps the sort stable."""
    start = 0
    for bucket in range(slots.shape[1]):
        for chunk in range(slots.shape[0]):
            count = slots[chunk, bucket]
            slots[chunk, bucket] = start
            start += count


@rows
def _move(first, last, packed, shift, slots, target):
    chunks, buckets = slots.shape
    n = len(packed)
    for chunk in range(first, last):
        own = slots[chunk]
        for i in range(n * chunk // chunks, n * (chunk + 1) // chunks):
            value = packed[i]
            bucket = np.uint64((value >> shift) & (buckets - 1))
            place = own[bucket]
            own[bucket] = place + 1
            target[np.uint64(place)] = value
