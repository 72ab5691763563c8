"""convert: the same points or faces in another format, run after run where both formats allow it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_choice
from surfel.core.errors import InputError
from surfel.core.execute import Progress
from surfel.io.atomic import replacing
from surfel.io.content import Content, Head
from surfel.io.loading import CHUNK, head_of, load_content, streamed_runs
from surfel.io.options import Options, options_from
from surfel.io.registry import Format, NotStreamed, format_for_reading, format_for_writing
from surfel.io.source import Source, open_source

Path = str | PathLike[str]


def convert(
    source: Path,
    target: Path,
    as_: str | None = None,
    *,
    bounds: ArrayLike | None = None,
    every: int = 1,
    classes: int | Iterable[int] | None = None,
    resolution: float | None = None,
    level: int | None = None,
    to: str | None = None,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Copy a file into another format, keeping what the target can hold.

    Points go run after run, with flat memory, where both formats allow it.

    Parameters
    ----------
    source, target : str or path-like
        The file, and the new one; the suffix of the new one says its format. "-" is the standard input or output.
    as_ : {None, "points", "mesh"}
        As in :func:`surfel.read`; by default triangles are kept where the target can hold them.
    bounds, every, classes, resolution, level
        Which points, as in :func:`surfel.read`.
    to : str, optional
        The format of the new file by its suffix, where its name does not say it.
    progress : callable, optional
        Called with the share done, from 0 to 1, and what is being done.

    Returns
    -------
    dict
        ``source`` and ``target`` (formats), ``points`` and ``triangles`` written, ``non_finite`` (dropped), ``lost``
        (what the target could not hold) and ``notes`` (what was decided while reading).

    Raises
    ------
    InputError, FileFormatError
        As :func:`surfel.read` and :func:`surfel.write` do.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/a.ply", surfel.Surfels(np.eye(3), colors=np.eye(3)))
    >>> surfel.convert(folder.name + "/a.ply", folder.name + "/a.npy")["lost"]
    ['colors of 3 points']
    >>> folder.cleanup()
    """
    if as_ is not None:
        as_choice(as_, "as_", ("points", "mesh"))
    options = options_from(bounds, every, classes, resolution, level)
    wanted, suffix = format_for_writing(target, to)
    with open_source(source) as opened:
        found, _ = format_for_reading(opened)
        try:
            if as_ == "mesh" or not hasattr(wanted.codec, "writer"):
                raise NotStreamed
            report = _streamed(opened, found, target, wanted, suffix, options, progress)
        except NotStreamed:
            report = _whole(opened, target, wanted, suffix, options, as_)
    return {"source": found.name, "target": wanted.name, **report}


def _streamed(
    source: Source, found: Format, path: Path, wanted: Format, suffix: str, options: Options, progress: Progress | None
) -> dict[str, Any]:
    """Convert run after run.

    Raises
    ------
    NotStreamed
        If the file or the target cannot be treated so; nothing was written.
    """
    head = head_of(source, found) or Head()
    runs = streamed_runs(source, found, CHUNK, options)
    if runs is None:
        raise NotStreamed
    tell = _teller(source, progress)
    head.points = None if options.asked & {"bounds", "classes"} else head.points
    if getattr(wanted.codec, "NEEDS_BOUNDS", False) and (options.asked or head.bounds is None):
        head.bounds, head.points = _extent(runs, tell)
        runs = streamed_runs(source, found, CHUNK, options)
        assert runs is not None  # the same file a second time
    written = dropped = 0
    notes: list[str] = []
    with replacing(path) as stream:
        writer: Any = None
        for run in runs:
            content, fewer, _ = run.finite()
            if writer is None:
                writer = wanted.codec.writer(stream, content, head, suffix=suffix)
            if writer is None:
                raise NotStreamed
            writer.add(content)
            notes = list(dict.fromkeys([*notes, *content.notes]))
            written, dropped = written + len(content.points), dropped + fewer
            tell("converting")
        writer.close()
    if dropped:
        notes.append(f"{dropped} points that are not finite were dropped")
    return {
        "points": written, "triangles": 0, "non_finite": dropped, "lost": list(writer.lost),
        "notes": [*format_for_reading(source)[1], *notes],
    }  # fmt: skip


def _whole(
    source: Source, path: Path, wanted: Format, suffix: str, options: Options, as_: str | None
) -> dict[str, Any]:
    """Convert what has to be read or written whole."""
    content, found, (dropped, _) = load_content(source, options, as_)
    if not isinstance(content, Content):
        raise InputError(f"{source.path!r} is a {found.name} description, not points or faces; it cannot be converted")
    if as_ == "points":
        content = content.as_points()
    kind = "mesh" if content.triangles is not None else "points"
    if as_ == "mesh" and kind != "mesh":
        raise InputError(f"{source.path!r} has no faces to convert as a mesh")
    lost: list[str] = []
    if kind == "mesh" and "mesh" not in wanted.holds and as_ is None:
        lost.append(f"{len(content.triangles if content.triangles is not None else ())} triangles")
        content, kind = content.as_points(), "points"
    if kind not in wanted.holds:
        raise InputError(f"{wanted.name} holds no {kind}; convert {source.path!r} to .ply, which holds both")
    with replacing(path) as stream:
        lost += wanted.codec.save(stream, content, ascii=False, suffix=suffix)
    return {
        "points": len(content.points),
        "triangles": 0 if content.triangles is None else len(content.triangles),
        "non_finite": dropped,
        "lost": lost,
        "notes": content.notes,
    }


def _extent(runs: Iterator[Content], tell: Callable[[str], None]) -> tuple[Floats | None, int]:
    """Return the corners of all finite points and how many there are."""
    low, high, count = np.full(3, np.inf), np.full(3, -np.inf), 0
    for run in runs:
        points = run.finite()[0].points
        count += len(points)
        low, high = (
            np.minimum(low, points.min(axis=0, initial=np.inf)),
            np.maximum(high, points.max(axis=0, initial=-np.inf)),
        )
        tell("looking at the extent")
    return (np.stack([low, high]) if count else None), count


def _teller(source: Source, progress: Progress | None) -> Callable[[str], None]:
    """Return what tells how far the file was read."""

    def tell(label: str) -> None:
        if progress is not None:
            progress(min(1.0, source.stream.tell() / source.size), label)

    return tell
