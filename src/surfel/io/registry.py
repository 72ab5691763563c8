"""The one registry of file formats: by suffix, by first bytes, and which module reads and writes each.

A format's module is imported on its first use. It has ``load(source) -> Content`` and, where the format is written,
``save(stream, content, *, ascii, suffix) -> list of str`` (what could not be kept). A ``load`` may return any other
shape; it is then handed on as it is, which is how rooms above bring formats of their own.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from os import PathLike
from pathlib import PurePath
from typing import Any

from surfel.core.errors import InputError
from surfel.io.source import Source


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
    if begun is not None and begun is not named:
        return begun, [f"read as {begun.name}, as its first bytes say, and not as {suffix or 'no suffix'!r}"]
    if named is None:
        raise InputError(
            f"cannot read {source.path!r}: the suffix {suffix!r} is not known, and neither are its first bytes; "
            f"known are {' '.join(suffixes())}"
        )
    return named, []


def format_for_writing(path: str | PathLike[str]) -> Format:
    """Return the format that the suffix of a new file asks for.

    Raises
    ------
    InputError
        If no format with that suffix can be written.
    """
    suffix = PurePath(path).suffix.lower()
    named = _by_suffix(suffix)
    if named is None or not named.holds:
        raise InputError(
            f"cannot write {str(path)!r}: the suffix {suffix!r} is not one that is written; "
            f"use one of {' '.join(suffixes('writing'))}"
        )
    return named


def _by_suffix(suffix: str) -> Format | None:
    return next((f for f in _FORMATS.values() if suffix in f.suffixes), None)
