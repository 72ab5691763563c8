"""Who is told when kernels are compiled: asked for before numba is imported, and without importing it."""

from __future__ import annotations

from collections.abc import Callable

_waiting: list[Callable[[], None]] = []


def announce_compilation(hook: Callable[[], None] | None) -> None:
    """Call ``hook`` once, when the next kernel has to be compiled (not when it comes from the cache)."""
    _waiting[:] = [] if hook is None else [hook]


def compilation_starts() -> None:
    """Tell whoever waits for it."""
    while _waiting:
        _waiting.pop()()
