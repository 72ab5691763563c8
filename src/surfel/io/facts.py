"""info: what a file holds, from its header where that is enough, else run after run with flat memory."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from typing import Any

import numpy as np

from surfel.core.cast import Floats
from surfel.core.execute import Progress
from surfel.io.content import Content, Head
from surfel.io.loading import CHUNK, head_of, load_content, streamed_runs
from surfel.io.registry import Format, format_for_reading
from surfel.io.source import Source, open_source
from surfel.io.tally import Tally

Path = str | PathLike[str]


def info(path: Path, full: bool = False, *, progress: Progress | None = None) -> dict[str, Any]:
    """Tell what a file holds.

    Parameters
    ----------
    path : str or path-like
        The file; "-" is the standard input.
    full : bool
        Look at every point: spacing, duplicates, what is not finite, and points without a normal.
    progress : callable, optional
        Called with the share done, from 0 to 1, and what is being done.

    Returns
    -------
    dict
        ``format``, ``points`` (how many; of a mesh its vertices), ``normals`` (whether there are any), ``bounds`` (two
        corners, or None where no point is finite), ``triangles`` where there are faces, ``radii``, ``colors``,
        ``attributes`` and ``notes``; ``crs`` and facts of the format where its header has them. With ``full`` also
        ``spacing`` (the median distance to the nearest other place, or None; of more than 4 million points that of
        20,000 of them), ``duplicates`` (points at the place of an earlier one), ``non_finite`` and ``without_normal``
        (points whose normal is zero or not finite; None where there are no normals).

    Raises
    ------
    InputError, FileFormatError, MissingExtraError
        As :func:`surfel.read` does.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/three.ply", np.eye(3))
    >>> surfel.info(folder.name + "/three.ply")["points"]
    3
    >>> folder.cleanup()
    """
    with open_source(path) as source:
        found, notes = format_for_reading(source)
        head = head_of(source, found)
        if head is not None and head.bounds is not None and not full:
            return _answer(found, head, head.bounds, head.points or 0, [*notes, *head.notes])
        runs = streamed_runs(source, found, CHUNK)
        if runs is not None:
            return _from_runs(source, found, head, full, notes, progress)
        return _from_whole(source, head, full)


def _from_runs(
    source: Source, found: Format, head: Head | None, full: bool, notes: list[str], progress: Progress | None
) -> dict[str, Any]:
    """Look at the points of a file run after run, once or, for ``full``, as often as it takes."""

    def runs() -> Iterator[Content]:
        again = streamed_runs(source, found, CHUNK)
        assert again is not None  # it was one before
        for run in again:
            if progress is not None:
                progress(min(1.0, source.stream.tell() / source.size), "looking at the points")
            yield run

    tally = Tally()
    first: Content | None = None
    for run in runs():
        first = first or run
        notes = list(dict.fromkeys([*notes, *run.notes]))
        tally.add(run)
    assert first is not None  # there is always one run
    told = head or Head()
    told = Head(
        tally.points, first.normals is not None, tally.bounds, first.radii is not None, first.colors is not None,
        list(first.attributes), None, told.frame or first.frame, told.notes, told.facts,
    )  # fmt: skip
    notes = list(dict.fromkeys([*notes, *told.notes]))
    if head is not None and head.bounds is not None and tally.bounds is not None and _differ(head.bounds, tally.bounds):
        notes.append(f"the header says that the bounds are {head.bounds.tolist()}")
    answer = _answer(found, told, tally.bounds, tally.points, notes)
    return answer | (tally.closer(runs) if full else {})


def _from_whole(source: Source, told: Head | None, full: bool) -> dict[str, Any]:
    content, found, (dropped, _) = load_content(source)
    if not isinstance(content, Content):
        return {"format": found.name, "points": 0, "normals": False, "bounds": np.asarray(content.bounds).tolist()}
    tally = Tally()
    tally.add(content)
    tally.points += dropped
    tally.non_finite = dropped
    head = Head(
        tally.points, content.normals is not None, tally.bounds, content.radii is not None,
        content.colors is not None, list(content.attributes), frame=content.frame,
        triangles=None if content.triangles is None else len(content.triangles),
        facts=told.facts if told is not None else {},
    )  # fmt: skip
    answer = _answer(found, head, tally.bounds, tally.points, content.notes)
    return answer | (tally.closer(lambda: iter([content])) if full else {})


def _answer(found: Format, head: Head, bounds: Floats | None, points: int, notes: list[str]) -> dict[str, Any]:
    answer: dict[str, Any] = {
        "format": found.name, "points": points, "normals": head.normals,
        "bounds": None if bounds is None else np.asarray(bounds).tolist(),
    }  # fmt: skip
    if head.triangles is not None:
        answer["triangles"] = head.triangles
    answer |= {"radii": head.radii, "colors": head.colors, "attributes": list(head.attributes)}
    if head.frame is not None and head.frame.crs:
        answer["crs"] = head.frame.crs
    return answer | head.facts | {"notes": notes}


def _differ(a: Floats, b: Floats) -> bool:
    return bool((np.abs(a - b) > 1e-6 * (1.0 + np.abs(b))).any())
