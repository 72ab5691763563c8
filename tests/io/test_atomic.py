"""A write that fails leaves the old file whole and nothing beside it."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading

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
except surfel.io.doors.InputError as error:
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


def test_ctrl_c_in_the_middle_of_writing_a_cloud(tmp_path, monkeypatch):
    import surfel.io.ply as ply

    target = tmp_path / "a.ply"
    target.write_bytes(b"old")
    calls = []

    def interrupted(stream, block, ascii):
        calls.append(len(block))
        stream.write(block.tobytes())
        if len(calls) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(ply, "_write_block", interrupted)
    with pytest.raises(KeyboardInterrupt):
        surfel.io.write(target, np.zeros((300_000, 3)))
    assert len(calls) == 2
    only_old(tmp_path, "a.ply")


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
