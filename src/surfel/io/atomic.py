"""Files are written beside their target and renamed: on any failure the old file is whole and nothing is left over."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from surfel.core.errors import InputError

_IN_MEMORY = 1 << 26


@contextmanager
def replacing(path: str | PathLike[str]) -> Iterator[BinaryIO]:
    """Open a temporary file beside ``path`` for binary writing and rename it over ``path`` when the block succeeds.

    Whatever ends the block early (an error, a full disk, Ctrl-C) removes the temporary file and leaves an old file as
    it was. The permissions of an old file are kept and a symbolic link is followed. A device, a pipe or the standard
    output ("-") cannot be replaced: it gets the whole file at the end.

    Parameters
    ----------
    path : str or path-like
        The target. Its folder has to exist. "-" is the standard output.

    Yields
    ------
    BinaryIO
        A writable binary stream that can be moved in, as a header with counts needs it.

    Raises
    ------
    InputError
        If the target cannot be written: no such folder, a folder, no permission, a full disk.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> with replacing(folder.name + "/note.txt") as stream:
    ...     _ = stream.write(b"done")
    >>> open(folder.name + "/note.txt").read()
    'done'
    >>> folder.cleanup()
    """
    if isinstance(path, str) and path == "-":
        with _passed_on("the standard output", lambda: os.fdopen(os.dup(sys.stdout.fileno()), "wb")) as stream:
            yield stream
        return
    target, old = _checked_target(path)
    if old is not None and not stat.S_ISREG(old.st_mode):
        with _passed_on(path, lambda: open(target, "wb")) as stream:
            yield stream
        return
    beside = target.with_name(f".surfel-{secrets.token_hex(6)}.part")  # short: the target's own name may fill the limit
    with _writing_to(path):
        try:
            with open(beside, "xb") as stream:
                yield stream
            if old is not None:
                os.chmod(beside, stat.S_IMODE(old.st_mode))
            os.replace(beside, target)
        except BaseException:
            with suppress(OSError):
                beside.unlink()
            raise


@contextmanager
def _passed_on(path: str | PathLike[str], opened: Callable[[], BinaryIO]) -> Iterator[BinaryIO]:
    """Collect what is written, in memory or, where it is much, in a file; pass it on when the block succeeds."""
    with tempfile.SpooledTemporaryFile(max_size=_IN_MEMORY) as spool:
        with _writing_to(path):
            yield spool  # type: ignore[misc]
        spool.seek(0)
        with _writing_to(path), opened() as stream:
            shutil.copyfileobj(spool, stream)


@contextmanager
def _writing_to(path: str | PathLike[str]) -> Iterator[None]:
    """Turn what the system says about a failed write into one clear line."""
    try:
        yield
    except BrokenPipeError:
        raise  # the reader of a pipe has gone, which is no fault
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"cannot write {os.fspath(path)!r}: {reason}; nothing was changed there") from error


def _checked_target(path: str | PathLike[str]) -> tuple[Path, os.stat_result | None]:
    """Return the file behind ``path`` and its state (None if it is new), or say why it cannot be written."""
    try:
        target = Path(os.path.realpath(path))
        old = target.stat() if target.exists() else None
    except (TypeError, ValueError, OSError) as error:
        raise InputError(f"cannot write to {path!r}: {error}") from error
    if old is not None and stat.S_ISDIR(old.st_mode):
        raise InputError(f"cannot write {os.fspath(path)!r}: it is a folder; name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {os.fspath(path)!r}: there is no folder {str(target.parent)!r}; make it first")
    if old is not None and not os.access(target, os.W_OK):
        raise InputError(f"cannot write {os.fspath(path)!r}: the file there is read-only; remove it or name another")
    return target, old
