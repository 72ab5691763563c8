"""The one registry of file formats: by suffix, by first bytes, and which module reads and writes each.

A format's module is imported on its first use. It has

- ``load(source) -> Content``, the whole file. It may return any other shape, which is then handed on as it is: that
  is how rooms above bring formats of their own;
- ``head(source) -> Head or None``, what the header alone tells;
- ``chunks(source, size) -> iterator of Content or None``, run after run of at most ``size`` points with flat memory,
  all with the same columns, without triangles, at least one (of no points, if need be);
- ``SELECTS``, which of the options it applies itself; then ``load`` and ``chunks`` take them as their last argument,
  and where it selects by place or class it counts ``every`` too;
- ``save(stream, content, *, ascii, suffix) -> list of str``, which returns what could not be kept;
- ``writer(stream, first, head, *, suffix) -> Writer or None``, which takes run after run; ``first`` shows the columns.
  With ``NEEDS_BOUNDS`` the head has bounds.

Only ``load`` is needed. None of the optional ones means: not for this file; the doors then use ``load`` and ``save``.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from os import PathLike
from pathlib import PurePath
from typing import Any

from surfel.core.errors import InputError
from surfel.io.source import Source


class NotStreamed(Exception):
    """The file can be read, or the target written, only whole; a writer of runs may raise it at any run."""


@dataclass(frozen=True)
class Format:
    """One family of files.

    Parameters
    ----------
    name : str
        What ``info`` and the provenance call it.
    suffixes : tuple of str
        Lower case, with the dot; the first is the usual one.
    module : str
        The module that reads and writes it, imported on first use.
    magic : tuple of bytes
        What every such file begins with; empty where nothing tells.
    holds : frozenset of str
        What can be written: "points", "mesh", both or nothing.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    magic: tuple[bytes, ...] = ()
    holds: frozenset[str] = frozenset()

    @property
    def codec(self) -> Any:
        """The module, imported now if it was not before."""
        return importlib.import_module(self.module)


_BOTH = frozenset({"points", "mesh"})
_OFF = tuple(prefix + b"OFF" for prefix in (b"", b"C", b"N", b"CN", b"ST", b"STN", b"STC", b"STCN"))
_FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("ply", (".ply",), "surfel.io.ply", (b"ply\n", b"ply\r", b"ply ", b"ply\t"), _BOTH),
        Format("text", (".xyz", ".csv", ".txt", ".asc"), "surfel.io.text", (), frozenset({"points"})),
        Format("npy", (".npy",), "surfel.io.npy", (b"\x93NUMPY",), frozenset({"points"})),
        Format("npz", (".npz",), "surfel.io.npz", (b"PK\x03\x04", b"PK\x05\x06"), frozenset({"points"})),
        Format("obj", (".obj",), "surfel.io.obj", (), _BOTH),
        Format("stl", (".stl",), "surfel.io.stl", (), frozenset({"mesh"})),
        Format("off", (".off",), "surfel.io.off", _OFF, _BOTH),
        Format("pcd", (".pcd",), "surfel.io.pcd", (b"# .PCD", b"VERSION .", b"VERSION 0."), frozenset({"points"})),
        Format("las", (".las", ".laz"), "surfel.io.las", (b"LASF",), frozenset({"points"})),
        Format("e57", (".e57",), "surfel.io.e57", (b"ASTM-E57",), frozenset({"points"})),
        Format("pts", (".pts",), "surfel.io.pts", (), frozenset({"points"})),
        Format("ptx", (".ptx",), "surfel.io.ptx", ()),
        Format("glb", (".glb",), "surfel.io.glb", (b"glTF",), frozenset({"mesh"})),
    )
}


def register(added: Format) -> None:
    """Add a format, or replace the one of the same name.

    Raises
    ------
    InputError
        If one of its suffixes belongs to another format.
    """
    for suffix in added.suffixes:
        other = _by_suffix(suffix)
        if other is not None and other.name != added.name:
            raise InputError(f"the suffix {suffix!r} belongs to the format {other.name!r} already")
    _FORMATS[added.name] = added


def suffixes(purpose: str = "reading") -> tuple[str, ...]:
    """Return every known suffix, for "reading" or for "writing"."""
    return tuple(s for f in _FORMATS.values() if purpose == "reading" or f.holds for s in f.suffixes)


def format_for_reading(source: Source) -> tuple[Format, list[str]]:
    """Return the format of a file and what has to be said about the choice.

    What the file begins with decides; its suffix only where no known beginning is found. A file whose suffix belongs to
    a format with a known beginning, but which does not begin so, is left to that format's reader to refuse.

    Raises
    ------
    InputError
        If neither the beginning nor the suffix is known.
    """
    head = source.head(16)
    suffix = PurePath(source.path).suffix.lower()
    named = _by_suffix(suffix)
    begun = next((f for f in _FORMATS.values() if f.magic and head.startswith(f.magic)), None)
    if begun is not None and source.path == "-":
        return begun, []
    if begun is not None and begun is not named:
        return begun, [f"read as {begun.name}, as its first bytes say, and not as {suffix or 'no suffix'!r}"]
    if named is None and source.path == "-":
        return _FORMATS["text"], ["read as text, because what came through the pipe begins like no other format"]
    if named is None:
        raise InputError(
            f"cannot read {source.path!r}: the suffix {suffix!r} is not known, and neither are its first bytes; "
            f"known are {' '.join(suffixes())}"
        )
    return named, []


def format_for_writing(path: str | PathLike[str], to: str | None = None) -> tuple[Format, str]:
    """Return the format that a new file is asked for, and the suffix that says so.

    Parameters
    ----------
    path : str or path-like
        The new file; "-" is the standard output, where PLY is written unless ``to`` says otherwise.
    to : str, optional
        A suffix, with or without its dot, that decides instead of that of ``path``.

    Raises
    ------
    InputError
        If no format with that suffix can be written.
    """
    try:
        name = PurePath(os.fsdecode(path)).name
    except TypeError as error:
        raise InputError(f"path must be a file name; got {type(path).__name__} ({error})") from error
    suffix = PurePath(name).suffix.lower()
    if to is not None:
        suffix = "." + str(to).lower().removeprefix(".")
    elif name == "-":
        suffix = ".ply"
    named = _by_suffix(suffix)
    if to is None and name.lower().endswith(".copc.laz"):
        raise InputError(f"cannot write {name!r}: COPC is read, not written; name it .laz without .copc")
    if named is None or not named.holds:
        raise InputError(
            f"cannot write {os.fsdecode(path)!r}: the suffix {suffix!r} is not one that is written; "
            f"use one of {' '.join(suffixes('writing'))}"
        )
    return named, suffix


def _by_suffix(suffix: str) -> Format | None:
    return next((f for f in _FORMATS.values() if suffix in f.suffixes), None)
