"""What a fit says about itself."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class FitReport:
    """How a safe spline was made and how close it lies.

    Parameters
    ----------
    mode : str
        ``paper``, ``fast`` or ``tight``; ``inserted``, ``removed`` or ``refitted`` where it came from another surface.
    points : int
        How many points it bounds.
    gap_mean, gap_max : float
        Mean and largest distance along the direction from a point to the surface, in the units of the points.
    rounds : int
        Banded solves or interior-point steps; for ``paper`` the most that any line took.
    slack : float
        The largest raise of a coefficient against rounding, in the units of the points.
    dual_bound : float, optional
        In mode ``tight``: no spline of this grid whose coefficients stay within ten ranges of the heights has a
        smaller mean gap, proven by linear-programming duality.
    fallbacks : int
        Lines or rounds for which the plain, always-ending scheme had to step in.
    compression : float
        Numbers in the points over numbers in the coefficients.
    seconds : float
        Time of the fit.
    warnings : tuple of str
        What the result should be read with.
    """

    mode: str
    points: int
    gap_mean: float
    gap_max: float
    rounds: int
    slack: float
    dual_bound: float | None = None
    fallbacks: int = 0
    compression: float = 0.0
    seconds: float = 0.0
    warnings: tuple[str, ...] = field(default=())
