"""Damaged files of every format: cut at every byte, with flipped bits. Nothing but our own errors, or a result."""

from __future__ import annotations

import contextlib
import io
import random
import warnings

import numpy as np
import pytest

import surfel.io
from surfel.core.errors import FileFormatError, InputError
from surfel.io.loading import load_content
from surfel.io.source import Source

NAMES = [
    "ascii.ply", "little.ply", "big.ply", "even.ply", "cloud.ply", "cloud.xyz", "cloud.csv", "cloud.npy", "cloud.npz",
    "cloud.obj", "mesh.obj", "mesh.off", "mesh.stl", "text.stl", "mesh.glb",
]  # fmt: skip
BOUNDED = {n for n in NAMES if n not in ("cloud.xyz", "cloud.csv", "cloud.obj", "mesh.obj")}
"""Formats whose header or ending tells where the file ends; a table or an OBJ cut between two lines looks whole."""


def content_of(name: str, data: bytes):
    """Read from memory; a warning of any library would be an error here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load_content(Source(name, io.BytesIO(data), len(data)))[0]


def significant_length(name: str, data: bytes) -> int:
    """Up to where a cut takes something away that is needed: an ascii file may lose its last line end."""
    if name in ("ascii.ply", "mesh.off"):
        return len(data.rstrip()) - 1  # of the last number a digit may be missing, and nothing tells
    return data.rindex(b"endsolid") + 8 if name == "text.stl" else len(data)


@pytest.mark.parametrize("name", NAMES)
def test_cut_at_every_byte(valid_files, name):
    data = valid_files[name]
    whole = content_of(name, data)
    for length in range(1, len(data)):
        try:
            content = content_of(name, data[:length])
        except FileFormatError as error:
            assert error.path.endswith(name) and error.place and error.cure
            continue
        assert name not in BOUNDED or length >= significant_length(name, data), f"read after {length} of {len(data)}"
        assert len(content.points) <= len(whole.points)


@pytest.mark.parametrize("name", NAMES)
def test_flipped_bits_and_bytes(valid_files, name):
    rng = random.Random(name)
    data = valid_files[name]
    for _ in range(250):
        damaged = bytearray(data)
        for _ in range(rng.choice([1, 1, 1, 2, 8])):
            at = rng.randrange(len(damaged))
            match rng.randrange(5):
                case 0 | 1:
                    damaged[at] ^= 1 << rng.randrange(8)
                case 2:
                    damaged[at] = rng.choice(b"\x00\xff-+.0159eE \n\r,;#/")
                case 3:
                    del damaged[at : at + rng.randrange(1, 9)]
                    damaged = damaged or bytearray(b"x")
                case 4:
                    damaged[at:at] = damaged[rng.randrange(len(damaged)) :][: rng.randrange(1, 9)]
        with contextlib.suppress(FileFormatError):
            check(content_of(name, bytes(damaged)))


def check(content) -> None:
    """Whatever was read is well formed."""
    rows = len(content.points)
    assert content.points.shape == (rows, 3) and content.points.dtype == np.float64
    if content.triangles is not None and len(content.triangles):
        assert content.triangles.min() >= 0 and content.triangles.max() < rows
    for name in ("normals", "radii", "colors"):
        assert getattr(content, name) is None or len(getattr(content, name)) == rows
    assert all(len(values) == rows for values in content.attributes.values())


@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_through_the_doors(tmp_path, valid_files, name):
    """What comes out of the readers goes into clouds and meshes without a stray error."""
    rng = random.Random(name + "doors")
    for _ in range(12):
        damaged = bytearray(valid_files[name])
        damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        (tmp_path / name).write_bytes(damaged)
        for as_ in (None, "points"):
            with contextlib.suppress(FileFormatError, InputError):
                surfel.io.read(tmp_path / name, as_)
                surfel.io.info(tmp_path / name, full=True)


def test_more_behind_the_end(valid_files):
    for name in ("ascii.ply", "little.ply", "even.ply", "cloud.npy", "mesh.off", "mesh.stl", "text.stl", "mesh.glb"):
        with pytest.raises(FileFormatError):
            content_of(name, valid_files[name] + b"3 0 1 2\n" * 3)


def test_an_error_of_memory_is_not_dressed_up(tmp_path, valid_files, monkeypatch):
    import json
    import zipfile

    (tmp_path / "a.npz").write_bytes(valid_files["cloud.npz"])
    (tmp_path / "a.glb").write_bytes(valid_files["mesh.glb"])
    for error in (MemoryError, RecursionError):

        def fails(*arguments, error=error, **options):
            raise error

        monkeypatch.setattr(zipfile.ZipFile, "infolist", fails)
        monkeypatch.setattr(json, "loads", fails)
        for name in ("a.npz", "a.glb"):
            with pytest.raises(error):
                surfel.io.read(tmp_path / name)
