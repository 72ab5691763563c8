"""What the tests of files share: real data where it is there, and small valid files in every flavour."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

settings.register_profile("surfel", deadline=None)  # the first call of a kernel may compile it
settings.load_profile("surfel")

ROOT = Path(__file__).resolve().parents[2]
ENCODINGS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real files; tests that need it are skipped where it is absent."""
    folder = Path(os.environ.get("SURFEL_DATA", ROOT.parent / "shared" / "data"))
    if not (folder / "MANIFEST.tsv").is_file():
        pytest.skip(f"no real files in {folder}; set SURFEL_DATA")
    return folder


def small_ply(order: str, mixed: bool = True) -> bytes:
    """Write by hand a PLY file with colors, a list among the vertices, polygons, strips and a further element."""
    head = f"""ply
format {ENCODINGS[order]} 1.0
comment made by a test
obj_info nothing
element camera 1
property float view_px
element vertex 5
property uchar red
property uchar green
property uchar blue
property double x
property float32 y
property float z
property list uchar short ring
property int16 tag
element face 2
property uchar flag
property list uint8 uint vertex_index
property float weight
element tristrips 1
property list int int32 vertex_indices
end_header
"""
    vertices = [(i, 2 * i, 255 - i, 0.1 * i, i * i - 1.5, 0.25 * i, [i] * (i % 3), -i) for i in range(5)]
    faces = [(1, [0, 1, 2, 3] if mixed else [0, 1, 2], 0.5), (2, [2, 3, 4], 1.5)]
    strip = [0, 1, 2, 3, -1, 2, 3, 4]
    if order == "":
        lines = ["7.5"]
        lines += [" ".join(map(str, [*v[:6], len(v[6]), *v[6], v[7]])) for v in vertices]
        lines += [" ".join(map(str, [f[0], len(f[1]), *f[1], f[2]])) for f in faces]
        lines += [" ".join(map(str, [len(strip), *strip]))]
        return (head + "\n".join(lines) + "\n").encode()
    body = struct.pack(order + "f", 7.5)
    for v in vertices:
        body += struct.pack(f"{order}3Bd2fB{len(v[6])}hh", *v[:6], len(v[6]), *v[6], v[7])
    for f in faces:
        body += struct.pack(f"{order}BB{len(f[1])}If", f[0], len(f[1]), *f[1], f[2])
    body += struct.pack(f"{order}i{len(strip)}i", len(strip), *strip)
    return head.encode() + body


def small_files() -> dict[str, bytes]:
    """Return one small valid file for each format and flavour, by a name with its suffix."""
    import tempfile
    import warnings

    import surfel.io

    rng = np.random.default_rng(5)
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    from surfel.shapes.mesh import Mesh
    from surfel.shapes.surfels import Surfels

    mesh = Mesh(corners, faces)
    cloud = Surfels(
        rng.normal(size=(3, 3)).round(3), np.eye(3), rng.random(3).round(3),
        rng.integers(0, 255, (3, 3)).astype(np.uint8),
        {"intensity": rng.random(3).round(3)},
    )  # fmt: skip
    files = {f"{kind}.ply": small_ply(order) for kind, order in (("ascii", ""), ("little", "<"), ("big", ">"))}
    files["even.ply"] = small_ply("<", mixed=False)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, thing, text in [
            ("cloud.ply", cloud, False), ("cloud.xyz", cloud, False), ("cloud.csv", cloud, False),
            ("cloud.npy", cloud, False), ("cloud.npz", cloud, False), ("cloud.obj", cloud, False),
            ("mesh.obj", mesh, False), ("mesh.off", mesh, False), ("mesh.stl", mesh, False), ("text.stl", mesh, True),
            ("mesh.glb", mesh, False),
        ]:  # fmt: skip
            surfel.io.write(f"{folder}/{name}", thing, ascii=text)
            files[name] = Path(folder, name).read_bytes()
    return files


@pytest.fixture(scope="session")
def valid_files() -> dict[str, bytes]:
    return small_files()


@pytest.fixture(scope="session")
def make_ply():
    return small_ply
