"""What cannot be done ends in one line on the standard error and an exit code, never in a traceback."""

from __future__ import annotations

import errno
import io
import sys
import time

import pytest

import surfel
from surfel.cli import main
from surfel.core.errors import ConvergenceError, FileFormatError, InputError, MissingExtraError


def refused(capsys, arguments, code=2):
    """Run, and return the one line that was printed."""
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("surfel: ") and err.endswith("\n") and err.count("\n") == 1, err
    return err[len("surfel: ") : -1]


def failing(error):
    def read(*_args, **_kwargs):
        raise error

    return read


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["measure"], "Missing argument 'FILE'"),
        (["measure", "x", "--colour"], "--colour"),
        (["measure", "x", "--lines", "many"], "--lines"),
        (["measure", "x", "--method", "guess"], "patches, lines, qmca"),
        (["measure", "x", "--method", "qmca", "--cells", "all"], "--cells must be one of line, cylinder"),
        (["measure", "x", "--method", "qmca", "--density", "any"], "--density must be one of even, uneven, resampled"),
        (["measure", "x", "--model", "ray"], "chord, tangent, offset"),
        (["measure", "x", "--sequence", "ray"], "niederreiter, r4, sobol, halton, random"),
        (["measure", "x", "--as", "voxels"], "points, mesh"),
        (["measure", "x", "--seed", "-1"], "--seed must be at least 0"),
        (["sample", "x", "-o", "y"], "-n N or --radius RHO"),
        (["sample", "x", "-o", "y", "-n", "3", "--radius", "1"], "-n N or --radius RHO"),
        (["sample", "x", "-o", "y", "-n", "0"], "-n must be at least 1"),
        (["sample", "x", "-o", "y", "--radius", "nan"], "--radius must be finite"),
        (["sample", "x", "-o", "y", "-n", "3", "--kind", "green"], "random, blue"),
        (["polish", "x"], "polish"),
    ],
)
def test_wrong_arguments_are_refused_before_anything_is_read(arguments, said, capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "read", failing(AssertionError("it was read")))
    assert said in refused(capsys, arguments)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (InputError("points must have\nshape (n, 3)"), "points must have shape (n, 3)"),
        (FileFormatError("a.ply", "cut", "byte 12", "copy it again"), "a.ply: cut (byte 12); copy it again"),
        (ConvergenceError("no end in sight"), "no end in sight"),
        (MissingExtraError("p", "e57"), "this needs p, which is not installed: pip install 'surfel[e57]'"),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "a.ply"), "a.ply: No such file or directory"),
        (OSError(errno.EXDEV, "Invalid link", "a", None, "b"), "a -> b: Invalid link"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
        (OSError("odd"), "odd"),
        (MemoryError(), "not enough memory for this input"),
        (InputError("no such file: \udcff.ply"), "no such file: \\udcff.ply"),
    ],
)
def test_errors_become_one_line_and_exit_code_2(error, said, capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "info", failing(error))
    assert refused(capsys, ["info", "a.ply"]) == said


def test_a_defect_is_told_as_one(capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "info", failing(KeyError("facets")))
    monkeypatch.delenv("SURFEL_TRACEBACK", raising=False)
    line = refused(capsys, ["info", "a.ply"], code=1)
    assert "KeyError: 'facets'" in line and "SURFEL_TRACEBACK=1" in line
    monkeypatch.setenv("SURFEL_TRACEBACK", "1")
    with pytest.raises(KeyError):
        main(["info", "a.ply"])


def test_ctrl_c_is_130(capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "info", failing(KeyboardInterrupt()))
    assert refused(capsys, ["info", "a.ply"], code=130) == "interrupted"


def test_a_gone_reader_is_quiet(capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "info", failing(BrokenPipeError(errno.EPIPE, "Broken pipe")))
    assert main(["info", "a.ply"]) == 141
    assert capsys.readouterr() == ("", "")


def test_a_terminal_of_few_letters_gets_escapes(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setitem(surfel.__dict__, "info", failing(InputError("no file m\u00fchle.ply")))
    assert main(["info", "a.ply"]) == 2
    stream.flush()
    assert stream.buffer.getvalue() == b"surfel: no file m\\xfchle.ply\n"


def test_a_missing_extra_is_named_before_the_file_is_read(capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "read", failing(AssertionError("it was read")))
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "pip install 'surfel[plot]'" in refused(capsys, ["measure", "a.ply", "--plot", "a.png"])


def test_solid_speaks_of_clouds_only(capsys, monkeypatch):
    monkeypatch.setitem(surfel.__dict__, "read", lambda path, as_=None: object())
    assert "--as points" in refused(capsys, ["measure", "a.obj", "--solid"])


def test_the_interpreters_own_reports_are_put_back(monkeypatch):
    def mine(_unraisable):
        pass

    monkeypatch.setattr(sys, "unraisablehook", mine)
    main(["--version"])
    assert sys.unraisablehook is mine


def test_without_a_command_the_help_is_printed(capsys):
    assert main([]) == 0
    assert "measure" in capsys.readouterr().out


def test_an_interrupt_that_falls_into_a_callback_comes_through(monkeypatch):
    """Python would print it and forget it; a command would run on as if nobody had pressed Ctrl-C."""
    from surfel.cli import _keep_interrupts

    class Callback:
        def __del__(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "unraisablehook", _keep_interrupts)
    with pytest.raises(KeyboardInterrupt):
        made = Callback()
        del made
        for _ in range(100):
            time.sleep(0.05)
