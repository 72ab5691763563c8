"""Niederreiter's sequence as a SciPy engine, and SciPy's engines by name: the only file that imports scipy.stats.qmc.

Importing ``scipy.stats`` costs most of a second, so nothing imports this file before an engine is asked for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import qmc

from surfel.core.cast import Floats, as_count
from surfel.lines.niederreiter import BITS, MOST_DIMENSIONS, niederreiter


class Niederreiter(qmc.QMCEngine):  # type: ignore[misc]
    """Niederreiter's sequence in base 2 wherever SciPy takes an engine.

    Unlike the default of :func:`surfel.lines.sequences.unit_points` it begins at point 0, which is the origin unless
    scrambled, as SciPy's own engines do.

    Parameters
    ----------
    d : int
        Dimension, 1 to 20.
    scramble : bool
        Add (exclusive or) one random number of 53 bits to each coordinate. Such a digital shift keeps every net a net
        and makes each point uniform, so that estimates from independent scramblings are unbiased.
    rng : int, numpy.random.Generator or None
        Where the shift comes from; without one every engine has another.

    Raises
    ------
    InputError
        If ``d`` is not between 1 and 20.

    Examples
    --------
    >>> from surfel.lines.engines import Niederreiter
    >>> Niederreiter(2, scramble=False).fast_forward(2).random(2).tolist()
    [[0.75, 0.25], [0.25, 0.75]]
    """

    def __init__(self, d: int, *, scramble: bool = True, rng: Any = None) -> None:
        super().__init__(d=as_count(d, "d", 1, MOST_DIMENSIONS))
        self.rng = np.random.default_rng(rng)
        self.scramble = scramble
        self._shift = self.rng.integers(0, 2**BITS, self.d, np.int64) if scramble else np.zeros(self.d, np.int64)
        self.rng_seed = self.rng  # what SciPy copies on reset; the sequence itself draws nothing more from it

    def _random(self, n: int = 1, *, workers: int = 1) -> Floats:
        points = niederreiter(n, self.d, self.num_generated)
        if not self.scramble:
            return points
        return np.asarray(((points * 2.0**BITS).astype(np.int64) ^ self._shift) * 2.0**-BITS)

    def reset(self) -> Niederreiter:
        """Go back to point 0 of the same scrambling."""
        self.num_generated = 0
        return self

    def fast_forward(self, n: int) -> Niederreiter:
        """Skip ``n`` points, at no cost."""
        self.num_generated += as_count(n, "n", 0)
        return self


def engine_named(name: str, dimension: int) -> Any:
    """Return SciPy's unscrambled engine called "sobol" or "halton"."""
    if name == "sobol":
        return qmc.Sobol(dimension, scramble=False, bits=32)  # more bits break fast_forward in SciPy 1.17
    return qmc.Halton(dimension, scramble=False)


def is_engine(value: object) -> bool:
    """Return whether ``value`` is one of SciPy's engines."""
    return isinstance(value, qmc.QMCEngine)
