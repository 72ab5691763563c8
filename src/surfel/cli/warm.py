"""A second process that compiles kernels beside the first, so that both cores work on the first run.

What takes time in compiling is Python, which uses one core. While a command compiles what it needs first, the helper
compiles what it needs last (:mod:`surfel.cli.warm_kernels`), into the cache that both share. There is one job for
measuring, and one for the report of the demo.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from typing import Any, NoReturn

_PATIENCE = 2.0  # seconds for a helper to end when told so, before it is ended by force


def start(job: str = "measure") -> subprocess.Popen[bytes] | None:
    """Start the helper for ``measure`` or ``report``; None where there is no second core for it, or no way to."""
    if _cores() < 2 or not sys.executable or getattr(sys, "frozen", False):
        return None
    command = [sys.executable, "-P", "-m", "surfel.cli.warm", job]  # -P: nothing is imported from the current folder
    try:
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    except OSError:
        return None


def stop(helper: subprocess.Popen[bytes] | None) -> None:
    """End the helper, whose work is done or no longer wanted."""
    if helper is None:
        return
    with suppress(OSError):
        helper.terminate()
    try:
        helper.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        helper.kill()
        helper.wait()


def main() -> None:
    """Be the helper."""
    from surfel.cli import start_lean

    signal.signal(signal.SIGTERM, _leave)  # by an exception, so that no half-written file stays in the cache
    start_lean()
    from surfel.cli.warm_kernels import compile_for_report, compile_last

    compile_for_report() if sys.argv[1:] == ["report"] else compile_last()


def _leave(number: int, frame: Any) -> NoReturn:
    raise SystemExit(128 + number)


def _cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


if __name__ == "__main__":
    main()
