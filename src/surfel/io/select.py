"""The options of reading, applied to what was read: the one way for every format that has none of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.errors import InputError
from surfel.io.content import Content
from surfel.io.options import WHOLE_TREE, Options

CLASSES = "classification"


def chosen(content: Content, options: Options, first: int = 0) -> Content:
    """Return the wanted rows of one run of points.

    Parameters
    ----------
    content : Content
        Points, without triangles.
    options : Options
        ``every``, ``bounds`` and ``classes``, applied in this order.
    first : int
        The number that the first row of ``content`` has in the file.

    Raises
    ------
    InputError
        If classes are wanted and there are none, or a level of detail is.
    """
    if not options.asked:
        return content
    refuse_levels(options)
    if options.every > 1:
        content = content.rows(slice(-first % options.every, None, options.every))
    keep: NDArray[np.bool_] | None = None
    if options.bounds is not None:
        low, high = options.bounds
        keep = np.asarray(((content.points >= low) & (content.points <= high)).all(axis=1))
    if options.classes is not None:
        wanted = np.isin(_classes_of(content), sorted(options.classes))
        keep = wanted if keep is None else keep & wanted
    return content if keep is None else content.rows(keep)


def faces_chosen(content: Content, options: Options) -> Content:
    """Return the wanted part of a mesh: the triangles whose three corners lie in the box.

    Raises
    ------
    InputError
        If points are to be thinned or told by class, which would tear the mesh.
    """
    refuse_levels(options)
    torn = sorted(options.asked & {"every", "classes"})
    if torn:
        raise InputError(f"{' and '.join(torn)} would tear the mesh; read its vertices alone by as_='points'")
    if options.bounds is None or content.triangles is None:
        return content
    low, high = options.bounds
    inside = ((content.points >= low) & (content.points <= high)).all(axis=1)
    return content.with_points(np.asarray(inside))[0]


def refuse_levels(options: Options) -> None:
    """Refuse options that only a file with levels of detail can answer."""
    levels = sorted(options.asked & WHOLE_TREE)
    if levels:
        raise InputError(f"{levels[0]} needs a file with levels of detail (COPC); thin this one by every=")


def _classes_of(content: Content) -> NDArray[Any]:
    name = next((name for name in content.attributes if name.lower() == CLASSES), None)
    if name is None:
        held = ", ".join(content.attributes) or "none"
        raise InputError(
            f"classes were asked for, but the file has no attribute {CLASSES!r} (it has: {held}); leave classes out"
        )
    return content.attributes[name]
