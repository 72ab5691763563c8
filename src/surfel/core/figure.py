"""Figures: matplotlib, which is an extra, is asked for here and nowhere else."""

from __future__ import annotations

from typing import Any


def require_matplotlib() -> None:
    """Raise MissingExtraError unless matplotlib can be imported."""
    from surfel.core.errors import MissingExtraError

    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("matplotlib", "plot") from error


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure that needs no screen; MissingExtraError unless matplotlib can be imported."""
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
