"""``surfel info`` and ``surfel convert``: what a file holds, and the same in another format."""

from __future__ import annotations

from typing import Annotated

import typer

from surfel.cli.options import AsJson, Quiet, ReadAs, as_form


def info(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A cloud or a mesh.")],
    full: Annotated[
        bool, typer.Option("--full", help="Read everything: also spacing, duplicates and non-finite points.")
    ] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Tell what a file holds; from its header alone where that is enough."""
    import surfel
    from surfel.cli.output import Output, shown

    with Output(as_json, quiet) as output:
        facts = surfel.info(file, full=full)
        output.facts(facts, shown(file))


def convert(
    source: Annotated[str, typer.Argument(metavar="IN", help="The file to read.")],
    target: Annotated[str, typer.Argument(metavar="OUT", help="The file to write; its suffix tells the format.")],
    as_: ReadAs = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Write a file in another format, and list what that format cannot hold."""
    import surfel
    from surfel.cli.output import Output, shown

    form = as_form(as_)
    with Output(as_json, quiet) as output:
        report = surfel.convert(source, target, as_=form)
        output.facts(report, f"{shown(source)} -> {shown(target)}")
