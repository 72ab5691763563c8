"""``surfel info`` and ``surfel convert``: what a file holds, and the same in another format."""

from __future__ import annotations

from typing import Annotated

import typer

from surfel.cli.options import AsJson, Quiet, ReadAs, as_form


def info(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A cloud or a mesh; - is the standard input.")],
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
        with output.work() as progress:
            facts = surfel.info(file, full=full, progress=progress)
        output.facts(facts, shown(file))


def convert(
    source: Annotated[str, typer.Argument(metavar="IN", help="The file to read; - is the standard input.")],
    target: Annotated[
        str, typer.Argument(metavar="OUT", help="The file to write; its suffix tells the format; - is standard output.")
    ],
    as_: ReadAs = None,
    bounds: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option("--bounds", metavar="X Y Z X Y Z", help="Only what lies in this box: its two corners."),
    ] = None,
    every: Annotated[int, typer.Option("--every", metavar="N", help="Only every N-th point of the file.")] = 1,
    classes: Annotated[
        list[int] | None, typer.Option("--class", metavar="C", help="Only points of this class; may come again.")
    ] = None,
    resolution: Annotated[
        float | None, typer.Option("--resolution", metavar="R", help="Of a COPC file, levels down to this spacing.")
    ] = None,
    level: Annotated[
        int | None, typer.Option("--level", metavar="L", help="Of a COPC file, levels down to this one.")
    ] = None,
    to: Annotated[
        str | None, typer.Option("--to", metavar="SUFFIX", help="The format of OUT where its name does not tell.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Write a file in another format, point after point, and list what that format cannot hold."""
    import surfel
    from surfel.cli.output import Output, shown

    form = as_form(as_)
    with Output(as_json, quiet) as output:
        with output.work() as progress:
            report = surfel.convert(
                source,
                target,
                as_=form,
                bounds=None if bounds is None else (bounds[:3], bounds[3:]),
                every=every,
                classes=classes or None,
                resolution=resolution,
                level=level,
                to=to,
                progress=progress,
            )
        if target == "-":  # the points are on the standard output, so the report may not be
            for lost in report["lost"]:
                output.note(f"not kept: {lost}")
            return
        output.facts(report, f"{shown(source)} -> {shown(target)}")
