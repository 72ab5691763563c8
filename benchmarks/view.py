"""The page in the browser: how long a step of a drag takes until its bytes are with the socket, and serving itself."""

from __future__ import annotations

import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.request import urlopen

import numpy as np

import surfel
from benchmarks.render import BITE, ball
from benchmarks.tables import busy, made_on, table
from surfel.viewer.viewer import Viewer

_LISTENER = """
import sys
from websockets.sync.client import connect
with connect(sys.argv[1], subprotocols=[sys.argv[2]], max_size=None) as page:
    while True:
        page.recv()
"""
_STEP = 10_000  # bytes: what is longer holds disks
_STEPS = 15


def report(quick: bool) -> str:
    """Return all tables as Markdown."""
    return "\n".join(["# The page\n", f"{made_on()} {busy()}\n", drags(quick), _serving()])


def drags(quick: bool) -> str:
    """Return the table of drags: from a pose that comes in to bytes that are with the socket of a page."""
    sizes = [(100_000, 15)] if quick else [(100_000, 15), (1_000_000, 100)]
    lines = []
    for size, goal in sizes:
        part = size // 2
        tree = ball(part) - ball(part, 0.7, BITE)
        lines.append((f"{size:,} surfels, ball less ball", f"<= {goal} ms", *_drag(tree)))
    three = ball(40_000) - ball(30_000, 0.7, BITE) - ball(30_000, 0.6, (-0.6, -0.6, 0.2))
    lines.append(("100,000 surfels, three operands", "<= 15 ms", *_drag(three)))
    lines.append(("100,000 surfels less a cylinder", "<= 15 ms", *_drag(ball(100_000) - surfel.Cylinder(0.4, 4.0))))
    head = ("step of a drag", "reach", "clock", "slowest", "processor", "of it classifying", "sent", "disks shown")
    return (
        f"Median of {_STEPS} steps: a pose comes in, every disk is classified, the page is told. More than 200,000 "
        "disks of one operand are thinned; what is measured on release is not.\n\n" + table(head, lines)
    )


def _drag(tree: surfel.Difference) -> tuple[str, ...]:
    with surfel.view(tree, port=0) as viewer, _listening(viewer) as heard:
        if not viewer.settled(300.0):
            raise RuntimeError("the page was never ready")
        classifying: list[float] = []
        _watch(viewer, classifying)
        clock, processor, sent = [], [], []
        for step in range(_STEPS + 2):
            heard.clear()
            started, spent = time.perf_counter(), time.process_time()
            push(viewer, 0.01 * (step + 1))
            done, length = heard.wait()
            clock.append(done - started)
            processor.append(time.process_time() - spent)
            sent.append(length)
            time.sleep(0.03)
        shown = sum(len(elements.points) for elements in viewer._elements)
    ms = [1e3 * statistics.median(values[2:]) for values in (clock, processor, classifying)]
    return (
        f"{ms[0]:.1f} ms", f"{1e3 * max(clock[2:]):.0f} ms", f"{ms[1]:.1f} ms", f"{ms[2]:.1f} ms",
        f"{statistics.median(sent[2:]) / 1e3:,.0f} kB", f"{shown:,}",
    )  # fmt: skip


def push(viewer: Viewer, far: float, phase: str = "update") -> None:
    """Move the second operand as a hand would: so far along x from where it came."""
    pose = np.eye(4)
    pose[0, 3] = far
    viewer._mover(1)(*viewer._frame.control(pose, viewer._pivots[1]), phase)


class _Heard:
    """When what was written to a socket was long enough to hold disks."""

    def __init__(self) -> None:
        self._news = threading.Event()
        self._last = (0.0, 0)

    def note(self, length: int) -> None:
        if length > _STEP:
            self._last = (time.perf_counter(), length)
            self._news.set()

    def clear(self) -> None:
        self._news.clear()

    def wait(self) -> tuple[float, int]:
        if not self._news.wait(60.0):
            raise RuntimeError("nothing was sent")
        return self._last


@contextmanager
def _listening(viewer: Viewer) -> Iterator[_Heard]:
    """Have a page of another process listen, and note what is handed to its socket."""
    import viser
    from websockets.asyncio.server import ServerConnection

    heard, real = _Heard(), ServerConnection.send

    async def send(self: Any, message: Any, *more: Any, **known: Any) -> None:
        await real(self, message, *more, **known)
        heard.note(len(message))

    ServerConnection.send = send  # type: ignore[method-assign]
    address = viewer.url.replace("http", "ws")
    page = subprocess.Popen([sys.executable, "-c", _LISTENER, address, f"viser-v{viser.__version__}"])
    try:
        heard.wait()
        yield heard
    finally:
        ServerConnection.send = real  # type: ignore[method-assign]
        page.terminate()
        page.wait()


def _watch(viewer: Viewer, seconds: list[float]) -> None:
    """Note how long the draft takes to classify."""
    real = viewer._draft.kept

    def kept(*given: Any) -> Any:
        started = time.perf_counter()
        found = real(*given)
        seconds.append(time.perf_counter() - started)
        return found

    viewer._draft.kept = kept  # type: ignore[assignment]


def _serving() -> str:
    scan = ball(100_000)
    started = time.perf_counter()
    with surfel.view(scan - surfel.Cylinder(0.4, 4.0), port=0) as viewer:
        with urlopen(viewer.url) as page:
            page.read()
        served = time.perf_counter() - started
    return table(("serving", "reach", "clock"), [("from the call to a served page", "<= 2 s", f"{served:.2f} s")])
