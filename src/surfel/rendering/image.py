"""Image: a picture with what was seen at each of its pixels."""

from __future__ import annotations

from functools import cached_property
from io import BytesIO
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats, read_only
from surfel.core.errors import InputError
from surfel.rendering.camera import Camera
from surfel.rendering.fragments import Fragments


class Image:
    """A picture; immutable. ``numpy.asarray(image)`` is its pixels; a notebook shows it as a PNG.

    Parameters
    ----------
    pixels : NDArray[np.uint8], shape (h, w, 3)
        Red, green and blue.
    camera : Camera
        Where it was taken from.
    seen : Fragments
        What is seen at the centre of each pixel, row after row.
    middle : float
        What the depths of ``seen`` are relative to.
    seconds : float
        Spent, compilation apart.

    Examples
    --------
    >>> import numpy as np, surfel
    >>> image = surfel.render(surfel.Sphere(1), size=(40, 30))
    >>> np.asarray(image).shape, image.size
    ((30, 40, 3), (40, 30))
    """

    def __init__(
        self, pixels: NDArray[np.uint8], camera: Camera, seen: Fragments, middle: float, seconds: float = 0.0
    ) -> None:
        self.camera, self.seconds = camera, seconds
        self.pixels = read_only(pixels)
        self._seen, self._middle = seen, middle

    @cached_property
    def depth(self) -> Floats:
        """How far ahead of the camera what is seen lies, shape (h, w); infinite where nothing is."""
        depth = self._seen.depth.astype(np.float64) + self._middle
        return read_only(depth.reshape(self.pixels.shape[:2]))

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """Unit normals in the world, towards the camera, shape (h, w, 3); zero where nothing is seen."""
        normals = np.zeros_like(self._seen.normal)
        normals[self._seen.seen] = self._seen.normal[self._seen.seen] @ self.camera.frame.astype(np.float32)
        return read_only(normals.reshape(self.pixels.shape))

    @cached_property
    def ids(self) -> NDArray[np.int32]:
        """Which leaf is seen, in the order of the shapes and of their leaves, shape (h, w); -1 for none."""
        return read_only(self._seen.leaf.reshape(self.pixels.shape[:2]))

    @cached_property
    def rows(self) -> NDArray[np.int32]:
        """Of a cloud, the row of the surfel that is seen, shape (h, w); -1 where there is none."""
        rows = np.where(self._seen.seen, self._seen.row, np.int32(-1))
        return read_only(rows.reshape(self.pixels.shape[:2]))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        height, width, _ = self.pixels.shape
        return width, height

    @property
    def covered(self) -> float:
        """Share of the pixels at which anything is seen."""
        return float(np.count_nonzero(self.ids >= 0) / self.ids.size)

    def point_at(self, x: int, y: int) -> Floats | None:
        """Return the place of the world that a pixel shows; None where it shows nothing.

        Raises
        ------
        InputError
            If there is no such pixel.
        """
        width, height = self.size
        if not (0 <= x < width and 0 <= y < height):
            raise InputError(f"the picture has {width} x {height} pixels; there is no pixel ({x}, {y})")
        if self.ids[y, x] < 0:
            return None
        looking = self.camera.rays([x], [y], self.size)
        depth = float(self._seen.depth[y * width + x]) + self._middle
        t = depth / float(looking.directions[0] @ self.camera.frame[2])
        return np.asarray(looking.origins[0] + t * looking.directions[0])

    def save(self, path: str | PathLike[str]) -> None:
        """Write the picture; the suffix tells the format (PNG where there is none). An old file is replaced at once.

        Raises
        ------
        InputError
            If the file cannot be written, or nothing writes that format.
        """
        from pathlib import Path

        from PIL import Image as Pillow

        from surfel.io.atomic import replacing

        suffix = Path(path).suffix.lower() or ".png"
        kind = Pillow.registered_extensions().get(suffix)
        if kind is None or kind not in Pillow.SAVE:
            raise InputError(f"no picture format is known by {suffix}; take .png")
        with replacing(path) as stream:
            self._drawn().save(stream, format=kind)

    def show(self) -> None:
        """Open the picture in the viewer of the system."""
        self._drawn().show()

    def _drawn(self) -> Any:
        from PIL import Image as Pillow

        return Pillow.fromarray(self.pixels)

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self._drawn().save(stream, format="PNG")
        return stream.getvalue()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        pixels = self.pixels if dtype is None else self.pixels.astype(dtype)
        return pixels.copy() if copy else pixels

    def __repr__(self) -> str:
        width, height = self.size
        return f"Image({width} x {height}, {self.covered:.0%} covered)"
