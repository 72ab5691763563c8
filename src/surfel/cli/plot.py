"""``surfel measure --plot``: the surface's elements, how their areas spread, and the intervals of the result."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from surfel.cli.output import shown

if TYPE_CHECKING:
    from surfel.core.patches import Patches
    from surfel.measuring.measurement import Measurement
    from surfel.shapes.base import Shape

_DOTS = 40_000
_PICTURE = 230.0  # typographic points across
_SEEN_FROM = (0.5, -0.75, 0.6)
_LIT_FROM = (-0.15, -0.6, 0.8)


def draw_measurement(shape: Shape, result: Measurement, file: str, units: str, target: str) -> None:
    """Write the picture as PNG; the target is replaced at once or left as it was.

    Parameters
    ----------
    shape : Shape
        What was measured.
    result : Measurement
        What came out.
    file, units : str
        Labels.
    target : str
        The PNG file.
    """
    from surfel.core.figure import new_figure
    from surfel.io.atomic import replacing
    from surfel.measuring.figures import draw_intervals
    from surfel.shapes.surfels import Surfels

    figure = new_figure(13.0, 4.2)
    patches = shape.patches(_DOTS)
    if isinstance(shape, Surfels):  # the elements of a mesh are samples that we chose, and all of one size
        picture, spread, intervals = figure.subplots(1, 3)
        _draw_areas(spread, patches)
    else:
        picture, intervals = figure.subplots(1, 2)
    _draw_surface(picture, patches)
    draw_intervals(intervals, result, units)
    figure.suptitle(shown(file), fontsize=10, parse_math=False)
    with replacing(target) as beside:
        figure.savefig(beside, format="png", dpi=110)


def _draw_surface(axes: Any, patches: Patches) -> None:
    """Draw the elements from far away as lit disks of their own sizes, the nearest last."""
    import numpy as np

    chosen = np.linspace(0, len(patches) - 1, min(len(patches), _DOTS)).astype(np.int64)
    eye, light = (np.array(v) / math.hypot(*v) for v in (_SEEN_FROM, _LIT_FROM))
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    seen = patches.points[chosen] @ np.column_stack([right, np.cross(eye, right), eye])
    seen, order = seen - seen.min(axis=0), np.argsort(seen[:, 2], kind="stable")
    scale = _PICTURE / max(float(seen[:, :2].max()), 1e-300)  # typographic points to a unit of length
    covering = 2.0 * len(patches) / len(chosen) * np.maximum(patches.areas[chosen], 0.0)
    brightness = 0.2 + 0.75 * np.abs(patches.normals[chosen] @ light)
    sizes = 4.0 / math.pi * covering * scale * scale
    axes.scatter(
        seen[order, 0] * scale,
        seen[order, 1] * scale,
        s=sizes[order],
        c=brightness[order],
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        lw=0,
    )
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"{len(chosen):,} of {len(patches):,} elements", fontsize=9)


def _draw_areas(axes: Any, patches: Patches) -> None:
    """Draw the histogram of the elements' areas over their mean; those without an area are counted in the title."""
    import numpy as np

    some = patches.areas[patches.areas > 0.0]
    without = len(patches) - len(some)
    if len(some):
        axes.hist(some / some.mean(), bins=np.linspace(0.0, 4.0, 61), color="0.45")
    axes.set_xlabel("area of an element / mean", fontsize=8)
    axes.set_ylabel("elements", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_title("how their areas spread" + (f"; {without:,} have none" if without else ""), fontsize=9)
