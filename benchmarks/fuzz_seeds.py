"""Small valid files of every format and flavour, made in memory: what the fuzzing damages."""

from __future__ import annotations

import os
import struct
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from surfel.core.errors import MissingExtraError

ROWS = 12


def seeds() -> dict[str, bytes]:
    """Return the files by names with their suffixes; real COPC and E57 files join where the data folder has them."""
    return dict(_written()) | dict(_by_hand()) | dict(_real())


def _written() -> Iterator[tuple[str, bytes]]:
    """Yield what surfel itself writes."""
    import surfel

    rng = np.random.default_rng(5)
    points = rng.normal(size=(ROWS, 3)).round(3)
    normals = np.tile(np.eye(3), (ROWS // 3, 1))
    attributes = {
        "intensity": rng.integers(0, 999, ROWS).astype(np.uint16),
        "classification": (np.arange(ROWS) % 5).astype(np.uint8),
        "gps_time": rng.random(ROWS).round(3),
    }  # fmt: skip
    colors = rng.integers(0, 255, (ROWS, 3)).astype(np.uint8)
    cloud = surfel.Surfels(points, normals, rng.random(ROWS).round(3), colors, attributes)
    bare = surfel.Surfels(points)
    mesh = surfel.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    clouds = ("ply", "xyz", "csv", "npy", "npz", "pcd", "obj", "off", "las", "laz", "e57", "pts")
    things = [(f"cloud.{suffix}", cloud, False) for suffix in clouds]
    things += [(f"bare.{suffix}", bare, False) for suffix in ("las", "laz", "pts", "pcd", "xyz")]
    things += [(f"mesh.{suffix}", mesh, False) for suffix in ("ply", "obj", "off", "stl", "glb")]
    things += [("text.ply", cloud, True), ("text.pcd", cloud, True), ("text.stl", mesh, True)]
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, thing, ascii in things:
            path = Path(folder, name)
            try:
                surfel.write(path, thing, ascii=ascii)
            except MissingExtraError:
                continue  # its reader cannot be tried here either
            yield name, path.read_bytes()


def _by_hand() -> Iterator[tuple[str, bytes]]:
    """Yield flavours that surfel reads but does not write."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(ROWS, 3)).astype("<f4")
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 4\nHEIGHT 3\n"
    packed = b"".join(points[:, i].tobytes() for i in range(3)) + bytes(4 * ROWS)
    size = 4 * 4 * ROWS
    body = lzf_literal(packed[: size - 20]) + bytes([7 << 5, 20 - 9, 40])  # literals, then a long copy
    yield "packed.pcd", (
        f"{head}VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {ROWS}\nDATA binary_compressed\n".encode()
        + struct.pack("<II", len(body), size) + body
    )  # fmt: skip
    grid = "ply\nformat ascii 1.0\nobj_info num_cols 2\nelement vertex 3\nproperty float x\nproperty float y\n"
    grid += "property float z\nelement range_grid 4\nproperty list uchar int vertex_indices\nend_header\n"
    yield "grid.ply", (grid + "0 0 0\n1 0 0\n0 1 0\n1 0\n0\n1 1\n1 2\n").encode()
    strip = (
        "ply\nformat binary_big_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    )
    strip += "property uchar red\nproperty uchar green\nproperty uchar blue\nelement tristrips 1\n"
    strip += "property list int int vertex_indices\nend_header\n"
    rows = b"".join(struct.pack(">3f3B", i, i * i, i % 2, 1, 2, 250) for i in range(4))
    yield "strip.ply", strip.encode() + rows + struct.pack(">7i", 6, 0, 1, 2, 3, -1, 1)
    axes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n"
    scan = "".join(f"{x} {y} {z} 0.5 1 2 3\n" for x, y, z in points[:6].round(3).tolist())
    yield "scan.ptx", ("2\n3\n" + axes + scan).encode() * 2
    yield "named.csv", b"id;x;y;z;nx;ny;nz\n" + b"".join(b"%d;1,5;2,%d;3;0;0;1\n" % (i, i) for i in range(5))
    yield "counted.txt", b"3\n# x y z red green blue\n0 0 0 1 2 3\n1 0 nan 4 5 255\n0 1e3 -2.5e-3 7 8 9\n"
    yield "colored.off", b"COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n"


def _real() -> Iterator[tuple[str, bytes]]:
    """Yield small real files of formats that are not written here."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("SURFEL_DATA", root.parent / "shared" / "data"))
    for name in ("lidar/laspy/simple.copc.laz", "e57/testWithNormals.e57", "e57/translationWithoutRotation.e57",
                 "bad/gps-time-nan.las", "bad/unregistered_extra_bytes.las", "bad/bad-geotiff-keys.las"):  # fmt: skip
        if (folder / name).is_file():
            yield "real-" + Path(name).name, (folder / name).read_bytes()


def lzf_literal(data: bytes) -> bytes:
    """Pack without packing: runs of at most 32 literal bytes."""
    return b"".join(bytes([len(data[i : i + 32]) - 1]) + data[i : i + 32] for i in range(0, len(data), 32))
