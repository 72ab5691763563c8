"""Palette: calm colors for what has none of its own, one a leaf."""

from __future__ import annotations

_COLORS = (
    (214, 196, 168),  # sand
    (124, 156, 184),  # slate blue
    (196, 122, 98),  # clay
    (138, 166, 128),  # sage
    (216, 176, 96),  # ochre
    (150, 130, 168),  # lavender
    (110, 160, 156),  # teal
    (190, 148, 150),  # rose
)


def leaf_color(leaf: int) -> tuple[int, int, int]:
    """Return the color of a leaf, red, green and blue of 0 to 255; after eight they come again.

    Examples
    --------
    >>> from surfel.rendering.palette import leaf_color
    >>> leaf_color(0)
    (214, 196, 168)
    """
    return _COLORS[leaf % len(_COLORS)]
