"""render(): a picture of shapes."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surfel._numba import compile_seconds
from surfel.core.cast import as_choice
from surfel.core.errors import InputError
from surfel.rendering.camera import Camera, as_size
from surfel.rendering.fragments import Fragments
from surfel.rendering.frame import Frame
from surfel.rendering.image import Image
from surfel.rendering.overlay import curves_of, draw_over
from surfel.rendering.places import Places
from surfel.rendering.reference import Reference
from surfel.rendering.scene import Scene
from surfel.rendering.shading import developed, mean_of_places
from surfel.rendering.silhouettes import silhouettes

METHODS = ("blend", "clip-buffer", "quads")
BACKGROUND = (255, 255, 255)

_WITHIN = np.array([[-0.125, -0.375], [0.375, -0.125], [-0.375, 0.125], [0.125, 0.375]], np.float32)
"""Four places in a pixel, no two in a row or a column."""


def render(
    shapes: Any,
    camera: Camera | None = None,
    size: tuple[int, int] = (1024, 768),
    *,
    orthographic: bool = False,
    background: ArrayLike = BACKGROUND,
    smooth: bool = True,
    method: str = "blend",
    reference: bool = False,
    curve: bool = False,
) -> Image:
    """Take a picture of shapes, of trees of shapes, or of several of these together.

    Clouds are drawn as splats in two passes. Everything else is crossed by the camera's lines of sight, as it is for
    measuring. Of a tree what is seen is decided at each pixel, at the blended point, so that the edge of a cut is as
    sharp as the picture; where a solid is subtracted its back shows the cut.

    Parameters
    ----------
    shapes : Shape or iterable of Shape
        What is seen. Safe splines and the results of Boolean operations may be given as they are.
    camera : Camera, optional
        By default one that sees everything, from the front, the right and above.
    size : tuple of int
        Width and height in pixels.
    orthographic : bool
        Of the default camera: parallel lines of sight.
    background : array_like, shape (3,)
        Red, green and blue, 0 to 255.
    smooth : bool
        Smooth the edges: four places of each pixel there are looked at.
    method : {"blend", "clip-buffer", "quads"}
        How the trees of clouds are drawn. ``blend``: as above. For comparison, as published: ``clip-buffer``, where
        surfels at a cut are clipped by each other's planes (Wicke et al.; Gaal, sec. 4.3); ``quads``, where surfels are
        kept or dropped as a whole and blended as textured squares in two passes (Gaal, sec. 7).
    reference : bool
        Cast every line of sight through the tree, clouds included: slow, and what the others are compared with.
    curve : bool
        Draw over the picture where the operands meet, hidden parts left out: of results of :func:`surfel.combine`, and
        of trees, which are combined for that, once.

    Returns
    -------
    Image
        The picture, with depths, normals and the numbers of leaves as further layers.

    Raises
    ------
    InputError
        If something is no shape, the shapes have no end and there is no camera, an argument is out of its range, there
        is no curve to draw, or shapes or the camera's distances are larger than 1e15 or smaller than 1e-15.

    Notes
    -----
    Gaal, *Boolean Operations on Point-Sampled Geometry*, secs. 2, 4.3 and 7.

    Examples
    --------
    >>> import surfel
    >>> part = surfel.Box(2) - surfel.Sphere(1.3)
    >>> image = surfel.render(part, size=(80, 60))
    >>> sorted(set(image.ids.ravel().tolist()))
    [-1, 0, 1]
    """
    started, compiled = time.perf_counter(), compile_seconds()
    width, height = as_size(size)
    as_choice(method, "method", METHODS)
    ground = _background(background)
    scene = Scene(shapes)
    if camera is None:
        camera = _fitted(scene, (width, height), orthographic)
    elif not isinstance(camera, Camera):
        raise InputError(f"camera must be a surfel.Camera; got {type(camera).__name__}")
    frame = _frame(scene, camera, (width, height), method, reference)
    seen = frame.grid()
    pixels = _developed(frame, seen, ground, smooth)
    if curve:
        depth = seen.depth.astype(np.float64).reshape(height, width) + frame.middle
        draw_over(pixels, depth, camera, curves_of(shapes))
    spent = time.perf_counter() - started - (compile_seconds() - compiled)
    return Image(pixels, camera, seen, frame.middle, spent)


def _frame(scene: Scene, camera: Camera, size: tuple[int, int], method: str, reference: bool) -> Frame:
    if reference:
        return Reference(scene, camera, size)
    if method == "blend":
        return Frame(scene, camera, size)
    from surfel.rendering.published import ClipBuffer, Quads

    return (ClipBuffer if method == "clip-buffer" else Quads)(scene, camera, size)


def _fitted(scene: Scene, size: tuple[int, int], orthographic: bool) -> Camera:
    if not np.isfinite(scene.bounds).all():
        raise InputError(
            "the shapes have no end, so no camera sees all of them; give one (surfel.Camera(eye, target)), or "
            "intersect them with a bounded shape"
        )
    return Camera.around(scene.outline, size, orthographic=orthographic)


def _background(value: ArrayLike) -> NDArray[np.uint8]:
    given = np.asarray(value)
    if given.shape != (3,) or given.dtype.kind not in "iuf" or not ((given >= 0) & (given <= 255)).all():
        raise InputError(f"background must be red, green and blue, 0 to 255; got {value!r}")
    return given.astype(np.uint8)


def _developed(frame: Frame, seen: Fragments, ground: NDArray[np.uint8], smooth: bool) -> NDArray[np.uint8]:
    """Return the pixels: fragments in the light, and at edges the mean of four."""
    picture = developed(seen, frame.view, ground)
    if smooth:
        edges = silhouettes(seen, frame.view)
        if len(edges):
            found = frame.at(Places(edges, _WITHIN))
            mean_of_places(found, len(_WITHIN), edges, ground, picture)
    return picture.pixels
