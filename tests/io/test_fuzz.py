"""Damaged files by the thousand through every reader: nothing but surfel's own errors, no hang, no large allocation."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2]))
from benchmarks import fuzz, fuzz_seeds


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    return fuzz_seeds.seeds()


def test_every_seed_is_read_before_it_is_damaged(files):
    assert {Path(name).suffix for name in files} >= {
        ".ply", ".xyz", ".csv", ".txt", ".npy", ".npz", ".pcd", ".obj", ".off", ".stl", ".glb", ".las", ".laz", ".pts",
        ".ptx", ".e57",
    }  # fmt: skip
    for name, data in files.items():
        assert fuzz.attempt(name, data), name


def test_a_case_is_made_from_its_number_alone(files):
    for number in (0, 17, 12345):
        assert fuzz.damaged(files, 3, number) == fuzz.damaged(dict(reversed(files.items())), 3, number)


def test_twenty_thousand(monkeypatch):
    monkeypatch.chdir(Path(__file__).resolve().parents[2])
    report = fuzz.run(20_000)
    assert not report.findings, str(report)
    assert report.read + report.refused == 20_000 and report.read > 700 and report.refused > 7000


def test_what_it_finds(monkeypatch, tmp_path):
    """A reader that raises, eats memory, hangs or dies is found, with the number of its case."""
    root = Path(__file__).resolve().parents[2]
    monkeypatch.chdir(root)
    broken = tmp_path / "sitecustomize.py"
    broken.write_text(
        "import os\n"
        "import benchmarks.fuzz as fuzz\n"
        "honest = fuzz.attempt\n"
        "calls = []\n"
        "def attempt(name, data):\n"
        "    calls.append(name)\n"
        "    number = len(calls) - COUNT\n"
        "    if number == 3: raise ValueError('stray')\n"
        "    if number == 5: return len(bytearray(200 << 20)) > 0\n"
        "    if number == 7: os.abort()\n"
        "    return True\n"
        "fuzz.attempt = attempt\n".replace("COUNT", str(len(fuzz_seeds.seeds())))
    )
    program = tmp_path / "child.py"
    program.write_text(
        f"import sys; sys.path[:0] = [{str(root)!r}, {str(tmp_path)!r}]\n"
        "import sitecustomize\nexec(open(sitecustomize.__file__).read())\n"
        "fuzz.child(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:7])\n"
    )
    monkeypatch.setattr(fuzz, "COMMAND", [sys.executable, str(program)])
    report = fuzz.run(12)
    numbers = [line.replace(":", "").split()[1] for line in report.findings[:3]]
    assert numbers == ["2", "4", "6"]
    assert "stray" in report.findings[0] and "200 MB" in report.findings[1] and "crashes" in report.findings[2]
