"""Memory of pictures: used again when the last view of it is gone, and not before."""

from __future__ import annotations

import gc

import numpy as np
import pytest

import surfel
from surfel.rendering.memory import _HUGE, _LARGE, room


def address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


@pytest.mark.parametrize(("shape", "dtype"), [(_LARGE, np.uint8), ((_LARGE // 6, 3), np.float32)])
def test_room_is_used_again_when_the_last_view_is_gone(shape, dtype):
    first = room(shape, dtype)
    assert first.shape == (shape if isinstance(shape, tuple) else (shape,))
    assert first.dtype == dtype and first.flags.writeable and first.flags.c_contiguous
    first[:] = 7
    where, part = address(first), first.reshape(-1)[1::2]
    del first
    gc.collect()
    second = room(shape, dtype)
    second[:] = 9
    assert address(second) != where
    assert (part == 7).all()
    del part
    gc.collect()
    assert address(room(shape, dtype)) == where


def test_small_and_huge_arrays_are_numpys_own():
    assert room((3, 4), np.int32).base is None
    assert room(_HUGE + 1, np.uint8).base is None


def test_a_picture_stays_as_it_is_while_others_come_and_go():
    normals = np.random.default_rng(0).standard_normal((2_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ball = surfel.Surfels(normals, normals=normals)
    camera = surfel.Camera((0.0, -4.0, 0.0), (0, 0, 0))
    image = surfel.render(ball, camera, (640, 480))
    pixels, ids = np.asarray(image), image.ids
    before, ids_before = pixels.copy(), ids.copy()
    del image
    for k in range(3):
        surfel.render(ball, surfel.Camera((0.0, -3.0 - k, 1.0), (0, 0, 0)), (640, 480))
    np.testing.assert_array_equal(pixels, before)
    np.testing.assert_array_equal(ids, ids_before)
