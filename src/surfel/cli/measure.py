"""``surfel measure``: area, volume and moments of a file, each with its error."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from surfel.cli.options import AsJson, Quiet, ReadAs, Seed, as_form, as_seed

if TYPE_CHECKING:
    from rich.console import RenderableType

    from surfel.measuring.measurement import Measurement
    from surfel.shapes.base import Shape

METHODS = ("patches", "lines", "qmca")
MODELS = ("chord", "tangent", "offset")
CELLS = ("line", "cylinder")
DENSITIES = ("even", "uneven", "resampled")
SEQUENCES = ("niederreiter", "r4", "sobol", "halton", "random")


def measure(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A cloud, a mesh or a CSG tree; - is standard input.")],
    as_: ReadAs = None,
    method: Annotated[
        str | None,
        typer.Option(metavar="|".join(METHODS), help="How the area is found; by default the better one."),
    ] = None,
    lines: Annotated[int, typer.Option(metavar="N", help="How many lines in all.")] = 65_536,
    tolerance: Annotated[
        float | None,
        typer.Option(metavar="REL", help="Double the lines until their 95 % half-width is this share of the value."),
    ] = None,
    model: Annotated[str, typer.Option(metavar="|".join(MODELS), help="How lines are drawn.")] = "tangent",
    sequence: Annotated[str, typer.Option(metavar="|".join(SEQUENCES), help="The point sequence.")] = "niederreiter",
    radius_factor: Annotated[
        float, typer.Option(metavar="L", help="Of qmca: radius of the cylinder over the size of a gap.")
    ] = 1.5,
    depth: Annotated[int, typer.Option(metavar="D", help="Of qmca: depth of the octree.")] = 4,
    cells: Annotated[
        str, typer.Option(metavar="|".join(CELLS), help="Of qmca: which cells' points are looked at.")
    ] = "line",
    density: Annotated[
        str, typer.Option(metavar="|".join(DENSITIES), help="Of qmca: what is done about uneven sampling.")
    ] = "even",
    denoise: Annotated[int, typer.Option(metavar="N", help="Of qmca: passes of the bilateral filter.")] = 0,
    solid: Annotated[
        bool | None,
        typer.Option("--solid/--sheet", help="The cloud bounds a solid, or is a sheet; by default its leaks decide."),
    ] = None,
    units: Annotated[str, typer.Option(metavar="U", help="A label for lengths; nothing is converted.")] = "",
    plot: Annotated[str | None, typer.Option(metavar="PNG", help="Also draw a picture (extra `plot`).")] = None,
    seed: Seed = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Measure a cloud, a mesh or a CSG tree: area, volume, centroid and inertia, each as value +- error."""
    from surfel.cli.output import Output

    form = as_form(as_)
    seed = as_seed(seed)
    _check_choices(method, model, sequence, cells, density)
    if plot is not None:
        from surfel.core.figure import require_matplotlib

        require_matplotlib()

    import surfel

    with Output(as_json, quiet, measures=True) as output:
        with output.work() as progress:
            shape = _with_solid(surfel.read(file, as_=form), solid)
            result = surfel.measure(
                shape,
                method=method,
                lines=lines,
                tolerance=tolerance,
                seed=seed,
                model=model,
                sequence=sequence,
                radius_factor=radius_factor,
                depth=depth,
                cells=cells,
                density=density,
                denoise=denoise,
                progress=progress,
            )
        if plot is not None:
            from surfel.cli.plot import draw_measurement

            draw_measurement(shape, result, file, units, plot)
        data = result.to_dict() | ({"units": units} if units else {})
        output.result(data, lambda: _table(result, file, units))


def _table(result: Measurement, file: str, units: str) -> RenderableType:
    from surfel.cli.tables import measurement_table

    return measurement_table(result, file, units)


def _check_choices(method: str | None, model: str, sequence: str, cells: str, density: str) -> None:
    """Refuse an unknown name before a large file is read."""
    from surfel.core.cast import as_choice

    if method is not None:
        as_choice(method, "--method", METHODS)
    as_choice(model, "--model", MODELS)
    as_choice(sequence, "--sequence", SEQUENCES)
    as_choice(cells, "--cells", CELLS)
    as_choice(density, "--density", DENSITIES)


def _with_solid(shape: Shape, solid: bool | None) -> Shape:
    """Return the cloud with what ``--solid`` or ``--sheet`` says of it."""
    if solid is None:
        return shape
    from surfel.core.errors import InputError
    from surfel.shapes.surfels import Surfels

    if not isinstance(shape, Surfels):
        raise InputError("--solid and --sheet speak of clouds, and this file holds none (--as points: vertices)")
    return shape.with_solid(solid)
