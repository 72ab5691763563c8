"""A safe spline in a file: an NPZ of plain arrays, read strictly; an old file is replaced at once or not at all."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, fields
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from surfel.bounding.frame import Frame
from surfel.bounding.occupancy import WHOLE
from surfel.bounding.report import FitReport
from surfel.core.errors import FileFormatError
from surfel.io.atomic import replacing
from surfel.io.npy import read_array
from surfel.io.source import Source, open_source

if TYPE_CHECKING:
    from surfel.bounding.spline import SafeSpline

_KIND, _VERSION = "surfel safe spline", 2
_MEMORY = "memory_"
_FRAME = {"rotation": (3, 3), "low": (2,), "scale": (2,), "cells": (2,), "origin": (2,)}
_CUT = "the file was cut or changed; write it again"
_OTHER = "give a file that SafeSpline.save wrote"


def save(spline: SafeSpline, path: str | PathLike[str]) -> None:
    """Write the spline; the target is replaced at once or left as it was."""
    words = {
        "kind": _KIND, "version": _VERSION, "side": spline.side, "boundary": spline.boundary,
        "report": asdict(spline.report),
    }  # fmt: skip
    arrays: dict[str, NDArray[Any]] = {
        "words": np.frombuffer(json.dumps(words).encode(), np.uint8),
        **{name: getattr(spline.frame, name) for name in _FRAME},
        "coefficients": spline.coefficients,
        "occupancy": spline.occupancy,
        "trim": spline.trim,
    }
    if spline.memory is not None:
        arrays |= {_MEMORY + name: np.asarray(array) for name, array in spline.memory.to_arrays().items()}
    with replacing(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            entry = zipfile.ZipInfo(name + ".npy")  # with no time of day: the same spline gives the same bytes
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as member:
                npy_format.write_array(member, np.asarray(array, order="C"), allow_pickle=False)


def load(path: str | PathLike[str]) -> SafeSpline:
    """Read what :func:`save` wrote.

    Raises
    ------
    InputError
        If the file cannot be opened.
    FileFormatError
        If it is cut, changed or something else.
    """
    with open_source(path) as source:
        arrays = _arrays(source)
        words = _words(source, arrays)
        return _spline_of(source, arrays, words)


def _arrays(source: Source) -> dict[str, NDArray[Any]]:
    try:
        with zipfile.ZipFile(source.stream) as archive:
            found = {}
            for entry in archive.infolist():
                name = entry.filename.removesuffix(".npy")
                if name in found or entry.file_size > 1100 * source.size:  # deflate packs no tighter
                    raise source.error(f"the array {name!r} comes twice or claims too much", "zip directory", _CUT)
                with archive.open(entry) as member:
                    found[name] = read_array(source, member, entry.file_size, f"the array {name!r}")
                    if member.read(1):  # reaches the end, where the checksum is compared
                        raise source.error(f"the array {name!r} goes on after its end", "zip", _CUT)
            return found
    except (MemoryError, RecursionError, FileFormatError):
        raise
    except Exception as error:  # zipfile and zlib have many errors, for every field that can be wrong
        raise source.error(f"the zip cannot be read: {type(error).__name__}: {error}", "zip", _OTHER) from error


def _words(source: Source, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    try:
        words = json.loads(arrays["words"].astype(np.uint8).tobytes())
        kind, version = words["kind"], words["version"]
    except (KeyError, ValueError, TypeError) as error:
        raise source.error("it holds no safe spline", "the array 'words'", _OTHER) from error
    if kind != _KIND or version != _VERSION:
        raise source.error(
            f"it holds {kind!r} in version {version!r}; expected {_KIND!r} in version {_VERSION}", "the array 'words'",
            "read it with the version of surfel that wrote it",
        )  # fmt: skip
    return dict(words)


def _spline_of(source: Source, arrays: dict[str, NDArray[Any]], words: dict[str, Any]) -> SafeSpline:
    from surfel.bounding.spline import SafeSpline

    parts = {name: _checked(source, arrays, name, shape) for name, shape in _FRAME.items()}
    rows, columns = (int(count) for count in parts["cells"])
    if not (3 <= rows < 1 << 20 and 3 <= columns < 1 << 20 and (parts["scale"] > 0.0).all()):
        raise source.error(f"a grid of {rows} x {columns} cells, scale {parts['scale']}", "the array 'cells'", _CUT)
    if not ((parts["origin"] >= 0) & (parts["origin"] < parts["cells"])).all():
        raise source.error(f"the origin lies at cell {parts['origin']}", "the array 'origin'", _CUT)
    if not np.allclose(parts["rotation"] @ parts["rotation"].T, np.eye(3), atol=1e-12):
        raise source.error("the axes are not orthonormal", "the array 'rotation'", _CUT)
    coefficients = _checked(source, arrays, "coefficients", (rows + 3, columns + 3))
    masks = {}
    for name in ("occupancy", "trim"):
        masks[name] = _checked(source, arrays, name, (rows, columns), np.uint8)
        if int(masks[name].max()) > WHOLE:
            raise source.error(f"{name} holds {masks[name].max()}; expected 0 to {WHOLE}", f"the array {name!r}", _CUT)
    if (masks["occupancy"] & ~masks["trim"]).any():
        raise source.error("the trim leaves out cells that have data", "the array 'trim'", _CUT)
    side, boundary = words.get("side"), words.get("boundary")
    if side not in ("above", "below") or boundary not in ("open", "clamped"):
        raise source.error(f"side {side!r}, boundary {boundary!r}", "the array 'words'", _CUT)
    report, memory = _report(source, words.get("report")), _memory(source, arrays)
    frame = Frame(**parts)
    return SafeSpline(frame, coefficients, str(side), str(boundary), masks["occupancy"], masks["trim"], report, memory)


def _checked(
    source: Source, arrays: dict[str, NDArray[Any]], name: str, shape: tuple[int, ...], kind: type = np.float64
) -> NDArray[Any]:
    array = arrays.get(name)
    if array is None or array.shape != shape:
        got = "absent" if array is None else f"of shape {array.shape}"
        raise source.error(f"the array {name!r} is {got}; expected shape {shape}", "zip", _CUT)
    wanted = np.dtype(np.int64 if name in ("cells", "origin") else kind)
    if array.dtype != wanted or (wanted.kind == "f" and not np.isfinite(array).all()):
        raise source.error(f"the array {name!r} is not finite or not {wanted}", f"the array {name!r}", _CUT)
    return array


def _report(source: Source, words: Any) -> FitReport:
    names = {field.name for field in fields(FitReport)}
    if not isinstance(words, dict) or not set(words) <= names:
        raise source.error("the report is garbled", "the array 'words'", _CUT)
    numbers = [value for name, value in words.items() if name not in ("mode", "warnings")]
    if not all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in numbers):
        raise source.error("the report is garbled", "the array 'words'", _CUT)
    try:
        return FitReport(**{**words, "warnings": tuple(words.get("warnings", ()))})
    except TypeError as error:
        raise source.error(f"the report is garbled: {error}", "the array 'words'", _CUT) from error


def _memory(source: Source, arrays: dict[str, NDArray[Any]]) -> Any:
    kept = {name.removeprefix(_MEMORY): array for name, array in arrays.items() if name.startswith(_MEMORY)}
    if not kept:
        return None
    from surfel.bounding.memory import Memory

    try:
        return Memory.from_arrays(kept)
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise source.error(f"what it remembers of the points is garbled: {error}", "zip", _CUT) from error
