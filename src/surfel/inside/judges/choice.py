"""The judge that suits a cloud, and why."""

from __future__ import annotations

from typing import NamedTuple

from surfel.inside.holder import HasOperand, as_operand
from surfel.inside.operand import Operand

MANY_FLIPS = 0.1
"""Share of flipped surfels from which on ten neighbours are too often outvoted: every surfel has to be asked."""

SOME_FLIPS = 0.002
"""Share from which on a single surfel is not to be trusted."""

HEAVY_NOISE = 0.5
"""Noise, in spacings, from which on ten neighbours are too few to average it out."""

SOME_NOISE = 0.05
"""Noise from which on the planes of single surfels are worse than a mean."""

EDGES, EDGES_IN_NOISE = 0.02, 0.05
"""Share of surfels near sharp edges from which on there are edges; noise alone makes some."""


class Choice(NamedTuple):
    """The name of a judge, and the reason in words."""

    name: str
    reason: str


def choose(cloud: Operand | HasOperand) -> Choice:
    """Choose the judge that suits a cloud, from its flipped normals, its noise and its edges, in this order.

    A patch whose normals are flipped as a whole contradicts nobody but at its border, and is not seen here; the votes
    of the coloured space find it.

    Parameters
    ----------
    cloud : Operand or Surfels
        The cloud.

    Returns
    -------
    Choice
        ``name, reason``.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges.choice import choose
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((4000, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> choose(Operand.of(p, p))
    Choice(name='two-nearest', reason='smooth: no flipped normals, no noise and no sharp edges to speak of')
    >>> choose(Operand.of(p, p * np.where(np.arange(4000) % 4, 1.0, -1.0)[:, None])).name
    'indicator'
    """
    operand = as_operand(cloud)
    flips, noise, sharp = operand.flips, operand.noise, operand.sharp
    if flips >= MANY_FLIPS:
        return Choice("indicator", f"{flips:.0%} of the normals contradict their neighbours: all surfels are asked")
    if noise >= HEAVY_NOISE:
        return Choice("indicator", f"noise of {noise:.2f} spacings: all surfels are asked")
    if flips >= SOME_FLIPS:
        return Choice("imls", f"{flips:.1%} of the normals contradict their neighbours, which outvote them")
    noisy = noise >= SOME_NOISE
    if sharp >= (EDGES_IN_NOISE if noisy else EDGES):
        return Choice("two-cluster", f"{sharp:.1%} of the surfels lie near sharp edges")
    if noisy:
        return Choice("imls", f"noise of {noise:.2f} spacings, which neighbours average out")
    return Choice("two-nearest", "smooth: no flipped normals, no noise and no sharp edges to speak of")
