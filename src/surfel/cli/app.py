"""The commands by name; each imports what it needs when it runs, so that ``surfel --help`` is quick."""

from __future__ import annotations

from typing import Annotated

import typer

from surfel.cli.bound import bound
from surfel.cli.combine import combine
from surfel.cli.demo import demo
from surfel.cli.files import convert, info
from surfel.cli.measure import measure
from surfel.cli.render import render
from surfel.cli.sampling import sample
from surfel.cli.view import view

app = typer.Typer(
    name="surfel",
    help="Measure solids straight from their points: value +- error, and no meshing.",
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(measure)
app.command()(combine)
app.command()(bound)
app.command()(render)
app.command()(info)
app.command()(convert)
app.command()(sample)
app.command()(view)
app.command()(demo)


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """Measure solids straight from their points: value +- error, and no meshing."""
    if version:
        from surfel import __version__

        typer.echo(f"surfel {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
