"""The command line: measure, combine, bound, render, view, info, convert, sample and demo.

Exit codes: 0 when the work is done; 2 with one line on the standard error when it cannot be done (a wrong argument, an
unreadable or lying file, a full disk, a missing extra); 130 after Ctrl-C; 141 when the reader of the output has gone;
1 for a defect of surfel itself, with a line that says how to see the traceback.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Sequence

from surfel import _notice

EXIT_DEFECT = 1
EXIT_REFUSED = 2
EXIT_INTERRUPTED = 130
EXIT_NO_READER = 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; nothing but a defect under ``SURFEL_TRACEBACK=1`` raises.

    Parameters
    ----------
    arguments : sequence of str, optional
        What follows the program's name; by default what the process was started with.

    Returns
    -------
    int
        The exit code.

    Examples
    --------
    >>> from surfel.cli import main
    >>> main(["info", "no-such-file.ply"])
    2
    """
    hook, sys.unraisablehook = sys.unraisablehook, _keep_interrupts
    if arguments is None:
        start_lean()
    try:
        code = _run(sys.argv[1:] if arguments is None else list(arguments))
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        if arguments is None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process is ending: a second Ctrl-C changes nothing
        code = _refuse("interrupted", EXIT_INTERRUPTED)
        if arguments is None:
            os._exit(code)  # without waiting for the threads of a kernel that nobody wants any more
        return code
    except BrokenPipeError:
        return EXIT_NO_READER
    except SystemExit:
        return EXIT_NO_READER  # rich, which prints the help, leaves by itself when a pipe breaks
    except MemoryError:
        return _refuse("not enough memory for this input")
    except OSError as error:
        return _refuse(_about_file(error))
    except Exception as error:
        return _refuse_or_raise(error)
    finally:
        sys.unraisablehook = hook


def start_lean() -> None:
    """Prepare a process of our own for a short life: imports make much garbage-collector work and no garbage."""
    gc.set_threshold(200_000, 20, 20)
    _notice.own_process = True


def _run(arguments: list[str]) -> int:
    """Parse and run, without the exit handling of typer: what cannot be done comes back as an exception."""
    import typer

    from surfel.cli.app import app

    command = typer.main.get_command(app)
    try:
        with command.make_context("surfel", arguments) as context:
            command.invoke(context)
    except typer.Exit as stop:
        return stop.exit_code
    except typer.Abort:
        raise KeyboardInterrupt from None
    return 0


def _refuse_or_raise(error: Exception) -> int:
    from surfel.core.errors import SurfelError

    if isinstance(error, SurfelError):
        return _refuse(str(error))
    if hasattr(error, "format_message"):  # a usage error of typer, whichever click it brings
        context = getattr(error, "ctx", None)
        path = context.command_path if context is not None else "surfel"
        return _refuse(f"{error.format_message()} (see '{path} --help')")
    if os.environ.get("SURFEL_TRACEBACK"):
        raise error
    return _refuse(
        f"a defect in surfel: {type(error).__name__}: {error} (SURFEL_TRACEBACK=1 shows where; please report it)",
        EXIT_DEFECT,
    )


def _refuse(message: str, code: int = EXIT_REFUSED) -> int:
    """Say why on one line of the standard error, whatever the message holds and wherever it goes."""
    line = " ".join(message.split()).encode("utf-8", "backslashreplace").decode("utf-8")
    try:
        encoding = sys.stderr.encoding or "utf-8"
        sys.stderr.write(f"surfel: {line}\n".encode(encoding, "backslashreplace").decode(encoding))
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):
        pass  # nobody listens: the exit code still tells
    return code


def _about_file(error: OSError) -> str:
    """Return ``path: what the system says`` without the number of the error."""
    reason = error.strerror or str(error) or type(error).__name__
    names = [os.fsdecode(name) for name in (error.filename, error.filename2) if isinstance(name, str | bytes)]
    return f"{' -> '.join(names)}: {reason}" if names else reason


def _keep_interrupts(unraisable: sys.UnraisableHookArgs) -> None:
    """Pass on a Ctrl-C that fell into a callback, where Python would print a traceback and forget it."""
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        import _thread
        import threading

        threading.Timer(0.05, _thread.interrupt_main).start()  # at once it would fall into this very callback
    elif os.environ.get("SURFEL_TRACEBACK"):
        sys.__unraisablehook__(unraisable)
