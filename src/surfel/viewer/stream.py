"""Stream: finished pictures, drawn here, for browsers that cannot draw disks fast enough themselves."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from surfel.core.errors import SurfelError
from surfel.rendering.camera import Camera
from surfel.rendering.image import Image
from surfel.rendering.render import render
from surfel.shapes.base import Shape
from surfel.viewer.frame import Frame
from surfel.viewer.page import Page

_MOST = 1_000_000
"""Pixels of a picture."""

_ROUGH = 200_000
"""Pixels of one while things move."""

_REST = 0.4
"""Seconds without news after which a picture is drawn with all its pixels."""


class Stream:
    """Draws for each client that wants it what its camera sees, as often as it can: roughly first, and then in full."""

    def __init__(self, page: Page, frame: Frame, tree: Callable[[], Shape]) -> None:
        self._page, self._frame, self._tree = page, frame, tree
        self._wanted: dict[int, Any] = {}
        self._news = threading.Condition()
        self._dirty: set[int] = set()
        self._rough: set[int] = set()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="surfel-stream", daemon=True)
        self._thread.start()

    def choose(self, client: Any, wanted: bool) -> None:
        """Begin or end to send pictures to a client, in place of what it would draw itself."""
        with self._news:
            known = client.client_id in self._wanted
            if wanted and not known:
                client.camera.on_update(lambda camera: self._looks(camera.client))
            if wanted:
                self._wanted[client.client_id] = client
                self._dirty.add(client.client_id)
            else:
                self._wanted.pop(client.client_id, None)
            self._news.notify_all()
        self._page.hide_from(client, wanted)
        if not wanted:
            self._page.show_picture(client, None)

    def forget(self, client: Any) -> None:
        """Drop a client that left."""
        with self._news:
            self._wanted.pop(client.client_id, None)
        self._page.forget(client)

    def serves_all(self, clients: int) -> bool:
        """Tell whether all of so many clients get pictures, so that nobody would see disks."""
        with self._news:
            return 0 < clients <= len(self._wanted)

    def changed(self) -> None:
        """Say that what is to be seen has changed."""
        with self._news:
            self._dirty |= set(self._wanted)
            self._news.notify_all()

    def picture(self, client: Any, most: int = _MOST) -> Image:
        """Return what a client's camera sees, drawn here."""
        camera = client.camera
        width, height = max(1, int(camera.image_width)), max(1, int(camera.image_height))
        factor = min(1.0, (most / (width * height)) ** 0.5)
        return render(
            self._tree(), camera=self._camera(camera), size=(max(1, int(width * factor)), max(1, int(height * factor)))
        )

    def end(self) -> None:
        """Stop."""
        with self._news:
            self._ended = True
            self._news.notify_all()
        self._thread.join()

    def _camera(self, camera: Any) -> Camera:
        def world(place: Any) -> tuple[float, float, float]:
            x, y, z = (np.asarray(place, np.float64) / self._frame.unit + self._frame.middle).tolist()
            return x, y, z

        up = tuple(float(value) for value in camera.up_direction)
        return Camera(world(camera.position), world(camera.look_at), up, float(np.degrees(camera.fov)))  # type: ignore[arg-type]

    def _looks(self, client: Any) -> None:
        with self._news:
            if client.client_id in self._wanted:
                self._dirty.add(client.client_id)
                self._news.notify_all()

    def _run(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._ended or bool(self._dirty), _REST if self._rough else None)
                if self._ended:
                    return
                rough = bool(self._dirty)
                asking = self._dirty if rough else self._rough
                clients = [self._wanted[k] for k in asking if k in self._wanted]
                self._rough = self._rough | asking if rough else set()
                self._dirty = set()
            for client in clients:
                self._draw(client, _ROUGH if rough else _MOST)

    def _draw(self, client: Any, most: int) -> None:
        try:
            self._page.show_picture(client, np.asarray(self.picture(client, most)))
        except (SurfelError, OSError):  # what cannot be drawn is told by the panel; a client may have left
            time.sleep(0.1)
