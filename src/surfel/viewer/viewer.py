"""Viewer: a stage, the page that shows it, and what is computed of it as it changes."""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from surfel.core.cast import Floats, as_choice
from surfel.core.errors import InputError, SurfelError
from surfel.shapes.base import Shape
from surfel.shapes.surfels import Surfels
from surfel.shapes.tree import Tree
from surfel.viewer.draft import Draft
from surfel.viewer.elements import Elements, elements_of
from surfel.viewer.frame import Frame
from surfel.viewer.outcome import outcome_of
from surfel.viewer.page import SEEN_FROM, Page, start_server, stop_server
from surfel.viewer.panel import Panel
from surfel.viewer.script import script_of
from surfel.viewer.stage import Stage
from surfel.viewer.stream import Stream
from surfel.viewer.surface import Lid, lid_of
from surfel.viewer.worker import Stale, Worker

DRAWING = ("auto", "browser", "server")
"""Who may draw: browsers, but for those without a graphics card; always the browser; always the server."""


@dataclass(frozen=True)
class Settings:
    """What the sliders of the page set.

    Parameters
    ----------
    lines : int
        Of a measurement.
    level : int
        How often surfels are halved at the cut.
    lid : bool
        Whether a safe surface lies over the points.
    coefficients : int
        Of the safe surface, along each side.
    side, mode : str
        Of the safe surface.
    """

    lines: int = 16_384
    level: int = 2
    lid: bool = False
    coefficients: int = 20
    side: str = "above"
    mode: str = "fast"


class Viewer:
    """A page in the browser with solids that can be moved; what :func:`surfel.view` returns.

    Attributes
    ----------
    url : str
        Where the page is.
    draw : str
        Who draws; one of :data:`DRAWING`.
    """

    def __init__(self, stage: Stage, host: str, port: int, draw: str = "auto", up: str = "z") -> None:
        self._stage = stage
        self.draw = as_choice(draw, "draw", DRAWING)
        as_choice(up, "up", tuple(SEEN_FROM))
        self._server = start_server(host, port)
        self.url = f"http://{self._server.get_host()}:{self._server.get_port()}"
        self._lock = threading.RLock()
        self._settings = Settings()
        self._elements: list[Elements] = []
        self._pivots: list[Floats] = []
        self._draft = Draft()
        self._frame = Frame.of(scene_box(stage))
        self._page = Page(self._server, up)
        self._panel = Panel(self._server, self)
        self._stream = Stream(self._page, self._frame, self.tree)
        self._worker = Worker(self._follow, self._settle, self._failed)
        self._server.on_client_disconnect(self._stream.forget)
        self._worker.rest()
        self._worker.start()

    def tree(self) -> Shape:
        """Return the expression that is on the screen, every part where it is now."""
        with self._lock:
            return self._stage.tree()

    def script(self) -> str:
        """Return the Python that makes what is on the screen."""
        with self._lock:
            return script_of(self._stage)

    def html(self) -> str:
        """Return the scene as one HTML page that needs no server."""
        self.settled()
        serializer = self._server.get_scene_serializer()
        text: str = serializer.as_html()
        return text

    def close(self) -> None:
        """Stop serving the page."""
        self._stream.end()
        self._worker.end()
        stop_server(self._server)

    def wait(self) -> None:
        """Serve the page until interrupted."""
        with contextlib.suppress(KeyboardInterrupt):
            while True:
                time.sleep(3600.0)
        self.close()

    def settled(self, seconds: float = 60.0) -> bool:
        """Wait until all that was asked for is computed and sent; False where that takes longer."""
        return self._worker.wait(seconds)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # What the panel asks for.

    @property
    def stage(self) -> Stage:
        """The parts, and how they are joined."""
        return self._stage

    @property
    def settings(self) -> Settings:
        """What the sliders set."""
        return self._settings

    def set(self, **changes: Any) -> None:
        """Change settings, and compute anew what depends on them."""
        with self._lock:
            self._settings = replace(self._settings, **changes)
        self._worker.rest()

    def switch(self, join: int, operation: str) -> None:
        """Change an operation."""
        with self._lock:
            self._stage.switch(join, operation)
        self._worker.rest()

    def reset(self, part: int) -> None:
        """Put a part back where it came from."""
        with self._lock:
            self._stage.move(part, np.eye(4))
            self._page.put(part, *self._frame.control(np.eye(4), self._pivots[part]))
        self._worker.rest()

    def load(self, name: str, content: bytes) -> None:
        """Add what a file holds to the stage.

        Raises
        ------
        SurfelError
            If the file cannot be read.
        """
        from surfel.io import read

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / (Path(name).name or "upload")
            path.write_bytes(content)
            shape = read(path)
            if not isinstance(shape, Shape):
                raise InputError(f"{name} holds no shape")
        with self._lock:
            self._stage.add(shape, [Path(name).stem])
        self._worker.rest()

    def result_file(self) -> bytes:
        """Return the surfels of the result as a PLY file."""
        from surfel.booleans.combine import combine
        from surfel.io import write

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "result.ply"
            write(path, combine(self.tree(), cut="split", level=self._settings.level).surfels)
            return path.read_bytes()

    def picture_file(self, client: Any) -> bytes:
        """Return a picture from where a client looks, as a PNG file."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "picture.png"
            self._stream.picture(client).save(path)
            return path.read_bytes()

    def draw_on_server(self, client: Any, wanted: bool) -> None:
        """Send a client finished pictures in place of disks, or no longer."""
        self._stream.choose(client, wanted)

    # What the worker calls.

    def _follow(self) -> None:
        with self._lock:
            self._add_parts()
            if not self._stream.serves_all(len(self._server.get_clients())):
                self._page.show_parts(self._draft.kept(self._stage, self._elements))
        self._stream.changed()

    def _settle(self, stale: Stale) -> None:
        with self._lock:
            tree, settings = self._stage.tree(), self._settings
        self._panel.busy()
        if isinstance(tree, Tree):
            disks, leaves = outcome_of(tree, settings.level)
            with self._lock:  # a hand that takes hold now waits, and hides the result again
                if stale():
                    return
                self._page.show_result(disks, leaves, self._frame)
        lid = lid_of(tree, settings) if settings.lid else Lid(None, None, "")
        if stale():
            return
        self._page.show_surface(lid.corners, lid.faces, self._frame)
        from surfel.measuring.measure import measure

        found = measure(tree, lines=settings.lines)
        if not stale():
            self._panel.tell(found, lid.text)

    def _failed(self, error: Exception) -> None:
        text = str(error) if isinstance(error, SurfelError) else f"{type(error).__name__}: {error}"
        self._panel.complain("This could not be computed", text)

    def _add_parts(self) -> None:
        """Show the parts that are new."""
        box = scene_box(self._stage)
        for number in range(len(self._elements), len(self._stage.parts)):
            part = self._stage.parts[number]
            elements = elements_of(part.shape, box)
            pivot = elements.points.mean(axis=0) if len(elements.points) else box.mean(axis=0)
            self._elements.append(elements)
            self._pivots.append(pivot)
            self._page.add_part(number, elements, self._frame, pivot, self._mover(number))
            whole = len(part.shape) if isinstance(part.shape, Surfels) else len(elements.points)
            self._panel.add_part(number, len(elements.points), whole)
        self._panel.show_joins()

    def _mover(self, number: int) -> Any:
        def moved(position: Floats, wxyz: Floats, phase: str) -> None:
            with self._lock:
                self._stage.move(number, self._frame.pose(position, wxyz, self._pivots[number]))
            if phase == "end":
                self._worker.rest()
            else:
                self._worker.moved()

        return moved


def scene_box(stage: Stage) -> Floats:
    """Return the box round all parts that have an end, as they came; a unit box where none has."""
    boxes = []
    for part in stage.parts:
        with contextlib.suppress(InputError):  # an empty cloud
            box = np.asarray(part.shape.bounds)
            if np.isfinite(box).all():
                boxes.append(box)
    if not boxes:
        return np.array([[-1.0] * 3, [1.0] * 3])
    return np.stack([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])
