"""``surfel combine``: the Boolean result of clouds and solids as a new cloud."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surfel.cli.options import AsJson, Quiet, ReadAs, Seed, as_form, as_seed

if TYPE_CHECKING:
    from surfel.booleans.result import Combination
    from surfel.shapes.base import Shape

OPERATIONS = ("union", "intersection", "difference")
CUTS = ("clip", "split", "none")
KEEP_CLIPS = ("ply", "text", "npz", "pcd", "las", "e57")
"""Formats that keep whatever columns a cloud has, clip planes among them."""


def combine(
    files: Annotated[
        list[str], typer.Argument(metavar="A B ...", help="Clouds, meshes or CSG trees; or one .csg alone.")
    ],
    out: Annotated[str, typer.Option("--output", "-o", metavar="OUT", help="The cloud to write.")],
    op: Annotated[
        str | None,
        typer.Option(
            "--op", metavar="|".join(OPERATIONS), help="What becomes of them; a difference takes the others from A."
        ),
    ] = None,
    cut: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(CUTS),
            help="Surfels at the cut get clip planes, are split into smaller ones, or stay whole; "
            "by default clipped where OUT can keep that, else split.",
        ),
    ] = None,
    judge: Annotated[
        str, typer.Option(metavar="NAME", help="What tells inside from outside of the clouds; auto chooses.")
    ] = "auto",
    level: Annotated[
        int | None, typer.Option(metavar="L", help="With --cut split: how often surfels are halved.")
    ] = None,
    spacing: Annotated[
        float | None, typer.Option(metavar="H", help="Of the surfels of exact solids; by default that of the clouds.")
    ] = None,
    as_: ReadAs = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Combine scans and solids: their union, intersection or difference as a cloud, sharp at the cut."""
    from surfel.cli.output import Output

    form, number = as_form(as_), as_seed(seed)
    way, note = _check(files, out, op, cut, judge)

    import surfel

    with Output(as_json, quiet, measures=True) as output:
        shapes = [surfel.read(file, as_=None if _is_tree(file) else form) for file in files]
        result = surfel.combine(_tree(shapes, op), cut=way, judge=judge, level=level, spacing=spacing, seed=number)
        surfel.write(out, result.surfels)
        data = _facts(result)
        data["warnings"] += [note] if note else []
        output.result(data, lambda: _table(files, out, result, data))


def _check(files: list[str], out: str, op: str | None, cut: str | None, judge: str) -> tuple[str, str]:
    """Refuse what cannot be done before a large file is read; return how to cut, and what to say of it."""
    from surfel.core.cast import as_choice
    from surfel.core.errors import InputError
    from surfel.inside.judges import NAMES
    from surfel.io.registry import format_for_writing

    if len(files) == 1:
        if not _is_tree(files[0]):
            raise InputError(f"combine needs two files or more, or one .csg; got {files[0]!r} alone")
        if op is not None:
            raise InputError("--op belongs to several files; a .csg says itself what becomes of its parts")
    elif op is None:
        raise InputError(f"say with --op what becomes of the files: {', '.join(OPERATIONS)}")
    else:
        as_choice(op, "--op", OPERATIONS)
    as_choice(judge, "--judge", ("auto", "sheets", *NAMES))
    if cut is not None:
        as_choice(cut, "--cut", CUTS)
    if out == "-":
        raise InputError("-o must name a file; the standard output tells of the result")
    target, suffix = format_for_writing(out)
    if "points" not in target.holds:
        raise InputError(f"-o must name a cloud, as .ply or .npz; {target.name} holds no points")
    if target.name in KEEP_CLIPS or cut in ("split", "none"):
        return cut or "clip", ""
    return "split", f"{suffix} keeps no clip planes: surfels at the cut were split into smaller ones"


def _is_tree(file: str) -> bool:
    return Path(file).suffix.lower() == ".csg"


def _tree(shapes: list[Shape], op: str | None) -> Shape:
    """Return the expression."""
    if op == "union":
        return reduce(lambda a, b: a | b, shapes)
    if op == "intersection":
        return reduce(lambda a, b: a & b, shapes)
    return reduce(lambda a, b: a - b, shapes)


def _facts(result: Combination) -> dict[str, Any]:
    """Return what scripts rely on."""
    told = result.to_dict()
    keys = ("surfels", "kept", "cut", "leaky", "conflict", "seconds", "warnings")
    return {key: told[key] for key in keys} | {"judges": told["judges"]}


def _table(files: list[str], out: str, result: Combination, data: dict[str, Any]) -> Any:
    from surfel.cli.output import shown
    from surfel.cli.tables import fact_table

    facts = {name: value for name, value in data.items() if name not in ("warnings", "judges")}
    for leaf, judge in enumerate(result.judges):
        if judge is not None:
            facts[f"judge of operand {leaf}"] = f"{judge[0]}: {judge[1]}"
    return fact_table(f"{', '.join(map(shown, files))} -> {shown(out)}", facts)
