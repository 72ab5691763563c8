"""open: a file as a row of clouds, so that memory stays flat however large it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext
from os import PathLike, fsdecode
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from surfel.core.cast import Floats, as_count
from surfel.core.errors import InputError
from surfel.io.content import Head
from surfel.io.loading import CHUNK, head_of, runs_of
from surfel.io.options import Options, options_from
from surfel.io.registry import format_for_reading
from surfel.io.source import STANDARD, Source, open_source

if TYPE_CHECKING:
    from surfel.shapes.surfels import Surfels

Path = str | PathLike[str]


def open(
    path: Path,
    chunk: int = CHUNK,
    *,
    bounds: ArrayLike | None = None,
    every: int = 1,
    classes: int | Iterable[int] | None = None,
    resolution: float | None = None,
    level: int | None = None,
) -> Chunks:
    """Open a file to be read in chunks, with flat memory where its format allows that.

    Binary and ascii PLY, text, PCD, NPY, LAS, LAZ and COPC are read chunk by chunk; other files are read whole and cut.
    A mesh gives its used vertices.

    Parameters
    ----------
    path : str or path-like
        The file; "-" is the standard input.
    chunk : int
        The most points of a chunk.
    bounds, every, classes, resolution, level
        As in :func:`surfel.read`.

    Returns
    -------
    Chunks
        A context and an iterable of clouds, which may be iterated over again.

    Raises
    ------
    InputError
        If there is no such file, its format is not known, or an argument cannot be used.
    FileFormatError
        If the file is empty or its header is damaged; while iterating, where the damage lies.

    Examples
    --------
    >>> import tempfile, numpy as np, surfel
    >>> folder = tempfile.TemporaryDirectory()
    >>> surfel.write(folder.name + "/cloud.ply", np.arange(30.0).reshape(10, 3))
    >>> with surfel.open(folder.name + "/cloud.ply", chunk=4) as file:
    ...     file.points, [len(cloud) for cloud in file]
    (10, [4, 4, 2])
    >>> folder.cleanup()
    """
    return Chunks(path, as_count(chunk, "chunk"), options_from(bounds, every, classes, resolution, level))


class Chunks:
    """A file being read in chunks; made by :func:`surfel.open`.

    Attributes
    ----------
    path, format : str
        The file and what it is.
    points : int or None
        How many points are stored in it, where its header says so; options of reading are not counted in.
    bounds : ndarray of float64, shape (2, 3), or None
        The lowest and the highest corner, where the header says so.
    crs : str
        The coordinate reference system as text; empty where the header has none.
    attributes : tuple of str
        The names of further values, where the header says so.
    """

    def __init__(self, path: Path, size: int, options: Options) -> None:
        self._held = ExitStack()
        self._size, self._options = size, options
        self._pipe: Source | None = None
        self._closed = False
        if path == STANDARD:
            self._pipe = self._held.enter_context(open_source(path))  # it comes only once, so it is kept
        with self._source(path) as source:
            self._format, self._notes = format_for_reading(source)
            head = head_of(source, self._format) or Head()
        self.path = fsdecode(path)
        self.format = self._format.name
        self.points: int | None = head.points
        self.bounds: Floats | None = head.bounds
        self.crs: str = head.frame.crs if head.frame is not None else ""
        self.attributes = tuple(head.attributes)

    def __iter__(self) -> Iterator[Surfels]:
        """Yield clouds in the file's order; points that are not finite are dropped and counted in ``provenance``."""
        if self._closed:
            raise InputError(f"{self.path!r} was closed; open it again to read it")
        return self._clouds()

    def _clouds(self) -> Iterator[Surfels]:
        with self._source(self.path) as source:
            for run in runs_of(source, self._format, self._size, self._options):
                content, dropped, _ = run.finite()
                if len(content.points):
                    content.notes = [*self._notes, *content.notes]
                    yield content.to_surfels({"format": self.format, "path": self.path, "non_finite": dropped})

    def __enter__(self) -> Chunks:
        """Return itself."""
        return self

    def __exit__(self, *reason: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """Let go of what is held; it cannot be iterated over after that."""
        self._closed = True
        self._held.close()

    def __repr__(self) -> str:
        count = "" if self.points is None else f", {self.points:,} points"
        return f"Chunks({self.path!r}, {self.format}{count})"

    def _source(self, path: Path) -> AbstractContextManager[Source]:
        """Return a context that gives the file at its beginning."""
        return open_source(path) if self._pipe is None else nullcontext(self._pipe)
