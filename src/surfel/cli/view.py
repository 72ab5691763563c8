"""``surfel view``: solids in the browser, to be moved by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surfel.cli.options import Quiet, ReadAs, as_form
from surfel.cli.seeing import Up, as_axis, read_to_see

if TYPE_CHECKING:
    from surfel.shapes.base import Shape


def view(
    files: Annotated[list[str], typer.Argument(metavar="FILE ...", help="Clouds, meshes, CSG trees, safe surfaces.")],
    as_: ReadAs = None,
    html: Annotated[
        str | None, typer.Option(metavar="OUT", help="Write one page that needs no server, in place of serving one.")
    ] = None,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Which address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(metavar="P", help="Where; the next free port where that one is taken.")] = 8080,
    draw: Annotated[
        str, typer.Option(metavar="auto|browser|server", help="Who draws; auto spares browsers without graphics cards.")
    ] = "auto",
    up: Up = "z",
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    quiet: Quiet = False,
) -> None:
    """Show solids in the browser, where they can be moved and combined; area and volume follow."""
    from surfel.cli.output import Output

    form, up = as_form(as_), as_axis(up)

    import surfel

    with Output(False, quiet) as output:
        with output.work():
            shapes = [read_to_see(file, form) for file in files]
        names = [name for file, shape in zip(files, shapes, strict=True) for name in _names(shape, Path(file).stem)]
        if html is not None:
            from surfel.viewer.view import write_html

            write_html(shapes, html, names=names, up=up)
            output.note(f"wrote {html}")
            return
        viewer = surfel.view(shapes, names=names, host=host, port=port, draw=draw, up=up, browser=open_)
        typer.echo(viewer.url)
        output.note("Ctrl-C ends it")
    viewer.wait()


def _names(shape: Shape, name: str) -> list[str]:
    """Return the name of a file for its shape; the leaves of a tree are called by their kind."""
    from surfel.shapes.tree import Tree

    return [""] * len(shape.leaves) if isinstance(shape, Tree) else [name]
