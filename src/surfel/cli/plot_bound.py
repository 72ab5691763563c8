"""``surfel bound --plot``: the surfaces over the points, and slices through both (Myles and Peters, Figs. 11, 12)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from surfel.cli.output import shown

if TYPE_CHECKING:
    from surfel.bounding.spline import SafeSpline
    from surfel.core.cast import Floats


def draw_bound(splines: list[SafeSpline], points: Floats, file: str, target: str) -> None:
    """Write the picture as PNG; the target is replaced at once or left as it was.

    Parameters
    ----------
    splines : list of SafeSpline
        One surface, or the two of a sandwich, over one grid.
    points : Floats, shape (n, 3)
        Some of the points that they bound.
    file, target : str
        The label, and the PNG file.
    """
    from surfel.bounding.figures import SLICES, draw_slice, draw_surfaces
    from surfel.core.figure import new_figure
    from surfel.io.atomic import replacing

    figure = new_figure(13.0, 6.0)
    picture, slices = figure.subfigures(1, 2)
    uv, heights = splines[0].to_domain(points)
    draw_surfaces(picture.add_subplot(projection="3d"), splines, uv, heights)
    for axes, share in zip(slices.subplots(len(SLICES), 1), SLICES, strict=True):
        draw_slice(axes, splines, uv, heights, share)
    figure.suptitle(shown(file), fontsize=10, parse_math=False)
    with replacing(target) as beside:
        figure.savefig(beside, format="png", dpi=110)
