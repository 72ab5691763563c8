"""What is agreed before numba is imported, without importing it: who is told of compilation, how lean to start."""

from __future__ import annotations

from collections.abc import Callable

own_process = False
"""Whether the process is surfel's own (the command line): it may then leave out what only other code would use."""

_waiting: list[Callable[[], None]] = []


def announce_compilation(hook: Callable[[], None] | None) -> None:
    """Call ``hook`` once, when the next kernel has to be compiled (not when it comes from the cache)."""
    _waiting[:] = [] if hook is None else [hook]


def compilation_starts() -> None:
    """Tell whoever waits for it."""
    while _waiting:
        _waiting.pop()()
