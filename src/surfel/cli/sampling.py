"""``surfel sample``: points with normals from a solid."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

from surfel.cli.options import AsJson, Quiet, Seed, as_seed

KINDS = ("random", "blue")


def sample(
    solid: Annotated[str, typer.Argument(metavar="SOLID", help="A mesh, or a CSG tree (.csg).")],
    out: Annotated[str, typer.Option("--output", "-o", metavar="OUT", help="The cloud to write.")],
    number: Annotated[int | None, typer.Option("--number", "-n", metavar="N", help="How many points.")] = None,
    kind: Annotated[
        str, typer.Option(metavar="|".join(KINDS), help="Independent points, or blue noise: no two of them close.")
    ] = "random",
    radius: Annotated[
        float | None,
        typer.Option(metavar="RHO", help="Instead of N: as many that each place has a point within this distance."),
    ] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Sample points with outward normals from the surface of a solid."""
    from surfel.cli.output import Output, shown
    from surfel.core.cast import as_choice, as_count, as_positive
    from surfel.core.errors import InputError

    seed = as_seed(seed)
    as_choice(kind, "--kind", KINDS)
    if (number is None) == (radius is None):
        raise InputError("give either -n N or --radius RHO")
    count = None if number is None else as_count(number, "-n")
    reach = None if radius is None else as_positive(radius, "--radius")

    import surfel

    with Output(as_json, quiet) as output:
        shape = surfel.read(solid)
        if isinstance(shape, surfel.Surfels):
            raise InputError(f"{shown(solid)} holds points alone; sample needs a mesh or a tree of solids")
        started = time.perf_counter()
        points, normals = surfel.sample(shape, count, kind=kind, radius=reach, seed=seed)[:2]
        surfel.write(out, surfel.Surfels(points, normals=normals))
        report = {"points": len(points), "area": _area_of(shape), "seconds": time.perf_counter() - started}
        output.facts(report, f"{shown(solid)} -> {shown(out)}")


def _area_of(shape: Any) -> float:
    import surfel

    return float(shape.area) if isinstance(shape, surfel.Mesh) else float(surfel.measure(shape).area)
