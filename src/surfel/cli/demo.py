"""``surfel demo``: the main job on data whose truth is known."""

from __future__ import annotations

import filecmp
import os
import shlex
import shutil
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from surfel.cli.options import AsJson, Quiet, Seed, as_seed

if TYPE_CHECKING:
    from rich.console import RenderableType

    from surfel.cli.part import BoredBlock
    from surfel.measuring.measurement import Measurement
    from surfel.shapes.surfels import Surfels

POINTS = 40_000
FILE = "part.ply"


def demo(
    folder: Annotated[str, typer.Argument(metavar="DIR", help="Where cloud and report are written.")] = "surfel-demo",
    seed: Seed = 0,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Draw it, cut it, lay a surface over it: one HTML page.")
    ] = True,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Sample a part of known area and volume, write the cloud, measure it, compare with the truth, and show it all."""
    import surfel
    from surfel.cli.output import Output, shown
    from surfel.cli.part import BoredBlock
    from surfel.cli.report import REPORT, refuse_foreign, write_report

    seed = as_seed(seed)
    part, place = BoredBlock(), Path(folder)
    with Output(as_json, quiet, measures=True) as output:
        if report:
            refuse_foreign(place)
        path = _write_once(surfel.Surfels(*part.sample(POINTS, seed)), place)
        with output.work() as progress:
            scan = surfel.read(path)
            result = surfel.measure(scan, seed=seed, progress=progress)
        told = result.to_dict()
        data = {"file": str(path), "report": str(place / REPORT) if report else None, "points": told["points"]}
        data |= {"area": told["area"], "volume": told["volume"], "truth": {"area": part.area, "volume": part.volume}}
        data |= {"seconds": told["seconds"], "warnings": told["warnings"]}
        if not as_json:
            output.result(data, lambda: _comparison(result, part, path))
        if report:
            output.note("drawing the report")
            output.go_on_with("report")
            with output.work() as progress:
                assert isinstance(scan, surfel.Surfels)  # it was written as one
                write_report(place, scan, result, part, seed, progress)
        if as_json:
            output.result(data, lambda: _comparison(result, part, path))
        elif report:
            typer.echo(f"\nReport, for the browser: {shown(place / REPORT)}")


def _comparison(result: Measurement, part: BoredBlock, path: Path) -> RenderableType:
    """Return what was found beside the truth, and what to try next."""
    from rich.console import Group
    from rich.text import Text

    from surfel.cli.output import shown
    from surfel.cli.tables import comparison_table

    rows = [("area", result.area, part.area)]
    if result.volume is not None:
        rows.append(("volume", result.volume, part.volume))
    title = (
        f"{shown(path)}: {POINTS:,} random points with normals on a {part.width:g} x {part.depth:g} x {part.height:g} "
        f"block with a hole of radius {part.radius:g}, measured in {result.seconds:.2f} s"
    )
    next_steps = "Try next:\n" + "\n".join(f"  {command}" for command in _next_commands(path))
    return Group(comparison_table(title, rows), Text(), Text(next_steps))


def _write_once(cloud: Surfels, folder: Path) -> Path:
    """Write the cloud into the folder; a file that is there already must be the very same."""
    import surfel
    from surfel.core.errors import InputError

    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / FILE
    try:
        with tempfile.TemporaryDirectory(prefix=".surfel-", dir=folder) as beside:
            fresh = Path(beside) / FILE
            surfel.write(fresh, cloud)
            if not target.exists():
                os.replace(fresh, target)
            elif not filecmp.cmp(fresh, target, shallow=False):
                raise InputError(f"{target} exists and is not this demo's; give another folder: surfel demo DIR")
    except BaseException:
        if made:
            with suppress(OSError):
                folder.rmdir()
        raise
    return target


def _next_commands(path: Path) -> list[str]:
    """Return commands that work as they stand in the shell that this one was typed into."""
    name, quoted = _own_name(), shlex.quote(str(path))
    return [
        f"{name} measure {quoted} --method lines",
        f"{name} info {quoted} --full",
        f"{name} convert {quoted} {shlex.quote(str(path.with_suffix('.xyz')))}",
    ]


def _own_name() -> str:
    """Return how this program is called here: its plain name only where the shell would find the same program."""
    called = Path(sys.argv[0])
    if called.name == "__main__.py":
        return f"{shlex.quote(sys.executable)} -m surfel"
    found = shutil.which("surfel")
    if found is not None and (not called.exists() or os.path.samefile(found, called)):
        return "surfel"
    return shlex.quote(str(called))
