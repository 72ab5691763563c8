"""Files: reading and writing beside peers, each figure beside its target, in one run on one machine."""

from __future__ import annotations

import json
import os
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tables import busy, made_on, seconds, table

POINTS, LINES, QUICK = 5_000_000, 1_000_000, 20
NORMALS = ("x", "y", "z", "nx", "ny", "nz")
SPARSE_POINTS = 500_000_000
_HEAD_OF_PROCESS = "import time, sys, json, resource; import surfel, surfel.io.doors; "


@dataclass(frozen=True)
class Row:
    """One line of the table: a task, who did it, how long it took, at which rate, and the target."""

    task: str
    who: str
    seconds: float
    rate: str = ""
    target: str = ""
    reached: str = ""


def run(repeats: int = 3, quick: bool = False) -> list[Row]:
    """Return all rows; with ``quick`` on files of a twentieth of the size."""
    share = QUICK if quick else 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = binary_ply(folder, POINTS // share, repeats)
        rows += text(folder, LINES // share, repeats)
        rows += laz(repeats)
        rows += sparse_las(folder)
    return rows


def binary_ply(folder: Path, points: int, repeats: int) -> list[Row]:
    """Time binary PLY of single precision with normals, from and to the page cache."""
    import surfel

    path, out = folder / "cloud.ply", folder / "out.ply"
    _write_ply(path, points)
    size = path.stat().st_size
    cloud = surfel.read(path)
    readers = {"surfel": lambda: surfel.read(path), **_peers_reading(path)}
    rows = _timed(f"read binary PLY, {points:,} points with normals", readers, repeats, size, ">= 400 MB/s", 400.0)
    writers: dict[str, Callable[[], object]] = {"surfel": lambda: surfel.write(out, cloud), **_peers_writing(path, out)}
    task = f"write binary PLY, {points:,} points with normals"
    for who, work in writers.items():
        out.unlink(missing_ok=True)
        rows += _timed(task, {who: work}, repeats, 0, ">= 300 MB/s", 300.0, lambda: out.stat().st_size)
    return rows


def text(folder: Path, points: int, repeats: int) -> list[Row]:
    """Time ascii PLY and XYZ, against everybody who reads numbers."""
    import surfel

    rng = np.random.default_rng(0)
    xyz, ply = folder / "cloud.xyz", folder / "ascii.ply"
    np.savetxt(xyz, rng.normal(size=(points, 3)), fmt="%.6f")
    with open(ply, "w") as stream:
        stream.write(_ply_header("ascii", points))
        np.savetxt(stream, rng.normal(size=(points, 6)).astype(np.float32), fmt="%.7g")
    rows: list[Row] = []
    for path, skip in ((xyz, 0), (ply, _ply_header("ascii", points).count("\n"))):
        readers: dict[str, Callable[[], object]] = {"surfel": lambda path=path: surfel.read(path)}
        readers |= {"numpy.loadtxt": lambda path=path, skip=skip: np.loadtxt(path, skiprows=skip)}
        pandas = _module("pandas")
        if pandas is not None:
            readers["pandas"] = partial(_by_pandas, pandas, path, skip)
        readers |= _peers_reading(path)
        rows += _timed(f"read {path.suffix[1:]} text, {points:,} points", readers, repeats, path.stat().st_size,
                       "the fastest")  # fmt: skip
    return [_judged_by_peers(row, rows) for row in rows]


def laz(repeats: int) -> list[Row]:
    """Time 1.3 million compressed points against laspy alone."""
    import laspy

    import surfel

    root = Path(os.environ.get("SURFEL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    paths = [root / "lidar" / f"bcts_{i}.laz" for i in (1, 2)]
    if not all(path.is_file() for path in paths):
        return []

    def by_laspy() -> object:
        return [np.asarray(laspy.read(path).xyz) for path in paths]

    readers = {"surfel": lambda: [surfel.read(path) for path in paths], "laspy": by_laspy}
    mine, theirs = _timed("read LAZ, 1.36 million points", readers, repeats, sum(p.stat().st_size for p in paths))
    ratio = mine.seconds / theirs.seconds
    judged = Row(
        mine.task, "surfel", mine.seconds, mine.rate, "<= 1.15 x laspy", f"{_yes(ratio <= 1.15)}, {ratio:.2f} x"
    )
    return [judged, theirs]


def sparse_las(folder: Path) -> list[Row]:
    """Time ``info`` of a LAS file of 10 GB that holds almost nothing, in a process of its own, imports apart."""
    path = folder / "sparse.las"
    record = 20
    header = struct.pack("<4sHH16sBB32s32sHHHIIBHI5I12d", b"LASF", 0, 0, bytes(16), 1, 2, b"", b"", 1, 2026, 227, 227,
                         0, 0, record, SPARSE_POINTS, SPARSE_POINTS, 0, 0, 0, 0, 0.01, 0.01, 0.01, 0, 0, 0,
                         1, 0, 1, 0, 1, 0)  # fmt: skip
    with open(path, "wb") as stream:
        stream.write(header)
        stream.truncate(len(header) + record * SPARSE_POINTS)
    program = _HEAD_OF_PROCESS + (
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss; started = time.perf_counter(); "
        "told = surfel.info(sys.argv[1]); took = time.perf_counter() - started; "
        "grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before; "
        "print(json.dumps([took, grown / 1024, told['points']]))"
    )
    took, grown, points = json.loads(subprocess.check_output([sys.executable, "-c", program, str(path)], text=True))
    assert points == SPARSE_POINTS
    size = path.stat().st_size
    path.unlink()
    reached = f"{_yes(took <= 0.3 and grown < 64)}, {grown:.0f} MB more memory"
    return [Row(f"info of a sparse LAS of {size / 1e9:.0f} GB", "surfel", took, "", "<= 0.3 s, memory flat", reached)]


def report(rows: list[Row], repeats: int, fuzzed: str = "") -> str:
    """Return the results as Markdown."""
    head = ("task", "by", "time", "rate", "target", "reached")
    lines = [(r.task, r.who, seconds(r.seconds), r.rate, r.target, r.reached) for r in rows]
    parts = [
        "# Files\n", made_on(("surfel", "numpy", "trimesh", "open3d", "laspy", "pandas")),
        f"Medians of {repeats} runs each, from the page cache, all in one run. "
        f"MB/s is the size of the file by the time. {busy()}\n",
        table(head, lines),
    ]  # fmt: skip
    if fuzzed:
        parts += ["## Damaged files\n", fuzzed + "\n"]
    return "\n".join(parts)


def _timed(
    task: str,
    works: dict[str, Callable[[], object]],
    repeats: int,
    size: int,
    target: str = "",
    least: float = 0.0,
    measured: Callable[[], int] | None = None,
) -> list[Row]:
    rows = []
    for who, work in works.items():
        spent = []
        for _ in range(repeats + (who == "surfel")):  # one more run compiles
            started = time.perf_counter()
            work()
            spent.append(time.perf_counter() - started)
        took = statistics.median(spent[-repeats:])
        rate = (size or (measured() if measured else 0)) / 1e6 / took
        mine = who == "surfel"
        reached = _yes(rate >= least) if mine and least else ""
        rows.append(Row(task, who, took, f"{rate:.0f} MB/s", target if mine else "", reached))
        print(f"{task}: {who} {took:.3f} s, {rate:.0f} MB/s", flush=True)
    return rows


def _judged_by_peers(row: Row, rows: list[Row]) -> Row:
    if row.who != "surfel":
        return row
    best = min((r for r in rows if r.task == row.task and r.who != "surfel"), key=lambda r: r.seconds)
    ratio = row.seconds / best.seconds
    return Row(row.task, row.who, row.seconds, row.rate, row.target, f"{_yes(ratio <= 1.0)}, {ratio:.2f} x {best.who}")


def _by_pandas(pandas: Any, path: Path, skip: int) -> object:
    return pandas.read_csv(path, sep=" ", header=None, skiprows=skip).to_numpy()


def _peers_reading(path: Path) -> dict[str, Callable[[], object]]:
    found: dict[str, Callable[[], object]] = {}
    trimesh, open3d = _module("trimesh"), _module("open3d")
    if trimesh is not None:
        found["trimesh"] = lambda: trimesh.load(path)
    if open3d is not None:
        found["Open3D"] = lambda: open3d.io.read_point_cloud(str(path))
    return found


def _peers_writing(path: Path, out: Path) -> dict[str, Callable[[], object]]:
    found: dict[str, Callable[[], object]] = {}
    trimesh, open3d = _module("trimesh"), _module("open3d")
    if trimesh is not None:
        cloud = trimesh.load(path)
        found["trimesh"] = lambda: cloud.export(str(out))
    if open3d is not None:
        other = open3d.io.read_point_cloud(str(path))
        found["Open3D"] = lambda: open3d.io.write_point_cloud(str(out), other)
    return found


def _module(name: str) -> Any:
    try:
        return import_module(name)
    except (ImportError, OSError):
        return None


def _write_ply(path: Path, points: int) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=(points, 6)).astype("<f4")
    values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    with open(path, "wb") as stream:
        stream.write(_ply_header("binary_little_endian", points).encode())
        stream.write(values.data)


def _ply_header(kind: str, points: int) -> str:
    properties = "".join(f"property float {name}\n" for name in NORMALS)
    return f"ply\nformat {kind} 1.0\nelement vertex {points}\n{properties}end_header\n"


def _yes(reached: bool) -> str:
    return "yes" if reached else "no"
