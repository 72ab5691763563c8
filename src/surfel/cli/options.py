"""The options that several commands share."""

from __future__ import annotations

from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no notes on the standard error.")]
Seed = Annotated[int, typer.Option("--seed", metavar="S", help="The same seed gives the same bits.")]
ReadAs = Annotated[
    str | None,
    typer.Option("--as", metavar="points|mesh", help="Take the file's vertices as a cloud, or its faces as a mesh."),
]


def as_seed(value: int) -> int:
    """Return the seed if numpy can take it."""
    from surfel.core.cast import as_count

    return as_count(value, "--seed", least=0)


def as_form(value: str | None) -> str | None:
    """Return what ``--as`` says, or say what it may say."""
    from surfel.core.cast import as_choice

    return None if value is None else as_choice(value, "--as", ("points", "mesh"))
