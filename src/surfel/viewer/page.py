"""The page: the one place that knows viser. It draws a stage, and hands on what is done to it."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Booleans, Floats
from surfel.core.errors import InputError, MissingExtraError
from surfel.rendering.palette import leaf_color
from surfel.viewer.elements import Elements
from surfel.viewer.frame import Frame, upright

_CORNERS = 8
_GIZMO = 0.45  # of the browser's units, at least
SEEN_FROM = {"z": (2.1, -2.8, 1.6), "y": (2.1, 1.6, 2.8), "x": (1.6, 2.1, -2.8)}
"""Where cameras are at first, by the axis that is up."""


def start_server(host: str, port: int) -> Any:
    """Return a server that listens; the next free port is taken where that one is not."""
    try:
        import viser
    except ImportError as error:
        raise MissingExtraError("viser", "view") from error
    import logging

    _check_address(host)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):  # it greets on the standard output, which is not its own
        return viser.ViserServer(host=host, port=port, label="surfel", verbose=False)


def _check_address(host: str) -> None:
    """Refuse an address that is not this computer's, for which the server would wait without end."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.bind(address)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot listen on {host!r}: {reason}; take an address of this computer") from error


def stop_server(server: Any) -> None:
    """Stop listening, without the farewell on the standard output."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class Page:
    """What every client sees: the disks of each part under a control, and the exact result."""

    def __init__(self, server: Any, up: str = "z") -> None:
        self.server = server
        self._controls: list[Any] = []
        self._disks: list[Any] = []
        self._scales: list[NDArray[np.float32]] = []
        self._result: Any = None
        self._surface: Any = None
        self._groups: list[str] = []
        self._hidden: dict[int, tuple[Any, list[Any]]] = {}
        self._lock = threading.Lock()
        server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        server.scene.set_up_direction(f"+{up}")
        server.initial_camera.position = SEEN_FROM[up]
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.scene.add_light_hemisphere("/lights/sky", sky_color=(255, 255, 255), ground_color=(150, 140, 130))
        self._add_group("/exact")

    def add_part(
        self, number: int, elements: Elements, frame: Frame, pivot: Floats, moved: Callable[[Floats, Floats, str], None]
    ) -> None:
        """Show a part by its disks, under a control that moves it; ``moved`` hears of every phase of a drag."""
        scene = self.server.scene
        span = float(np.ptp(elements.points, axis=0).max(initial=0.0)) * frame.unit
        control = scene.add_transform_controls(
            f"/parts/{number}", scale=max(_GIZMO, 0.6 * span), depth_test=False, opacity=0.7, line_width=2.0
        )
        control.position = (pivot - frame.middle) * frame.unit
        self._add_group(f"/parts/{number}/drawn")
        corners, faces = _disk()
        scales = (elements.radii * frame.unit).astype(np.float32)
        disks = scene.add_batched_meshes_simple(
            f"/parts/{number}/drawn/disks",
            corners,
            faces,
            batched_wxyzs=upright(elements.normals),
            batched_positions=((elements.points - pivot) * frame.unit).astype(np.float32),
            batched_scales=scales,
            batched_colors=_colors(elements, number),
            side="double",
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

        control.on_update(lambda event: moved(np.array(control.position), np.array(control.wxyz), event.phase))
        self._controls.append(control)
        self._disks.append(disks)
        self._scales.append(scales)

    def show_parts(self, kept: list[Booleans]) -> None:
        """Show of each part the disks that are kept, in place of the exact result."""
        with self.server.atomic():
            for disks, scales, keeps in zip(self._disks, self._scales, kept, strict=True):
                disks.batched_scales = np.where(keeps, scales, np.float32(0.0))
                disks.visible = True
            if self._result is not None:
                self._result.visible = False
        self.server.flush()  # a hand is waiting: nothing is held back for more to come

    def show_result(self, elements: Elements, leaves: NDArray[np.int64], frame: Frame) -> None:
        """Show the exact result in place of the parts."""
        corners, faces = _disk()
        palette = np.array([leaf_color(k) for k in range(len(self._disks))], np.uint8).reshape(-1, 3)
        with self.server.atomic():
            self._result = self.server.scene.add_batched_meshes_simple(
                "/exact/result",
                corners,
                faces,
                batched_wxyzs=upright(elements.normals),
                batched_positions=frame.shown(elements.points),
                batched_scales=(elements.radii * frame.unit).astype(np.float32),
                batched_colors=palette[leaves] if elements.colors is None else elements.colors,
                side="double",
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
            )
            for disks in self._disks:
                disks.visible = False

    def put(self, number: int, position: Floats, wxyz: Floats) -> None:
        """Put the control of a part somewhere."""
        self._controls[number].position = position
        self._controls[number].wxyz = wxyz

    def show_surface(self, corners: Floats | None, faces: NDArray[np.int32] | None, frame: Frame) -> None:
        """Show a surface of triangles over everything, or none."""
        if self._surface is not None:
            self._surface.remove()
            self._surface = None
        if corners is not None and faces is not None and len(faces):
            self._surface = self.server.scene.add_mesh_simple(
                "/surface", frame.shown(corners), faces, color=(120, 150, 210), opacity=0.45, side="double"
            )

    def show_picture(self, client: Any, picture: NDArray[np.uint8] | None) -> None:
        """Show a client a picture behind everything, or none."""
        client.scene.set_background_image(picture, format="jpeg", jpeg_quality=85)
        client.flush()

    def hide_from(self, client: Any, hidden: bool) -> None:
        """Hide from one client what browsers draw themselves, controls excepted, or show it again."""
        with self._lock:
            _, veils = self._hidden.pop(client.client_id, (client, []))
            for veil in veils:
                veil.remove()
            if hidden:
                self._hidden[client.client_id] = (client, [_veil(client, name) for name in self._groups])

    def forget(self, client: Any) -> None:
        """Drop what was kept for a client that left."""
        with self._lock:
            self._hidden.pop(client.client_id, None)

    def _add_group(self, name: str) -> None:
        """Add a node for what can be hidden from single clients."""
        with self._lock:
            self.server.scene.add_frame(name, show_axes=False)
            self._groups.append(name)
            for client, veils in self._hidden.values():
                veils.append(_veil(client, name))


def _veil(client: Any, name: str) -> Any:
    """Put an invisible node over one of that name, for one client; all below it is gone there."""
    return client.scene.add_frame(name, show_axes=False, visible=False)


def _disk() -> tuple[Floats, NDArray[np.int32]]:
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    corners = np.stack([np.cos(angle), np.sin(angle), np.zeros(_CORNERS)], axis=1)
    first = np.arange(1, _CORNERS - 1)
    return corners, np.stack([np.zeros_like(first), first, first + 1], axis=1).astype(np.int32)


def _colors(elements: Elements, number: int) -> NDArray[np.uint8]:
    if elements.colors is not None:
        return elements.colors
    return np.tile(np.array(leaf_color(number), np.uint8), (len(elements.points), 1))
