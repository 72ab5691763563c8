"""A write that fails leaves the old file whole and nothing beside it."""

from __future__ import annotations

import contextlib
import os
import signal
import stat
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import surfel.io
from surfel.core.errors import InputError
from surfel.io import replacing


def only_old(folder, name="a.txt"):
    assert os.listdir(folder) == [name]
    assert (folder / name).read_bytes() == b"old"


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, SystemExit, MemoryError])
def test_any_end_of_the_block_but_success(tmp_path, failure):
    (tmp_path / "a.txt").write_bytes(b"old")
    with pytest.raises(failure), replacing(tmp_path / "a.txt") as stream:
        stream.write(b"new, but only half")
        raise failure
    only_old(tmp_path)


def test_success_replaces(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"old")
    os.chmod(tmp_path / "a.txt", 0o640)
    with replacing(tmp_path / "a.txt") as stream:
        stream.write(b"new")
        assert (tmp_path / "a.txt").read_bytes() == b"old"
    assert (tmp_path / "a.txt").read_bytes() == b"new"
    assert stat.S_IMODE(os.stat(tmp_path / "a.txt").st_mode) == 0o640
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_new_file_gets_the_usual_permissions(tmp_path):
    with replacing(tmp_path / "new") as stream:
        stream.write(b"x")
    plain = tmp_path / "plain"
    plain.write_bytes(b"x")
    assert stat.S_IMODE(os.stat(tmp_path / "new").st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    with replacing(tmp_path / "link") as stream:
        stream.write(b"new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_bytes() == b"new"


def test_a_device_is_written_directly():
    with replacing("/dev/null") as stream:
        stream.write(b"gone")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_full_disk(tmp_path, monkeypatch):
    (tmp_path / "a.txt").write_bytes(b"old")
    with pytest.raises(InputError, match=r"a\.txt.*No space left"), replacing(tmp_path / "a.txt"):
        raise OSError(28, "No space left on device")
    only_old(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_write_that_the_system_cuts_off(tmp_path):
    program = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
import numpy as np, surfel.io
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
try:
    surfel.io.write(sys.argv[1], np.zeros((100_000, 3)))
except surfel.core.errors.InputError as error:
    print("refused:", error)
"""
    target = tmp_path / "a.ply"
    target.write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", program, str(target)], capture_output=True, text=True, check=True)
    assert "refused:" in done.stdout and "a.ply" in done.stdout
    only_old(tmp_path, "a.ply")


def test_no_such_folder_a_folder_and_a_long_name(tmp_path):
    for target in (tmp_path / "no" / "a.ply", tmp_path, tmp_path / ("x" * 4096 + ".ply"), "a\0b.ply"):
        with pytest.raises(InputError), replacing(target) as stream:
            stream.write(b"x")
    assert os.listdir(tmp_path) == []


def test_the_longest_name_that_the_system_takes(tmp_path):
    target = tmp_path / ("x" * 251 + ".ply")
    surfel.io.write(target, np.eye(3))
    assert len(surfel.io.read(target)) == 3


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="everything is writable for root")
def test_folder_and_file_that_may_not_be_written(tmp_path):
    (tmp_path / "a.txt").write_bytes(b"old")
    os.chmod(tmp_path / "a.txt", 0o444)
    with pytest.raises(InputError, match="read-only"), replacing(tmp_path / "a.txt"):
        pass
    os.chmod(tmp_path, 0o555)
    with pytest.raises(InputError, match="Permission denied"), replacing(tmp_path / "b.txt"):
        pass
    os.chmod(tmp_path, 0o755)


@pytest.mark.parametrize("suffix", ["ply", "pcd", "xyz", "npz", "las", "obj"])
@pytest.mark.parametrize("failure", [KeyboardInterrupt, OSError(28, "No space left on device"), MemoryError])
def test_an_end_in_the_middle_of_writing_a_cloud(tmp_path, monkeypatch, suffix, failure):
    import surfel.io.doors as doors
    from surfel.io.atomic import replacing as honest

    target = tmp_path / f"a.{suffix}"
    target.write_bytes(b"old")
    written = []

    class Failing:
        def __init__(self, stream) -> None:
            self._stream = stream

        def write(self, data) -> int:
            written.append(memoryview(data).nbytes)
            if sum(written) > 20_000:
                raise failure
            return self._stream.write(data)

        def __getattr__(self, name):
            return getattr(self._stream, name)

    @contextlib.contextmanager
    def failing(path):
        with honest(path) as stream:
            yield Failing(stream)

    monkeypatch.setattr(doors, "replacing", failing)
    expected = InputError if isinstance(failure, OSError) else failure
    with pytest.raises(expected):
        surfel.io.write(target, np.random.default_rng(0).random((30_000, 3)))
    assert sum(written) > 20_000
    only_old(tmp_path, target.name)


@pytest.mark.skipif(not hasattr(signal, "SIGINT") or sys.platform == "win32", reason="needs signals")
def test_ctrl_c_while_a_process_converts(tmp_path):
    """A real signal, sent when the temporary file has grown."""
    surfel.io.write(tmp_path / "a.ply", np.random.default_rng(0).random((1_500_000, 3)))
    (tmp_path / "b.xyz").write_bytes(b"old")
    program = "import sys, surfel; print('on', flush=True); surfel.convert(sys.argv[1], sys.argv[2])"
    command = [sys.executable, "-c", program, str(tmp_path / "a.ply"), str(tmp_path / "b.xyz")]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        parts = [p for p in tmp_path.iterdir() if p.suffix == ".part"]
        if parts and parts[0].stat().st_size > 100_000:
            break
        time.sleep(0.005)
    child.send_signal(signal.SIGINT)
    assert child.wait(60) != 0
    assert sorted(os.listdir(tmp_path)) == ["a.ply", "b.xyz"] and (tmp_path / "b.xyz").read_bytes() == b"old"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_device_that_is_full():
    with pytest.raises(InputError, match="No space left"):
        surfel.io.write("/dev/full", np.zeros((10, 3)), to="ply")


def test_names_of_any_kind(tmp_path):
    for name in ("with spaces in it.ply", "-.ply", "\u00fcml\u00e4ut \u6f22\u5b57 \U0001f40e.ply",
                 "'quotes\" & $HOME;.ply", "x" * 251 + ".ply"):  # fmt: skip
        surfel.io.write(tmp_path / name, np.eye(3))
        assert len(surfel.io.read(tmp_path / name)) == 3
        assert surfel.io.info(str(tmp_path / name))["points"] == 3
        surfel.io.convert(tmp_path / name, tmp_path / "copy.xyz")
    long = str(tmp_path / ("x" * 4092 + ".ply"))
    for attempt in (lambda: surfel.io.write(long, np.eye(3)), lambda: surfel.io.read(long),
                    lambda: surfel.io.info(long), lambda: surfel.io.open(long),
                    lambda: surfel.io.convert(tmp_path / "copy.xyz", long)):  # fmt: skip
        with pytest.raises(InputError, match="too long"):
            attempt()


def test_two_processes_write_the_same_target(tmp_path):
    program = """
import sys, numpy as np, surfel
value = float(sys.argv[2])
for _ in range(15):
    surfel.write(sys.argv[1], np.full((3000 + int(value), 3), value))
"""
    target = tmp_path / "a.ply"
    children = [subprocess.Popen([sys.executable, "-c", program, str(target), str(v)]) for v in (1, 2)]
    seen = 0
    while any(child.poll() is None for child in children):
        if target.exists():
            points = surfel.io.read(target).points  # whole at every moment
            assert len(points) == 3000 + points[0, 0] and (points == points[0, 0]).all()
            seen += 1
    assert all(child.returncode == 0 for child in children) and seen
    assert os.listdir(tmp_path) == ["a.ply"]


def test_two_writers_of_one_target(tmp_path):
    target = tmp_path / "a.ply"

    def keep_writing(value):
        for _ in range(20):
            surfel.io.write(target, np.full((2000 + value, 3), float(value)))

    threads = [threading.Thread(target=keep_writing, args=(v,)) for v in (1, 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    points = surfel.io.read(target).points
    assert len(points) == 2000 + points[0, 0] and (points == points[0, 0]).all()
    assert os.listdir(tmp_path) == ["a.ply"]
