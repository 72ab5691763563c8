"""The one place for JIT options: how every kernel of the house is compiled, cached, threaded and announced.

Kernels are compiled lazily, on the first call with the types that occur. Three things here are not numba's defaults:

- *Cache stamp.* numba renews a cached kernel when its own file changes, not when a helper that it inlines from another
  file does. The cache of every kernel is therefore stamped with a hash of its file and of all that it imports.
- *Fallback.* Where no folder can be written, kernels are compiled for the process alone instead of failing.
- *Threads.* A kernel over many items is compiled for a run of them, without ``prange``, and runs are shared out to
  Python threads with the interpreter's lock released. It compiles and loads twice as fast, any number of threads may
  call it at once, and no threading layer has to be there (numba's ``workqueue`` aborts when two threads meet in it).
"""

from __future__ import annotations

import hashlib
import importlib
import os
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache, update_wrapper
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import event
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher

from surfel import _notice

Function = TypeVar("Function", bound=Callable[..., Any])

_SERIAL_BELOW = 50_000
_PARTS = 8  # parts a thread, so that a thread that is held up does not hold up the others
_local = threading.local()
_ROOT = Path(__file__).parent
_IMPORT = re.compile(r"^\s*from (surfel[\w.]*) import", re.MULTILINE)


def _start_without_linear_algebra() -> None:
    """Let numba set itself up without scipy.linalg: a quarter of a second that only ``numpy.dot`` in kernels needs."""
    if "scipy.linalg" not in sys.modules:
        sys.modules["scipy.linalg.cython_blas"] = None  # type: ignore[assignment]
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            del sys.modules["scipy.linalg.cython_blas"]


if _notice.own_process:
    _start_without_linear_algebra()


@cache
def _imported_sources(module: str) -> frozenset[Path]:
    """Return the file of a module of the package and those of all modules of the package that it imports."""
    found: set[Path] = set()
    todo = [module]
    while todo:
        name = todo.pop()
        path = _ROOT.joinpath(*name.split(".")[1:]).with_suffix(".py")
        if path in found or not path.is_file():
            continue
        found.add(path)
        todo.extend(_IMPORT.findall(path.read_text(encoding="utf-8")))
    return frozenset(found)


@cache
def _source_stamp(module: str) -> str:
    """Return a hash over every source file that can reach into a kernel of ``module``."""
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(_imported_sources(module)):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _compile_lazily(function: Callable[..., Any], **options: Any) -> Any:
    dispatcher = numba.njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    try:
        dispatcher.enable_caching()
        dispatcher._cache._cache_file._source_stamp = _source_stamp(function.__module__)
    except (RuntimeError, OSError):
        pass  # no folder can be written: the kernel is compiled anew in each process
    return dispatcher


def is_cached(function: Callable[..., Any]) -> bool:
    """Tell whether what is compiled for a kernel is kept for other processes."""
    dispatcher = getattr(function, "dispatcher", function)
    return isinstance(getattr(dispatcher, "_cache", None), FunctionCache)


class _ForKernels(CPUDispatcher):  # type: ignore[misc]
    """A compiled function without an entry for Python: to call that would crash the process."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        raise TypeError(f"{self.py_func.__name__} is for kernels alone; from Python call its py_func")


def _for_kernels(function: Function, **options: Any) -> Function:
    dispatcher = _compile_lazily(function, no_cpython_wrapper=True, **options)
    if not numba.config.DISABLE_JIT:
        dispatcher.__class__ = _ForKernels
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: Function) -> Function:
    """Compile a serial kernel, callable from Python and from other kernels."""
    return _compile_lazily(function)  # type: ignore[no-any-return]


def inner(function: Function) -> Function:
    """Compile a kernel that only other kernels call: without an entry for Python, which costs as much again."""
    return _for_kernels(function)


def inlined(function: Function) -> Function:
    """Compile a small scalar kernel that LLVM is asked to inline wherever it is called; only other kernels call it."""
    return _for_kernels(function, forceinline=True)


def rows(function: Callable[..., None]) -> Callable[..., None]:
    """Compile a kernel ``f(first, last, ...)`` over a run of items, to be called as ``f(count, ...)``.

    The run ``0 .. count`` is cut into parts that a few threads take one after another, without the interpreter's
    lock. Each item must write to places of its own; then the bits are the same on any number of threads. Compared
    with ``prange`` this halves the time to compile and to load from the cache, and needs no threading layer.
    """
    dispatcher = _compile_lazily(function, nogil=True)

    def call(count: int, *arguments: Any) -> None:
        threads = min(_thread_limit(), count)
        if threads <= 1:
            dispatcher(0, count, *arguments)
            return
        dispatcher(0, 0, *arguments)  # compiled or loaded by one thread, before the others need it
        parts = iter(_parts(count, _PARTS * threads))

        def work() -> None:
            for first, last in parts:
                dispatcher(first, last, *arguments)

        helpers = [_pool().submit(work) for _ in range(threads - 1)]
        try:
            work()
        finally:
            deque(parts, maxlen=0)  # on an error or Ctrl-C the helpers find nothing left to do
            for helper in helpers:
                helper.result()

    update_wrapper(call, function)
    call.dispatcher = dispatcher  # type: ignore[attr-defined]
    return call


def _parts(count: int, number: int) -> list[tuple[int, int]]:
    number = min(number, count)
    cuts = [count * part // number for part in range(number + 1)]
    return list(pairwise(cuts))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=max(1, int(numba.config.NUMBA_NUM_THREADS)), thread_name_prefix="surfel")


if hasattr(os, "register_at_fork"):  # not on Windows, which cannot fork
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked child has none of its parent's threads


def _thread_limit() -> int:
    """Return how many threads a kernel may use here: what :func:`threads_for` or numba was told."""
    limit = getattr(_local, "limit", None)
    return limit if limit is not None else _told()


def _told() -> int:
    if numba.np.ufunc.parallel._is_initialized:  # somebody may have called numba.set_num_threads
        return int(numba.get_num_threads())
    return int(numba.config.NUMBA_NUM_THREADS)


@contextmanager
def threads_for(items: int, threads: int | None = None) -> Iterator[int]:
    """Set how many threads kernels use inside: one for small inputs, else ``threads`` or all of them.

    Parameters
    ----------
    items : int
        How many items the kernel will loop over; below 50,000 the start of the threads costs more than they save.
    threads : int, optional
        An upper limit; by default what numba was told (``NUMBA_NUM_THREADS``, ``numba.set_num_threads``).
    """
    before = getattr(_local, "limit", None)
    most = _thread_limit()
    _local.limit = 1 if items < _SERIAL_BELOW else max(1, min(threads or most, most))
    try:
        yield _local.limit
    finally:
        _local.limit = before


class _CompileClock(event.Listener):  # type: ignore[misc]
    """Adds up the seconds spent compiling, and lets it be known when compiling starts."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._started = 0.0

    def on_start(self, event: Any) -> None:
        if self._depth == 0:
            self._started = time.perf_counter()
            _notice.compilation_starts()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started


_CLOCK = _CompileClock()
event.register("numba:compile", _CLOCK)


def compile_seconds() -> float:
    """Return how many seconds this process has spent compiling kernels so far (cached kernels cost none)."""
    return _CLOCK.seconds
