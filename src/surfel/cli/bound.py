"""``surfel bound``: a smooth surface with every point of a file on one side, guaranteed."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from surfel.cli.options import AsJson, Quiet

if TYPE_CHECKING:
    from rich.console import RenderableType

    from surfel.bounding.spline import SafeSpline
    from surfel.core.cast import Floats
    from surfel.core.execute import Progress
    from surfel.io.chunks import Chunks

SIDES = ("above", "below", "both")
MODES = ("paper", "fast", "tight")
BOUNDARIES = ("open", "clamped")
SUFFIXES = (".npz", ".3dm")
_AT_ONCE = 8_000_000
"""A file with more points than this is streamed: two passes to fit, one to verify, and flat memory."""


def bound(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A cloud, or a mesh of which the vertices are taken.")],
    out: Annotated[
        str, typer.Option("--output", "-o", metavar="OUT", help="The surface to write: .npz, or .3dm (extra `cad`).")
    ],
    direction: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y Z", help="Along which heights are measured.")
    ] = (0.0, 0.0, 1.0),
    shape: Annotated[tuple[int, int], typer.Option(metavar="N M", help="How many coefficients along each side.")] = (
        20,
        20,
    ),
    side: Annotated[
        str, typer.Option(metavar="|".join(SIDES), help="Where the surface lies; both writes OUT-above and OUT-below.")
    ] = "above",
    mode: Annotated[str, typer.Option(metavar="|".join(MODES), help="How it is fitted.")] = "fast",
    boundary: Annotated[str, typer.Option(metavar="|".join(BOUNDARIES), help="How the surface ends.")] = "open",
    plot: Annotated[
        str | None, typer.Option(metavar="PNG", help="Also draw the surface and slices through it (extra `plot`).")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Bound a cloud from one side, or from both: no point on the wrong side of the surface, verified."""
    from surfel.cli.output import Output

    targets = _targets(out, side)
    _check(out, side, mode, boundary, plot)

    import surfel

    started = time.perf_counter()
    with Output(as_json, quiet) as output:
        with output.work() as progress, surfel.open(file) as chunks:
            points = _Passes(chunks, progress)
            splines = _fit(points.whole() if points.fit_in_memory else points, direction, shape, side, mode, boundary)
            counts = [spline.verify(points.kept if points.fit_in_memory else points)[0] for spline in splines]
            if plot is not None:
                from surfel.cli.plot_bound import draw_bound

                draw_bound(splines, points.sample(), file, plot)
        for spline, target in zip(splines, targets, strict=True):
            _write(spline, target)
        data = _facts(splines, counts, time.perf_counter() - started)
        data["warnings"] += points.warnings()
        output.result(data, lambda: _table(file, targets, data))


def _targets(out: str, side: str) -> list[str]:
    """Return the files to write."""
    if side != "both":
        return [out]
    path = Path(out)
    return [str(path.with_name(f"{path.stem}-{each}{path.suffix}")) for each in ("above", "below")]


def _check(out: str, side: str, mode: str, boundary: str, plot: str | None) -> None:
    """Refuse what cannot be done before a large file is read."""
    from surfel.core.cast import as_choice
    from surfel.core.errors import InputError, MissingExtraError

    as_choice(side, "--side", SIDES)
    as_choice(mode, "--mode", MODES)
    as_choice(boundary, "--boundary", BOUNDARIES)
    suffix = Path(out).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"-o must end in {' or '.join(SUFFIXES)}; got {out!r}")
    if suffix == ".3dm":
        try:
            import rhino3dm  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("rhino3dm", "cad") from error
    if plot is not None:
        from surfel.core.figure import require_matplotlib

        require_matplotlib()


class _Passes:
    """The points of a file, to be passed over as often as it takes; each pass tells how far it is."""

    def __init__(self, chunks: Chunks, progress: Progress) -> None:
        self._chunks, self._progress = chunks, progress
        self._pass = 0
        self._dropped = 0
        self.kept: Floats | None = None

    @property
    def fit_in_memory(self) -> bool:
        """Whether the file is small enough to be read at once."""
        return self.kept is not None or (self._chunks.points is not None and self._chunks.points <= _AT_ONCE)

    def whole(self) -> Floats:
        """Read all points."""
        import numpy as np

        self.kept = np.concatenate([np.empty((0, 3)), *self])
        return self.kept

    def sample(self, most: int = 20_000) -> Floats:
        """Return about so many of the points, evenly taken, for a picture."""
        import numpy as np

        runs = [self.kept] if self.kept is not None else self
        total = self._chunks.points or 100 * most
        step = max(1, total // most)
        return np.concatenate([np.empty((0, 3)), *(run[::step] for run in runs)])

    def warnings(self) -> list[str]:
        """Say what was left out."""
        if not self._dropped:
            return []
        return [f"{self._dropped:,} points had coordinates that are not finite and were left out"]

    def __iter__(self) -> Iterator[Floats]:
        self._pass += 1
        done = self._dropped = 0
        total = self._chunks.points or 0
        for cloud in self._chunks:
            self._dropped += int(str(cloud.provenance.get("non_finite", 0)))
            done += len(cloud)
            self._progress(min(1.0, done / total) if total else 0.0, f"reading, pass {self._pass}")
            yield cloud.points


def _fit(points: Any, direction: Any, shape: Any, side: str, mode: str, boundary: str) -> list[SafeSpline]:
    import surfel

    if side == "both":
        return list(surfel.sandwich(points, direction, shape, mode=mode, boundary=boundary))
    return [surfel.bound(points, direction, shape, side=side, mode=mode, boundary=boundary)]


def _write(spline: SafeSpline, target: str) -> None:
    if Path(target).suffix.lower() == ".3dm":
        spline.to_3dm(target)
    else:
        spline.save(target)


def _facts(splines: list[SafeSpline], counts: list[int], seconds: float) -> dict[str, Any]:
    """Return what scripts rely on; for a sandwich also what each of the two surfaces says."""
    reports = [spline.report for spline in splines]
    data: dict[str, Any] = {
        "violations": sum(counts),
        "gap_mean": sum(report.gap_mean for report in reports) / len(reports),
        "gap_max": max(report.gap_max for report in reports),
        "points": reports[0].points,
        "seconds": seconds,
        "warnings": list(dict.fromkeys(warning for report in reports for warning in report.warnings)),
    }
    if len(splines) > 1:
        for spline, count in zip(splines, counts, strict=True):
            each = {"violations": count, "gap_mean": spline.report.gap_mean, "gap_max": spline.report.gap_max}
            data[spline.side] = each
    return data


def _table(file: str, targets: list[str], data: dict[str, Any]) -> RenderableType:
    from surfel.cli.output import shown
    from surfel.cli.tables import fact_table

    title = f"{shown(file)} -> {', '.join(shown(target) for target in targets)}"
    return fact_table(title, {name: value for name, value in data.items() if name != "warnings"})
