"""The XML description in an E57 file: which scans there are, where they stood, and what their points are made of.

Source: ASTM E2807-11, chapter 8 (the data model).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats
from surfel.io.source import Source

SPACE = "http://www.astm.org/COMMIT/E57/2010-e57-v1.0"
OWN_SPACE = "urn:surfel:attributes"
OWN = "s:"
"""What the names of attributes begin with that surfel wrote under their own names."""
_DAMAGED = "the description was damaged; fetch the file again"
_DEEPEST = 16
_MOST_FIELDS = 4096


@dataclass(frozen=True)
class Number:
    """One value of a point: how it is stored and what it means.

    ``kind`` is "float32", "float64", "integer" (``low`` plus ``bits`` bits), "scaled" (that times ``scale`` plus
    ``offset``) or "skipped" (a string).
    """

    name: str
    kind: str
    low: int = 0
    high: int = 0
    scale: float = 1.0
    offset: float = 0.0

    @property
    def bits(self) -> int:
        """How many bits a stored value takes."""
        return {"float32": 32, "float64": 64}.get(self.kind, (self.high - self.low).bit_length())

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type that holds all values."""
        if self.kind in ("float32", "float64"):
            return np.dtype(self.kind)
        if self.kind == "scaled":
            return np.dtype(np.float64)
        kinds = map(np.dtype, ("u1", "i1", "u2", "i2", "u4", "i4", "i8"))
        return next(k for k in kinds if np.iinfo(k).min <= self.low and self.high <= np.iinfo(k).max)

    def values(self, raw: NDArray[np.uint64]) -> NDArray[Any]:
        """Return what stored bits mean."""
        if self.kind == "float32":
            return raw.astype(np.uint32).view(np.float32)
        if self.kind == "float64":
            return raw.view(np.float64)
        whole = raw + np.uint64(self.low & 0xFFFFFFFFFFFFFFFF)  # modulo 2^64, as the two's complement goes
        if self.low < 0:
            whole = whole.view(np.int64)
        return whole * self.scale + self.offset if self.kind == "scaled" else whole.astype(self.dtype)


@dataclass(frozen=True)
class Scan:
    """One scan: its points as they are stored, and its pose (world = rotation @ local + translation)."""

    name: str
    guid: str
    place: int
    count: int
    numbers: tuple[Number, ...]
    rotation: Floats
    translation: Floats


def scans_of(source: Source, xml: bytes) -> tuple[list[Scan], str]:
    """Return the scans of a file and its coordinate system.

    Raises
    ------
    FileFormatError
        If the description is no XML, or lacks something.
    """
    if b"<!DOCTYPE" in xml or b"<!ENTITY" in xml:
        raise source.error("its description declares entities, which E57 does not have", "description", _DAMAGED)
    try:
        root = ElementTree.fromstring(xml.rstrip(b"\0"))
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise source.error(f"its description is no XML ({error})", "description", _DAMAGED) from None
    scans = []
    for i, child in enumerate(_all(root, "data3D/vectorChild")):
        try:
            scans.append(_scan(child, i))
        except (ValueError, OverflowError) as error:
            raise source.error(f"scan {i}: {error}", "description", _DAMAGED) from None
    return scans, _text(root, "coordinateMetadata").strip()


def _scan(element: ElementTree.Element, index: int) -> Scan:
    points = _one(element, "points")
    if points is None or points.get("type") != "CompressedVector":
        raise ValueError("it has no points")
    prototype = _one(points, "prototype")
    numbers: list[Number] = []
    if prototype is not None:
        _collect(prototype, "", numbers, 0)
    if not numbers:
        raise ValueError("nothing tells what its points are made of")
    codecs = _one(points, "codecs")
    others = {_local(c.tag) for c in codecs.iter()} - {"bitPackCodec"} if codecs is not None else set()
    if any(tag.endswith("Codec") for tag in others):
        raise ValueError("its points are packed in an unknown way; only bit packing is read")
    count, place = int(points.get("recordCount", "")), int(points.get("fileOffset", ""))
    if count < 0 or place < 0:
        raise ValueError(f"it has {count} points at byte {place}")
    return Scan(
        _text(element, "name") or f"scan {index}", _text(element, "guid"), place, count, tuple(numbers),
        _rotation(element), np.array([_real(element, f"pose/translation/{axis}", 0.0) for axis in "xyz"]),
    )  # fmt: skip


def _collect(element: ElementTree.Element, before: str, numbers: list[Number], depth: int) -> None:
    """Append the values of a point in the order in which they are stored: depth first."""
    if depth > _DEEPEST:
        raise ValueError("the description of its points is nested too deeply")
    for child in element:
        own = OWN if child.tag.startswith(f"{{{OWN_SPACE}}}") else ""
        name, kind = before + own + _local(child.tag), child.get("type", "")
        if len(numbers) >= _MOST_FIELDS:
            raise ValueError("its points have too many values")
        if kind in ("Structure", "Vector"):
            _collect(child, name + ".", numbers, depth + 1)
        elif kind == "Float":
            numbers.append(Number(name, "float32" if child.get("precision") == "single" else "float64"))
        elif kind in ("Integer", "ScaledInteger"):
            low, high = int(child.get("minimum", str(-(2**63)))), int(child.get("maximum", str(2**63 - 1)))
            if low > high or low < -(2**63) or high >= 2**63:
                raise ValueError(f"{name} goes from {low} to {high}")
            scale, offset = float(child.get("scale", "1")), float(child.get("offset", "0"))
            if not (math.isfinite(scale) and math.isfinite(offset)):
                raise ValueError(f"{name} has the scale {scale} and the offset {offset}")
            numbers.append(Number(name, "integer" if kind == "Integer" else "scaled", low, high, scale, offset))
        elif kind == "String":
            numbers.append(Number(name, "skipped"))
        else:
            raise ValueError(f"{name} is of the unknown type {kind!r}")


def _rotation(element: ElementTree.Element) -> Floats:
    """Return the rotation that a unit quaternion w, x, y, z stands for."""
    if _one(element, "pose/rotation") is None:
        return np.eye(3)
    w, x, y, z = (_real(element, f"pose/rotation/{part}", float(part == "w")) for part in "wxyz")
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if not 1e-6 < size < 1e6:
        raise ValueError(f"its pose has the quaternion {(w, x, y, z)}")
    w, x, y, z = w / size, x / size, y / size, z / size
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _real(element: ElementTree.Element, path: str, default: float) -> float:
    found = _one(element, path)
    if found is None:
        return default
    value = float(found.text or "0")  # an empty element is zero
    if not math.isfinite(value):
        raise ValueError(f"{path} is {value}")
    return value


def _text(element: ElementTree.Element, path: str) -> str:
    found = _one(element, path)
    return (found.text or "") if found is not None else ""


def _one(element: ElementTree.Element, path: str) -> ElementTree.Element | None:
    found = _all(element, path)
    return found[0] if found else None


def _all(element: ElementTree.Element, path: str) -> list[ElementTree.Element]:
    return element.findall("/".join(f"{{{SPACE}}}{part}" for part in path.split("/")))


def _local(tag: str) -> str:
    return re.sub(r"^\{.*\}", "", tag)
