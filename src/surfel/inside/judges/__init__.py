"""The judges: eight ways to tell whether a place lies inside a cloud, one file each, one signature for all.

Every judge is ``judge(cloud, queries, **parameters) -> Verdict``. They are loaded when they are asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from surfel.core.cast import as_choice

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from surfel.inside.holder import HasOperand
    from surfel.inside.judges.choice import Choice
    from surfel.inside.judges.verdict import Verdict
    from surfel.inside.operand import Operand

NAMES = ("brute", "nearest", "two-nearest", "mls", "two-cluster", "imls", "winding", "indicator")
"""What the judges are called; ``auto`` stands for what :func:`choose` finds."""


class Judge(Protocol):
    """What every judge is."""

    def __call__(self, cloud: Operand | HasOperand, queries: ArrayLike, **parameters: Any) -> Verdict:
        """Judge places, given in the coordinates of the cloud, shape (q, 3)."""
        ...


def named(name: str) -> Judge:
    """Return a judge by its name.

    Raises
    ------
    InputError
        If no judge has that name.

    Examples
    --------
    >>> import numpy as np
    >>> from surfel.inside.judges import named
    >>> from surfel.inside.operand import Operand
    >>> p = np.random.default_rng(0).standard_normal((500, 3))
    >>> p /= np.linalg.norm(p, axis=1, keepdims=True)
    >>> named("two-nearest")(Operand.of(p, p), [[0.0, 0.0, 0.5], [0.0, 0.0, 1.5]]).inside.tolist()
    [True, False]
    """
    known = as_choice(name, "judge", NAMES)
    judge: Judge = import_module(f"{__name__}.{known.replace('-', '_')}").judge
    return judge


def choose(cloud: Operand | HasOperand) -> Choice:
    """Return the name of the judge that suits a cloud, and why; see :mod:`surfel.inside.judges.choice`."""
    from surfel.inside.judges import choice

    return choice.choose(cloud)
