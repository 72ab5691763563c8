"""A file being read: its stream, its size, and errors that know its name."""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
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
    """

    def __init__(self, path: str, stream: BinaryIO, size: int) -> None:
        self.path = path
        self.stream = stream
        self.size = size

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

    def take(self, count: int) -> Bytes:
        """Return the next ``count`` bytes; the caller has compared ``count`` with :attr:`remaining`."""
        buffer = np.empty(count, np.uint8)
        self.fill(buffer)
        return buffer

    def rest(self) -> Bytes:
        """Return all bytes that are still to be read."""
        return self.take(self.remaining)

    def error(self, problem: str, place: str = "", cure: str = "") -> FileFormatError:
        """Return (not raise) the error that says what is wrong with this file."""
        return FileFormatError(self.path, problem, place, cure)


@contextmanager
def open_source(path: str | PathLike[str]) -> Iterator[Source]:
    """Open a file for reading; a pipe or a device is read to its end first.

    Raises
    ------
    InputError
        If there is no such file, it is a folder, or it cannot be opened or read.
    FileFormatError
        If it is empty.
    """
    try:
        name = os.fsdecode(path)
        if os.path.isdir(name):
            raise InputError(f"cannot read {name!r}: it is a folder; name a file in it")
        stream = open(name, "rb")  # noqa: SIM115 - so that errors of opening and of reading are told apart
    except FileNotFoundError as error:
        raise InputError(f"cannot read {name!r}: there is no such file; check the name and the folder") from error
    except OSError as error:
        raise InputError(f"cannot read {name!r}: {error.strerror or error}") from error
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"path must be a file name; got {path!r} ({error})") from error
    with stream:
        try:
            yield _sized(name, stream)
        except OSError as error:
            raise InputError(f"cannot read {name!r}: {error.strerror or error}") from error


def _sized(name: str, stream: Any) -> Source:
    state = os.fstat(stream.fileno())
    size = state.st_size
    if not stat.S_ISREG(state.st_mode):
        data = stream.read()
        stream, size = io.BytesIO(data), len(data)
    if size == 0:
        raise FileFormatError(name, "the file is empty", "byte 0", "write it again")
    return Source(name, stream, size)
