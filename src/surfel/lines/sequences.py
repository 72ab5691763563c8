"""Points of the unit cube in blocks: any block of any sequence is made on its own, wherever it is needed."""

from __future__ import annotations

import copy
import math
import warnings
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import kernel, rows, threads_for
from surfel.core.cast import Floats, as_choice, as_count, as_vector
from surfel.core.errors import InputError
from surfel.lines.niederreiter import MOST_DIMENSIONS, niederreiter

SEQUENCES = ("niederreiter", "r4", "sobol", "halton", "random")

Sequence: TypeAlias = Any
"""One of :data:`SEQUENCES`, or an instance of :class:`scipy.stats.qmc.QMCEngine`."""

_NIEDERREITER_SKIP = 2**32
_RANDOM_KEY = 0x5EEDED_11E5


def unit_points(
    sequence: Sequence, start: int, count: int, dimension: int = 4, shift: ArrayLike | None = None
) -> Floats:
    """Return points ``start`` to ``start + count - 1`` of a sequence in the unit cube.

    Blocks fit together: the points of (0, 8) are those of (0, 4) followed by those of (4, 4), bit for bit.

    Parameters
    ----------
    sequence : str or scipy.stats.qmc.QMCEngine
        - "niederreiter": base 2, see :func:`surfel.lines.niederreiter.niederreiter`. It starts at index 2^32. Bratley,
          Fox and Niederreiter advise to skip the first points, which crowd near the origin; because a multiple of
          2^32 is skipped, every aligned run of 2^m points up to m = 32 remains a net, which their 2^12 would not keep.
        - "r4": the Kronecker sequence frac(1/2 + n a), a_k = phi^-k, phi the root of phi^(s + 1) = phi + 1 (the
          generalised golden ratio), in any dimension s. The products are exact modulo 2^64, so that late points are
          as exact as early ones.
        - "sobol", "halton": SciPy's engines, not scrambled. Sobol' walks to ``start`` in time linear in it.
        - "random": pseudo-random numbers of numpy's counter-based Philox generator with a fixed key.
        - An engine of SciPy: it is copied, reset and moved forward, and itself left as it was. Engines whose points
          depend on how many are asked for at once (Latin hypercubes, Poisson disks) give another set for each block.
    start, count : int
        Which points; both 0 or more.
    dimension : int
        How many coordinates; an engine must have the same.
    shift : array_like, shape (dimension,), optional
        Added to every point, modulo 1 (Cranley and Patterson); see :func:`shifts`.

    Returns
    -------
    Floats, shape (count, dimension)
        In [0, 1).

    Raises
    ------
    InputError
        If the sequence is unknown, a number out of its range or the shift of another size.

    Examples
    --------
    >>> from surfel.lines.sequences import unit_points
    >>> unit_points("r4", 0, 2, dimension=1).round(4).tolist()
    [[0.118], [0.7361]]
    """
    first = as_count(start, "start", 0)
    number = as_count(count, "count", 0)
    size = as_count(dimension, "dimension", 1)
    points = _points(sequence, first, number, size)
    if shift is not None:
        by = as_vector(shift, "shift", size) % 1.0
        _shift(points, np.where(by < 1.0, by, 0.0))  # the rest of a tiny negative number rounds to 1
    return points


def shifted_points(
    sequence: Sequence, start: int, count: int, dimension: int, shift: ArrayLike | None = None
) -> Floats:
    """Return a run of points as :func:`unit_points` does, or one after the other with each of several shifts.

    Parameters
    ----------
    sequence, start, count, dimension
        As there; the run is made once.
    shift : array_like, shape (dimension,) or (s, dimension), optional
        One shift, or s of them.

    Returns
    -------
    Floats, shape (count, dimension) or (s * count, dimension)
        In [0, 1).

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.lines.sequences import shifted_points
    >>> shifted_points("r4", 0, 2, 1, np.array([[0.0], [0.5]])).round(4).ravel().tolist()
    [0.118, 0.7361, 0.618, 0.2361]
    """
    if shift is None or np.ndim(shift) < 2:
        return unit_points(sequence, start, count, dimension, shift)
    every = np.asarray(shift, np.float64)
    points = unit_points(sequence, start, count, dimension)
    found = np.empty((len(every) * len(points), dimension))
    with threads_for(len(found)):
        _shift_all(len(found), points, every, found)
    return found


def shifts(seed: int, number: int, dimension: int = 4) -> Floats:
    """Return random shifts of the unit cube: one estimate with each gives independent, unbiased estimates.

    Cranley and Patterson, *Randomization of number theoretic methods for multiple integration*, SIAM J. Numer. Anal.
    13(6), 1976.

    Parameters
    ----------
    seed : int
        0 or more. The first rows do not depend on ``number``.
    number : int
        How many shifts; 16 give intervals that hold what they promise, 8 do not always.
    dimension : int
        The dimension of the points that are shifted.

    Returns
    -------
    Floats, shape (number, dimension)
        Uniform in [0, 1).

    Raises
    ------
    InputError
        If a number is not a whole one or too small.

    Examples
    --------
    >>> from surfel.lines.sequences import shifts
    >>> shifts(seed=0, number=16).shape
    (16, 4)
    """
    source = np.random.SeedSequence(as_count(seed, "seed", 0))
    generator = np.random.Generator(np.random.PCG64(source))
    return generator.random((as_count(number, "number"), as_count(dimension, "dimension")))


def from_shifts(values: ArrayLike) -> tuple[Any, Any, float]:
    """Return the mean of one estimate for each shift, its standard error and the error's degrees of freedom.

    Parameters
    ----------
    values : array_like, shape (shifts, ...)
        One estimate (a number or an array) for each shift.

    Returns
    -------
    mean, standard_error : float or Floats, shape (...)
        Added in the order of the shifts. The error is infinite for a single shift.
    freedom : float
        shifts - 1: Student's distribution with so many degrees of freedom gives the interval.

    Raises
    ------
    InputError
        If there is no estimate.

    Examples
    --------
    >>> from surfel.lines.sequences import from_shifts
    >>> from_shifts([1.0, 2.0, 3.0])[0]
    2.0
    """
    estimates = np.asarray(values, dtype=np.float64)
    if estimates.ndim == 0 or len(estimates) == 0:
        raise InputError(f"values must hold one estimate for each shift; got shape {estimates.shape}")
    number = len(estimates)
    total = np.zeros(estimates.shape[1:])
    for estimate in estimates:
        total = total + estimate
    mean = total / number
    squares = np.zeros_like(total)
    for estimate in estimates:
        squares = squares + (estimate - mean) ** 2
    freedom = number - 1
    error = np.sqrt(squares / (number * freedom)) if freedom else np.full(total.shape, math.inf)
    return (float(mean), float(error), float(freedom)) if total.ndim == 0 else (mean, error, float(freedom))


def _points(sequence: Sequence, start: int, count: int, dimension: int) -> Floats:
    if not isinstance(sequence, str):
        return _from_engine(_as_engine(sequence, dimension), start, count)
    name = as_choice(sequence, "sequence", SEQUENCES)
    if name == "niederreiter":
        as_count(dimension, "dimension", 1, MOST_DIMENSIONS)
        return niederreiter(count, dimension, _NIEDERREITER_SKIP + start)
    if name == "r4":
        return _kronecker(start, count, dimension)
    if name == "random":
        return _random(start, count, dimension)
    from surfel.lines.engines import engine_named

    return _from_engine(engine_named(name, dimension), start, count)


def _kronecker(start: int, count: int, dimension: int) -> Floats:
    """Return frac(1/2 + (n + 1) a) in 64-bit fixed point, where overflow is the reduction modulo 1."""
    steps = _golden_steps(dimension)
    index = np.arange(count, dtype=np.uint64) + np.uint64((start + 1) % 2**64)
    fixed = index[:, None] * steps[None, :]
    fixed += np.uint64(2**63)
    fixed >>= np.uint64(11)
    points = fixed.astype(np.float64)
    points *= 2.0**-53
    return points


@cache
def _golden_steps(dimension: int) -> NDArray[np.uint64]:
    """Return phi^-1 ... phi^-s times 2^64, rounded; phi by bisection in fixed point of 128 bits."""
    bits = 128
    low, high = 1 << bits, 2 << bits
    while high - low > 1:
        middle = (low + high) // 2
        power = middle
        for _ in range(dimension):
            power = power * middle >> bits
        low, high = (middle, high) if power < middle + (1 << bits) else (low, middle)
    steps = []
    inverse = 1 << bits
    for _ in range(dimension):
        inverse = (inverse << bits) // low
        steps.append(((inverse >> (bits - 65)) + 1) >> 1)
    return np.array(steps, dtype=np.uint64)


def _random(start: int, count: int, dimension: int) -> Floats:
    """Return a block of Philox's stream: its counter moves on by one for each four numbers."""
    blocks, rest = divmod(start * dimension, 4)
    source = np.random.Philox(key=_RANDOM_KEY, counter=blocks)
    return np.random.Generator(source).random(rest + count * dimension)[rest:].reshape(count, dimension)


def _as_engine(value: Any, dimension: int) -> Any:
    from surfel.lines.engines import is_engine

    if not is_engine(value):
        raise InputError(
            f"sequence must be one of {', '.join(SEQUENCES)} or an engine of scipy.stats.qmc; got {value!r}"
        )
    if value.d != dimension:
        raise InputError(f"the engine must have dimension {dimension}; got one of dimension {value.d}")
    return copy.deepcopy(value).reset()


def _from_engine(engine: Any, start: int, count: int) -> Floats:
    if count == 0:
        return np.empty((0, engine.d))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The balance properties")
        if start > 0:
            engine.fast_forward(start)
        return np.array(engine.random(count), dtype=np.float64, order="C")


@kernel
def _shift(points, shift):
    """Add the shift modulo 1, in place."""
    for i in range(points.shape[0]):
        for d in range(points.shape[1]):
            x = points[i, d] + shift[d]
            points[i, d] = x - 1.0 if x >= 1.0 else x


@rows
def _shift_all(first, last, points, shifts, found):
    """Write the points with each shift in turn, modulo 1; shifts are in [0, 1)."""
    for i in range(first, last):
        which, point = i // len(points), i % len(points)
        for d in range(points.shape[1]):
            x = points[point, d] + shifts[which, d]
            found[i, d] = x - 1.0 if x >= 1.0 else x
