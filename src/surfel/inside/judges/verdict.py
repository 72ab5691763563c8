"""Verdict: what a judge says about each place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surfel.core.cast import Booleans, Floats


class Verdict(NamedTuple):
    """What a judge says about each of q places.

    Parameters
    ----------
    inside : Booleans, shape (q,)
        Whether the place is inside the solid that the cloud bounds; a place on the surface is not.
    value : Floats, shape (q,)
        Negative inside. A signed distance in units of length for judges that look at neighbours (at least in sign;
        of places that were settled together with others, a lower bound), and a pure number round zero, of the size
        of 1/2 away from the surface, for the winding number and the indicator.
    certain : Booleans, shape (q,)
        Whether what the judge looked at agrees. Where it does not, another judge may say otherwise.
    """

    inside: Booleans
    value: Floats
    certain: Booleans

    @classmethod
    def of(cls, value: Floats, certain: Booleans) -> Verdict:
        """Return the verdict that values imply."""
        return cls(value < 0.0, value, certain)

    @classmethod
    def outside(cls, count: int) -> Verdict:
        """Return that all places are outside, as they are of an empty cloud."""
        return cls.of(np.full(count, np.inf), np.ones(count, bool))
