"""GLB (binary glTF 2.0): the triangles of a scene with the transforms of its nodes. Other geometry is passed over."""

from __future__ import annotations

import json
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, Integers
from surfel.core.errors import FileFormatError
from surfel.io.content import Content
from surfel.io.polygons import fans, strips
from surfel.io.source import Bytes, Source

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3}
_ALLOWED, _RATIO = 1 << 28, 200
_CURE = "the file was cut or changed; export it again"
_JSON, _BINARY = 0x4E4F534A, 0x004E4942


def load(source: Source) -> Content:
    """Read the triangles of the default scene, placed by their nodes; vertices stay as they are stored.

    Normals, colors, textures and animations are passed over. A mesh that is placed several times is repeated.

    Raises
    ------
    FileFormatError
        If the file's lengths do not fit, an index leads nowhere, or it needs an extension that changes the geometry.
    """
    document, buffer = _chunks(source)
    try:
        return _Scene(source, document, buffer).content()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise source.error(f"its description makes no sense: {error!r}"[:200], "JSON chunk", _CURE) from error


def save(stream: BinaryIO, content: Content, *, ascii: bool = False, suffix: str = ".glb") -> list[str]:
    """Write one mesh in single precision, which is all that glTF has.

    Raises
    ------
    InputError
        If a coordinate is too large for single precision.
    """
    lost = content.lost_without("triangles")
    points = content.in_single_precision("GLB", lost)
    triangles = np.asarray(content.triangles, "<u4")
    corners = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "surfel"}, "scene": 0, "scenes": [{}]}
    if len(triangles):
        document |= {
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
                 "min": corners[0].tolist(), "max": corners[1].tolist()},
                {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteLength": points.nbytes},
                {"buffer": 0, "byteOffset": points.nbytes, "byteLength": triangles.nbytes},
            ],
            "buffers": [{"byteLength": points.nbytes + triangles.nbytes}],
        }  # fmt: skip
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = points.nbytes + triangles.nbytes if len(triangles) else 0
    total = 12 + 8 + len(text) + (8 + size if size else 0)
    stream.write(b"glTF" + np.array([2, total, len(text), _JSON], "<u4").tobytes() + text)
    if size:
        stream.write(np.array([size, _BINARY], "<u4").tobytes() + points.tobytes() + triangles.tobytes())
    return lost


def _chunks(source: Source) -> tuple[dict[str, Any], Bytes]:
    """Return the description and the binary chunk, their lengths compared with the file's."""
    data = source.rest()
    if len(data) < 20 or data[:4].tobytes() != b"glTF":
        raise source.error("it has no GLB header", "byte 0", _CURE)
    version, total = data[4:12].view("<u4").tolist()
    if version != 2:
        raise source.error(f"it is glTF version {version}", "byte 4", "export it as glTF 2.0")
    if total != len(data):
        raise source.error(f"its header announces {total} bytes, it has {len(data)}", "byte 8", _CURE)
    chunks: dict[int, Bytes] = {}
    at = 12
    while at < total:
        if at + 8 > total:
            raise source.error("a chunk has no whole header", f"byte {at}", _CURE)
        length, kind = data[at : at + 8].copy().view("<u4").tolist()
        if at + 8 + length > total:
            raise source.error(f"a chunk announces {length} bytes, {total - at - 8} follow", f"byte {at}", _CURE)
        chunks.setdefault(kind, data[at + 8 : at + 8 + length])
        at += 8 + length
    if _JSON not in chunks:
        raise source.error("it has no description", "byte 12", _CURE)
    try:
        document = json.loads(chunks[_JSON].tobytes())
    except ValueError as error:
        raise source.error(f"its description cannot be read: {error}", "JSON chunk", _CURE) from error
    if not isinstance(document, dict):
        raise source.error("its description is no object", "JSON chunk", _CURE)
    return document, chunks.get(_BINARY, data[:0])


class _Scene:
    """Walks over the nodes of a scene and collects placed triangles."""

    def __init__(self, source: Source, document: dict[str, Any], buffer: Bytes) -> None:
        self._source = source
        self._document = document
        self._buffer = buffer
        self._points: list[Floats] = []
        self._triangles: list[Integers] = []
        self._vertices = 0
        self._passed = 0

    def content(self) -> Content:
        needed = set(self._document.get("extensionsRequired", [])) - {"KHR_mesh_quantization", "KHR_texture_transform"}
        changed = sorted(str(e) for e in needed if not str(e).startswith(("KHR_materials", "KHR_lights")))
        if changed:
            raise self._source.error(f"it needs {', '.join(changed)}", "JSON chunk", "export it without compression")
        for node, matrix in self._placed():
            if "mesh" in node:
                for primitive in self._item("meshes", node["mesh"])["primitives"]:
                    self._add(primitive, matrix)
        if not self._points:
            raise self._source.error(
                "its scene has no triangles", "JSON chunk", "it holds nothing that can be measured"
            )
        notes = [f"{self._passed} primitives of points or lines were passed over"] if self._passed else []
        return Content(np.concatenate(self._points), np.concatenate(self._triangles), notes=notes)

    def _placed(self) -> list[tuple[dict[str, Any], Floats]]:
        """Return each node of the scene with its matrix into the world."""
        nodes = self._document.get("nodes", [])
        if self._document.get("scenes"):
            roots = self._item("scenes", self._document.get("scene", 0)).get("nodes", [])
        else:
            children = {c for node in nodes for c in node.get("children", [])}
            roots = [i for i in range(len(nodes)) if i not in children]
        todo = [(root, np.eye(4)) for root in roots]
        seen: set[int] = set()
        placed = []
        while todo:
            index, above = todo.pop(0)
            node = self._item("nodes", index)
            if index in seen:
                raise self._source.error(f"node {index} hangs in the scene twice", "JSON chunk", _CURE)
            seen.add(index)
            matrix = above @ _local(node)
            if not np.isfinite(matrix).all():
                raise self._source.error(f"the matrix of node {index} is not finite", "JSON chunk", _CURE)
            placed.append((node, matrix))
            todo += [(child, matrix) for child in node.get("children", [])]
        return placed

    def _add(self, primitive: dict[str, Any], matrix: Floats) -> None:
        """Add the triangles of one primitive."""
        mode = primitive.get("mode", 4)
        if mode in (0, 1, 2, 3):
            self._passed += 1
            return
        stored = self._accessor(primitive["attributes"]["POSITION"], "VEC3")
        count = len(stored)
        corners = (
            self._accessor(primitive["indices"], "SCALAR")[:, 0].astype(np.int64)
            if "indices" in primitive
            else np.arange(count)
        )
        if len(corners) and int(corners.max()) >= count:
            raise self._source.error(f"a triangle names vertex {int(corners.max())} of {count}", "binary chunk", _CURE)
        if mode == 4:
            if len(corners) % 3:
                raise self._source.error(f"{len(corners)} corners are no whole triangles", "binary chunk", _CURE)
            triangles = corners.reshape(-1, 3)
        elif mode in (5, 6):
            triangles = (strips if mode == 5 else fans)(corners, np.array([len(corners)]))
        else:
            raise self._source.error(f"unknown kind of primitive {mode}", "JSON chunk", _CURE)
        self._vertices += count + len(triangles)
        if 24 * self._vertices > max(_ALLOWED, _RATIO * self._source.size):
            raise self._source.error(
                "its nodes repeat meshes beyond measure", "JSON chunk", "export what is seen only once"
            )
        if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored: the same side stays outside
            triangles = triangles[:, ::-1]
        self._triangles.append(triangles + sum(len(p) for p in self._points))
        self._points.append(stored.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])

    def _accessor(self, index: int, kind: str) -> NDArray[Any]:
        """Return the values behind an accessor, shape (n, width)."""
        accessor = self._item("accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise self._source.error(
                f"accessor {index} is sparse or empty", "JSON chunk", "export it with plain arrays"
            )
        component = np.dtype(_TYPES[accessor["componentType"]])
        if accessor["type"] != kind or (kind == "SCALAR" and component.kind == "f"):
            raise self._source.error(f"accessor {index} does not hold {kind}", "JSON chunk", _CURE)
        view = self._item("bufferViews", accessor["bufferView"])
        if view.get("buffer", 0) != 0 or "uri" in self._item("buffers", 0):
            raise self._source.error("its data lies in another file", "JSON chunk", "export it as one GLB file")
        width = _WIDTHS[kind] * component.itemsize
        count, stride = accessor["count"], view.get("byteStride", width)
        begin, within = view.get("byteOffset", 0), accessor.get("byteOffset", 0)
        length = view["byteLength"]
        numbers = (count, stride, begin, within, length)
        last = within + (count - 1) * stride + width if count else within
        if any(type(n) is not int or n < 0 for n in numbers) or stride < width or last > length:
            raise self._source.error(f"accessor {index} goes beyond its view", "JSON chunk", _CURE)
        if begin + length > len(self._buffer):
            raise self._source.error(f"accessor {index} goes beyond the binary chunk", "JSON chunk", _CURE)
        start = begin + within
        if stride == width:
            values = self._buffer[start : start + count * width].copy().view(component).reshape(count, -1)
        else:
            octets = self._buffer[start + np.arange(count)[:, None] * stride + np.arange(width)]
            values = octets.view(component)
        if accessor.get("normalized") and component.kind in "iu":
            return np.maximum(values / np.iinfo(component).max, -1.0)
        return values

    def _item(self, what: str, index: Any) -> dict[str, Any]:
        items = self._document[what]
        if type(index) is not int or not 0 <= index < len(items) or not isinstance(items[index], dict):
            raise FileFormatError(self._source.path, f"there is no {what}[{str(index)[:20]}]", "JSON chunk", _CURE)
        found: dict[str, Any] = items[index]
        return found


def _local(node: dict[str, Any]) -> Floats:
    """Return the matrix of a node: as given, or from translation, rotation (a quaternion x y z w) and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), np.float64)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64).reshape(1, 3)
    matrix[:3, 3] = np.array(node.get("translation", (0.0, 0.0, 0.0)), np.float64).reshape(3)
    return matrix
