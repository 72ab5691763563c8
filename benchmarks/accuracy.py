"""How near the area, the volume and the centroid come to the truth, and how often the intervals hold it."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.estimates import Outcome, judge
from benchmarks.rows import CENTROID_TARGET, ROWS, Case, Row, row_of
from benchmarks.shapes import HARD, JUDGING, MESHES, TUNING, NoDataError
from benchmarks.tables import made_on, percent, table


def run(cases: Iterable[Case], mode: str = "error", jobs: int = 1, lines: int = 100_000) -> list[Outcome]:
    """Measure every case, printing each as it is done."""
    todo = [(case, mode, lines) for case in cases]
    if jobs <= 1:
        return list(_told(map(measured, todo)))
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        return list(_told(pool.map(measured, todo)))


def measured(task: tuple[Case, str, int]) -> Outcome | str:
    """Make one cloud and measure it; a text where that cannot be done."""
    case, mode, lines = task
    solid = row_of(case.row).solid
    try:
        cloud = case.cloud()
        if solid and cloud.shape.volume is None:
            return f"{case.row} | {case.shape} | skipped: no volume to compare with"
        return judge(case.row, cloud, mode="measure" if solid else mode, lines=lines)
    except NoDataError as absent:
        return f"{case.row} | {case.shape} | skipped: {absent}"
    except Exception as error:  # one bad case shall not take the others with it, but must be seen
        return f"{case.row} | {case.shape} | {case.normals} | FAILED: {type(error).__name__}: {error}"


def _told(results: Iterable[Outcome | str]) -> Iterator[Outcome]:
    for result in results:
        print(result if isinstance(result, str) else line_of(result), file=sys.stdout, flush=True)
        if isinstance(result, Outcome):
            yield result


def line_of(o: Outcome) -> str:
    """Return one case as a line of text."""
    text = (
        f"{o.row:20s} | {o.shape:24s} | {o.normals:5s} | {o.points:7d} points"
        f" | area {percent(o.error, signed=True):>7s} %"
        f" +-{percent(o.half_width):>6s} {'  ' if o.covered or math.isnan(o.half_width) else '! '}"
        f"| noise {o.noise:.3f} | {o.seconds:6.2f} s"
    )
    if row_of(o.row).solid and math.isnan(o.volume):
        text += f" | no volume was given | leak {percent(o.leak)} %"
    if math.isfinite(o.volume):
        text += f" | volume {percent(o.volume, signed=True)} % +-{percent(o.volume_half_width)}"
        text += f" | centroid {o.centroid:.1e} | leak {percent(o.leak)} %"
    return text if o.reliable else text + " | said to be unreliable"


def summary(outcomes: list[Outcome]) -> str:
    """Return the tables of rows: target, median and worst error, coverage; areas, then solids."""
    areas, solids = [], []
    for row in ROWS:
        for kind in ("given", "none"):
            mine = [o for o in outcomes if o.row == row.name and o.normals == kind]
            if mine:
                (solids if row.solid else areas).append(_row_line(row, kind, mine))
    parts = []
    if areas:
        head = ["area", "normals", "cases", "target %", "median %", "mean %", "worst %", "covered"]
        parts.append(table([*head, "half-width %", "met"], areas))
    if solids:
        head = ["solid", "normals", "cases", "volume: worst %", "median %", "covered", "centroid: worst", "met"]
        parts.append(table(head, solids))
    return "\n".join(parts)


def _row_line(row: Row, kind: str, mine: list[Outcome]) -> list[str]:
    target = row.target(kind)
    assert target is not None
    errors = np.array([o.volume if row.solid else o.error for o in mine])
    errors[np.isnan(errors)] = np.inf  # none was given, where there is one
    widths = np.array([o.volume_half_width if row.solid else o.half_width for o in mine])
    median, worst = float(np.median(np.abs(errors))), float(np.abs(errors).max())
    met = 100.0 * median <= target[0] and 100.0 * worst <= target[1]
    covered = "-" if np.isnan(widths).all() else f"{int((np.abs(errors) <= widths).sum())}/{len(mine)}"
    if row.solid:
        centroid = float(np.nan_to_num([o.centroid for o in mine], nan=np.inf).max())
        met = met and centroid <= CENTROID_TARGET
        return [row.name, kind, str(len(mine)), percent(worst), percent(median), covered, f"{centroid:.1e}", _yes(met)]
    told = _target(target)
    return [
        row.name, kind, str(len(mine)), told, percent(median), percent(float(errors.mean()), signed=True),
        percent(worst), covered, percent(float(np.median(widths))), _yes(met) if told != "-" else "",
    ]  # fmt: skip


def _target(target: tuple[float, float]) -> str:
    median, worst = target
    if math.isinf(median) and math.isinf(worst):
        return "-"
    if math.isinf(worst):
        return f"{median:g} (median)"
    return f"{worst:g} (all)" if median == worst else f"{median:g} ({worst:g})"


def _yes(met: bool) -> str:
    return "yes" if met else "no"


def details(outcomes: list[Outcome]) -> str:
    """Return one line a case."""
    areas = [
        (
            o.row, o.shape, _used(o.shape), o.normals, o.points, percent(o.error, signed=True), percent(o.half_width),
            f"{o.noise:.3f}", f"{o.seconds:.2f}",
        )
        for o in outcomes if not row_of(o.row).solid
    ]  # fmt: skip
    solids = [
        (
            o.row, o.shape, _used(o.shape), o.normals, o.points, percent(o.volume, signed=True),
            percent(o.volume_half_width), f"{o.centroid:.1e}", percent(o.leak), f"{o.seconds:.2f}",
        )
        for o in outcomes if row_of(o.row).solid
    ]  # fmt: skip
    head = ("row", "shape", "used for", "normals", "points", "error %", "half-width %")
    parts = [table((*head, "noise, spacings", "seconds"), areas)] if areas else []
    if solids:
        parts.append(table((*head, "centroid", "leak %", "seconds"), solids))
    return "\n".join(parts)


def _used(shape: str) -> str:
    if shape in JUDGING:
        return "judging"
    if shape in HARD:
        return "hard"
    return "tuning" if shape in TUNING or shape not in MESHES else "judging"


def report(outcomes: list[Outcome], *, detailed: bool = True) -> str:
    """Return the whole result as Markdown."""
    text = f"""# Accuracy

{made_on()}

Errors are relative to the area of the mesh or of the formula that the points were drawn from. "Median" and "worst" are
of their absolute values over the cases of a row; a target "a (b)" is for the median (the worst). "Covered" counts the
cases whose 95 % interval holds the truth; "half-width" is the median half-width of these intervals. "16x": the density
of the points grows by 16 from end to end. h is the spacing, the root of area over number of points; shares of noise in
percent are of the diagonal of the box. Centroids are in halves of that diagonal; the target is {CENTROID_TARGET:g}.
Seeds are fixed.

Shapes used for tuning the constants of the estimator: {", ".join(TUNING)}; and the structured sets of the same solids.
Shapes used only for judging: {", ".join(JUDGING)}.
Hard ones, listed apart because 20,000 points are too few for their detail: {", ".join(HARD)}.

{summary(outcomes)}"""
    return f"{text}\n## Case by case\n\n{details(outcomes)}" if detailed else text


def save_json(outcomes: list[Outcome], path: str | None) -> None:
    """Write the cases as JSON lines, for comparing two runs."""
    with nullcontext() if path is None else Path(path).open("w", encoding="utf-8") as file:
        if file is not None:
            file.writelines(json.dumps(asdict(o)) + "\n" for o in outcomes)
