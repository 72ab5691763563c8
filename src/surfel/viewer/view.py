"""view(): solids in the browser, to be moved by hand."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

from surfel.core.cast import as_count
from surfel.viewer.stage import Stage
from surfel.viewer.viewer import Viewer


def view(
    shapes: Any,
    *,
    names: Sequence[str] = (),
    host: str = "127.0.0.1",
    port: int = 8080,
    draw: str = "auto",
    up: str = "z",
    browser: bool = False,
) -> Viewer:
    """Show shapes on a page in the browser, where they can be moved.

    Every operand has handles that move and turn it, and every operation can be switched. The Boolean result follows a
    drag live, by the centres of its surfels, and is exact on release; area and volume with their errors follow. The
    page needs nothing but this computer.

    Parameters
    ----------
    shapes : Shape or iterable of Shape
        A tree, of which every leaf can be moved; a leaf; or several of these, joined by unions at first.
    names : sequence of str
        What the leaves are called, from left to right; by default, and where empty, by their kind.
    host : str
        Which address to listen on. Whoever can reach it can use the page; by default this computer alone.
    port : int
        Where; the next free port where that one is taken.
    draw : {"auto", "browser", "server"}
        Who draws the solids. By default every browser draws its own, but one without a graphics card gets finished
        pictures; there is a box on the page to change that.
    up : {"z", "y", "x"}
        Which axis points up.
    browser : bool
        Open the page in the browser.

    Returns
    -------
    Viewer
        ``url`` is where the page is; ``wait()`` serves it until interrupted, ``close()`` ends it, ``tree()`` is what
        is on the screen, ``script()`` the Python that makes it.

    Raises
    ------
    InputError
        If something is no shape, nobody can listen there, or an argument is none of those named.
    MissingExtraError
        If viser is not installed: ``pip install "surfel[view]"``.

    Examples
    --------
    >>> import surfel
    >>> with surfel.view(surfel.Box(2) - surfel.Sphere(1.2)) as viewer:  # doctest: +SKIP
    ...     viewer.wait()
    """
    viewer = Viewer(Stage(shapes, names), host, as_count(port, "port", 0, 65535), draw, up)
    if browser:
        import webbrowser

        webbrowser.open(viewer.url)
    return viewer


def write_html(shapes: Any, path: str | PathLike[str], *, names: Sequence[str] = (), up: str = "z") -> None:
    """Write shapes as one HTML page that needs neither a server nor a network; it can be turned, not changed.

    Parameters
    ----------
    shapes : Shape or iterable of Shape
        As of :func:`view`.
    path : path
        The file to write; replaced as a whole.
    names, up
        As of :func:`view`.

    Raises
    ------
    InputError
        If something is no shape.
    MissingExtraError
        If viser is not installed.
    """
    from surfel.io.atomic import replacing

    viewer = Viewer(Stage(shapes, names), "127.0.0.1", 0, up=up)
    try:
        text = viewer.html()
    finally:
        viewer.close()
    with replacing(path) as file:
        file.write(text.encode())
