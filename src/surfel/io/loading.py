"""From an open file to its content, whole or run after run, with the options of reading applied."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from surfel.core.errors import InputError
from surfel.io.content import Content, Head
from surfel.io.options import Options
from surfel.io.registry import Format, format_for_reading
from surfel.io.select import chosen, faces_chosen, refuse_levels
from surfel.io.source import Source

CHUNK = 1_000_000
"""How many points a run has unless told otherwise."""

_ALL = Options()


def load_content(
    source: Source, options: Options = _ALL, as_: str | None = None
) -> tuple[Any, Format, tuple[int, int]]:
    """Read an open file.

    Returns
    -------
    content : Content, or the shape that a room above makes of the file
        The wanted part, without what is not finite.
    found : Format
        Its format.
    dropped : tuple of two int
        How many points were not finite, and how many triangles used one.
    """
    found, notes = format_for_reading(source)
    content = _loaded(source, found, options)
    if not isinstance(content, Content):
        if options.asked:
            raise InputError(
                f"a {found.name} description is no cloud; it takes none of {', '.join(sorted(options.asked))}"
            )
        return content, found, (0, 0)
    content.notes[:0] = notes
    rest = options.without(_selects(found))
    if content.triangles is None:
        content, points, triangles = chosen(content, rest).finite()
    else:
        content, points, triangles = content.finite()
        content = chosen(content.as_points(), rest) if as_ == "points" else faces_chosen(content, rest)
    if points:
        more = f" and {triangles} triangles that use them" if triangles else ""
        content.notes.append(f"{points} points that are not finite{more} were dropped")
    return content, found, (points, triangles)


def runs_of(source: Source, found: Format, size: int, options: Options = _ALL) -> Iterator[Content]:
    """Yield the wanted points, as stored (what is not finite included), run after run.

    A format or a file that cannot be read in runs is read whole and cut. A mesh becomes its used vertices.
    """
    streamed = streamed_runs(source, found, size, options)
    if streamed is not None:
        yield from streamed
        return
    content = _loaded(source, found, options)
    if not isinstance(content, Content):
        raise InputError(f"{source.path!r} is a {found.name} description, not points; it cannot be read in runs")
    if content.triangles is not None:
        content = content.finite()[0].as_points()
    content = chosen(content, options.without(_selects(found)))
    for first in range(0, max(1, len(content.points)), size):
        yield content.rows(slice(first, first + size))


def streamed_runs(source: Source, found: Format, size: int, options: Options = _ALL) -> Iterator[Content] | None:
    """Return the runs of a file that can be read so with flat memory, or None."""
    source.stream.seek(0)
    selects = _selects(found)
    if not hasattr(found.codec, "chunks"):
        return None
    if not selects:
        refuse_levels(options)
    with np.errstate(all="ignore"):
        runs = found.codec.chunks(source, size, options) if selects else found.codec.chunks(source, size)
    return None if runs is None else _chosen_runs(runs, options.without(selects))


def head_of(source: Source, found: Format) -> Head | None:
    """Return what the header alone tells, or None."""
    source.stream.seek(0)
    if not hasattr(found.codec, "head"):
        return None
    with np.errstate(all="ignore"):
        head: Head | None = found.codec.head(source)
    return head


def _chosen_runs(runs: Iterator[Content], rest: Options) -> Iterator[Content]:
    first = 0
    while True:
        with np.errstate(all="ignore"):
            run = next(runs, None)
        if run is None:
            return
        yield chosen(run, rest, first)
        first += len(run.points)


def _loaded(source: Source, found: Format, options: Options) -> Any:
    source.stream.seek(0)
    selects = _selects(found)
    if not selects:
        refuse_levels(options)
    with np.errstate(all="ignore"):  # a damaged file may hold any bits; what is not finite is counted later
        return found.codec.load(source, options) if selects else found.codec.load(source)


def _selects(found: Format) -> frozenset[str]:
    return frozenset(getattr(found.codec, "SELECTS", ()))
