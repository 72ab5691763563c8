"""Findings: what was found out about the clouds of a tree, and what to warn of."""

from __future__ import annotations

from typing import NamedTuple

from surfel.booleans.leaf import CloudLeaf
from surfel.inside.classify import Classifier

FEW = 50
"""Surfels below which a cloud hardly shows what lies inside it."""


class Findings(NamedTuple):
    """What a combination says of its operands.

    Parameters
    ----------
    leaky : bool
        Whether the space of a cloud leaks.
    conflict : float
        The largest of theirs.
    warnings : tuple of str
        What the user should know.
    judges : tuple
        Of each leaf the name of the judge and the reason; None where no judge was asked.
    """

    leaky: bool
    conflict: float
    warnings: tuple[str, ...]
    judges: tuple[tuple[str, str] | None, ...]


def findings_of(asked: dict[int, CloudLeaf], count: int) -> Findings:
    """Return what was found out about those of ``count`` leaves that somebody asked for their inside."""
    judges: list[tuple[str, str] | None] = [None] * count
    warnings: list[str] = []
    for k, leaf in asked.items():
        space = leaf.classifier
        judges[k] = (space.decision.judge, space.decision.reason)
        warnings += _warnings(k, space)
    spaces = [leaf.classifier for leaf in asked.values()]
    conflict = max((space.conflict for space in spaces), default=0.0)
    return Findings(any(space.leaky for space in spaces), conflict, tuple(warnings), tuple(judges))


def _warnings(k: int, space: Classifier) -> list[str]:
    found = []
    turned = float(space.flipped.mean()) if len(space.flipped) else 0.0
    if turned > 0.0:
        found.append(f"operand {k}: {turned:.1%} of the normals faced the wrong way and were turned")
    if len(space.operand) < FEW:
        found.append(f"operand {k} has {len(space.operand)} surfels, too few to show what lies inside: that is a guess")
    strays = int(space.operand.strays.sum())
    if strays:
        found.append(
            f"operand {k}: {strays} of its surfels lie far off the surface that the others show; they have no say in "
            "what is inside"
        )
    if space.leaky:
        found.append(
            f"operand {k} is open: inside and outside hang together through holes, and {space.conflict:.1%} of "
            "its surface lies beside them or contradicts them; near its holes the result is a guess"
        )
    return found
