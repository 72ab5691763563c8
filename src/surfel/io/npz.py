"""NPZ: a zip of arrays ``points``, ``normals``, ``colors``, ``radii``, and any further array of as many rows."""

from __future__ import annotations

import zipfile
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from surfel.core.errors import FileFormatError
from surfel.io.content import Content
from surfel.io.npy import content_of_array, native, read_array
from surfel.io.source import Source

_POINTS = ("points", "xyz", "vertices", "positions")
_RESERVED = ("points", "normals", "colors", "radii")
_ALLOWED, _RATIO = 1 << 28, 200
_CUT = "the file was cut or changed; write it again"


def load(source: Source) -> Content:
    """Read a zip of arrays; one that would unpack to more than 256 MB and 200 times its own size is refused.

    Raises
    ------
    FileFormatError
        If the zip or an array in it is damaged, there are no points, or rows do not fit.
    """
    arrays = _arrays(source)
    name = next((n for n in _POINTS if n in arrays), None)
    if name is None and len(arrays) == 1:
        name = next(iter(arrays))
    if name is None:
        raise source.error(f"it holds the arrays {', '.join(arrays) or '(none)'}", "zip", "name the points 'points'")
    content = content_of_array(source, arrays.pop(name))
    rows = len(content.points)
    if "normals" in arrays:
        content.normals = _numbers(source, "normals", arrays.pop("normals"), (rows, 3)).astype(np.float64)
    if "radii" in arrays:
        content.radii = _numbers(source, "radii", arrays.pop("radii"), (rows,)).astype(np.float64)
    if "colors" in arrays:
        colors = arrays.pop("colors")
        content.colors = native(_numbers(source, "colors", colors, (rows, 4 if colors.shape[1:] == (4,) else 3)))
    for other, array in arrays.items():
        if array.ndim and len(array) == rows:
            content.attributes[other] = native(array)
        else:
            content.notes.append(f"the array {other!r} of shape {array.shape} was passed over")
    return content


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".npz") -> list[str]:
    """Write all that is known of the points, each in its own type."""
    known = {name: getattr(content, name) for name in _RESERVED}
    arrays: dict[str, NDArray[Any]] = {name: array for name, array in known.items() if array is not None}
    lost = content.lost_without("normals", "colors", "radii", "attributes")
    for name, values in content.attributes.items():
        word = name.replace("\0", "_") or "unnamed"
        while word in arrays or word in _RESERVED:
            word += "_"
        if word != name:
            lost.append(f"the name {name!r} (written as {word!r})")
        arrays[word] = values
    with zipfile.ZipFile(stream, "w", allowZip64=True) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(name + ".npy")  # with no time of day: the same content gives the same bytes
            with archive.open(entry, "w", force_zip64=True) as member:
                npy_format.write_array(member, np.ascontiguousarray(array), allow_pickle=False)
    return lost


def _arrays(source: Source) -> dict[str, NDArray[Any]]:
    """Unpack every array, within the limits."""
    try:
        with zipfile.ZipFile(source.stream) as archive:
            entries = [e for e in archive.infolist() if e.filename.endswith(".npy")]
            total = sum(e.file_size for e in entries)
            if total > max(_ALLOWED, _RATIO * source.size):
                raise source.error(
                    f"its {source.size} bytes claim to unpack to {total}", "zip directory",
                    "if you trust it, unpack it yourself and give the arrays to surfel.Surfels",
                )  # fmt: skip
            arrays = {}
            for entry in entries:
                name = entry.filename[: -len(".npy")]
                if name in arrays:
                    raise source.error(f"the array {name!r} comes twice", "zip directory", _CUT)
                with archive.open(entry) as member:
                    arrays[name] = read_array(source, member, entry.file_size, f"the array {name!r}")
                    if member.read(1):  # reaches the end, where the checksum is compared
                        raise source.error(f"the array {name!r} goes on after its end", "zip", _CUT)
            return arrays
    except (MemoryError, RecursionError, FileFormatError):
        raise
    except Exception as error:  # zipfile, zlib, lzma and bz2 have many errors, for every field that can be wrong
        raise source.error(f"the zip cannot be read: {type(error).__name__}: {error}", "zip", _CUT) from error


def _numbers(source: Source, name: str, array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if array.shape != shape or array.dtype.kind not in "fiub":
        raise source.error(
            f"the array {name!r} has shape {array.shape} and type {array.dtype}; expected {shape}", "zip",
            "save one row for each point",
        )  # fmt: skip
    return array
