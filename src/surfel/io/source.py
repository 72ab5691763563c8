"""A file being read: its stream, its size, and errors that know its name."""

from __future__ import annotations

import io
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import PurePath
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.errors import FileFormatError, InputError

Bytes = NDArray[np.uint8]


class Source:
    """An open file with a known size, so that no header can make a reader allocate more than the file can hold.

    Parameters
    ----------
    path : str
        The name for errors and for the provenance.
    stream : BinaryIO
        A seekable binary stream at its beginning.
    size : int
        How many bytes it has.
    file : str, optional
        The name under which others can open it; None for what came from a pipe or lies in memory.
    """

    def __init__(self, path: str, stream: BinaryIO, size: int, file: str | None = None) -> None:
        self.path = path
        self.stream = stream
        self.size = size
        self.file = file

    @property
    def position(self) -> int:
        """Where the next byte is read."""
        return self.stream.tell()

    @property
    def remaining(self) -> int:
        """How many bytes there are still to be read."""
        return max(0, self.size - self.stream.tell())

    def head(self, count: int = 4096) -> bytes:
        """Return the first ``count`` bytes (or fewer) without moving."""
        before = self.stream.tell()
        self.stream.seek(0)
        data = self.stream.read(count)
        self.stream.seek(before)
        return data

    def fill(self, buffer: Bytes) -> None:
        """Read exactly as many bytes as ``buffer`` takes."""
        view = buffer.data
        done = 0
        while done < len(view):
            got = self.stream.readinto(view[done:])  # type: ignore[attr-defined]
            if not got:
                raise self.error("the file ends too early", f"byte {self.position}", "it was cut; fetch it again")
            done += got

    def fill_from(self, offset: int, buffer: Bytes) -> None:
        """Read from a given place without moving, from any thread; only where :attr:`positional` says so."""
        done = 0
        while done < len(buffer):
            got = os.preadv(self.stream.fileno(), [buffer.data[done:]], offset + done)
            if not got:
                raise self.error("the file ends too early", f"byte {offset + done}", "it was cut; fetch it again")
            done += got

    @property
    def positional(self) -> bool:
        """Whether bytes can be read from any place by several threads."""
        return self.file is not None and hasattr(os, "preadv")

    def take(self, count: int) -> Bytes:
        """Return the next ``count`` bytes; the caller has compared ``count`` with :attr:`remaining`."""
        buffer = np.empty(count, np.uint8)
        self.fill(buffer)
        return buffer

    def rest(self) -> Bytes:
        """Return all bytes that are still to be read."""
        return self.take(self.remaining)

    @contextmanager
    def named(self) -> Iterator[str]:
        """Give the name of a file with these bytes, for libraries that open files themselves."""
        if self.file is not None:
            yield self.file
            return
        with tempfile.TemporaryDirectory(prefix="surfel-") as folder:
            copy = os.path.join(folder, "copy" + PurePath(self.path).suffix)
            before = self.stream.tell()
            self.stream.seek(0)
            with open(copy, "wb") as stream:
                shutil.copyfileobj(self.stream, stream)
            self.stream.seek(before)
            yield copy

    def line_at(self, offset: int, newline: int = 10) -> int:
        """Return the number of the line (from 1) in which a byte of the file lies."""
        before, line, left = self.stream.tell(), 1, offset
        self.stream.seek(0)
        while left > 0 and (run := self.stream.read(min(left, _RUN))):
            line += run.count(newline)
            left -= len(run)
        self.stream.seek(before)
        return line

    def error(self, problem: str, place: str = "", cure: str = "") -> FileFormatError:
        """Return (not raise) the error that says what is wrong with this file."""
        return FileFormatError(self.path, problem, place, cure)


STANDARD = "-"
_IN_MEMORY = 1 << 26
_RUN = 1 << 20


@contextmanager
def open_source(path: str | PathLike[str]) -> Iterator[Source]:
    """Open a file for reading; "-" is the standard input. A pipe or a device is read to its end first.

    What comes through a pipe is kept in memory up to 64 MB, beyond that in a temporary file.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, or it cannot be opened or read.
    FileFormatError
        If it is empty.
    """
    try:
        name = os.fsdecode(path)
        if name == STANDARD:
            stream = os.fdopen(os.dup(sys.stdin.fileno()), "rb")
        elif os.path.isdir(name):
            raise InputError(f"cannot read {name!r}: it is a folder; name a file in it")
        else:
            stream = open(name, "rb")  # noqa: SIM115 - so that errors of opening and of reading are told apart
    except FileNotFoundError as error:
        raise InputError(f"cannot read {name!r}: there is no such file; check the name and the folder") from error
    except OSError as error:
        raise InputError(f"cannot read {name!r}: {error.strerror or error}") from error
    except InputError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"path must be a file name; got {path!r} ({error})") from error
    try:
        with stream, _sized(name, stream) as source:
            yield source
    except BrokenPipeError:
        raise  # the reader of what is being written has gone
    except OSError as error:
        raise InputError(f"cannot read {name!r}: {error.strerror or error}") from error


@contextmanager
def _sized(name: str, stream: Any) -> Iterator[Source]:
    state = os.fstat(stream.fileno())
    regular = stat.S_ISREG(state.st_mode)
    with stream if regular else _spooled(stream) as whole:
        size = state.st_size if regular else whole.seek(0, 2)
        whole.seek(0)
        if size == 0:
            raise FileFormatError(name, "the file is empty", "byte 0", "write it again")
        yield Source(name, whole, size, name if regular and name != STANDARD else None)


def _spooled(stream: Any) -> Any:
    """Return what a pipe gives, in memory or, where it is much, in a temporary file."""
    kept: Any = io.BytesIO()
    while run := stream.read(_RUN):
        if isinstance(kept, io.BytesIO) and kept.tell() + len(run) > _IN_MEMORY:
            data, kept = kept.getbuffer(), tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
            kept.write(data)
        kept.write(run)
    return kept
