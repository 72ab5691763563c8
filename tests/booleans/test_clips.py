"""Clips, half axes and judges of clouds: slicing, joining, motion, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.core.affine import rotation, scaling
from surfel.shapes.clips import Clips


def some(seed=0, n=40):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 4, n)
    normals = rng.standard_normal((counts.sum(), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.concatenate([normals, rng.uniform(0.05, 0.3, (len(normals), 1))], axis=1)
    return Clips(np.concatenate([[0], np.cumsum(counts)]), planes, rng.standard_normal((n, 3)), rng.random(n))


def slow_left(clips, row, offset):
    return all(offset @ plane[:3] <= plane[3] for plane in clips.planes[clips.offsets[row] : clips.offsets[row + 1]])


def test_places_are_left_as_the_planes_say():
    clips, rng = some(), np.random.default_rng(1)
    rows, offsets = rng.integers(0, len(clips), 500), rng.standard_normal((500, 3)) * 0.3
    wanted = [slow_left(clips, row, offset) for row, offset in zip(rows, offsets, strict=True)]
    assert clips.leaves(rows, offsets).tolist() == wanted
    assert 50 < sum(wanted) < 450


def test_slices_and_joins():
    clips, rng = some(), np.random.default_rng(2)
    for rows in (slice(3, 30, 4), rng.permutation(40)[:11], rng.random(40) < 0.5, slice(0, 0)):
        part = clips[rows]
        chosen = np.arange(40)[rows]
        assert part.counts.tolist() == clips.counts[chosen].tolist()
        for k, row in enumerate(chosen):
            assert np.array_equal(
                part.planes[part.offsets[k] : part.offsets[k + 1]],
                clips.planes[clips.offsets[row] : clips.offsets[row + 1]],
            )
        assert np.array_equal(part.areas, clips.areas[chosen])
        assert np.array_equal(part.places, clips.places[chosen])
    both = clips.joined(some(5, 7))
    assert len(both) == 47
    assert np.array_equal(both[:40].planes, clips.planes)
    assert np.array_equal(both[40:].areas, some(5, 7).areas)


def test_planes_follow_any_affine_map():
    clips, rng = some(), np.random.default_rng(3)
    linear = rng.standard_normal((3, 3)) + 2.0 * np.eye(3)
    moved = clips.transformed(linear, None)
    rows, offsets = rng.integers(0, len(clips), 500), rng.standard_normal((500, 3)) * 0.3
    assert np.array_equal(moved.leaves(rows, offsets @ linear.T), clips.leaves(rows, offsets))
    assert np.allclose(np.linalg.norm(moved.planes[:, :3], axis=1), 1.0)


def test_areas_follow_by_the_stretch_of_their_planes():
    normals = np.eye(3)[[0, 1, 2]]
    clips = Clips(np.zeros(4, int), np.empty((0, 4)), areas=np.ones(3))
    assert clips.transformed(np.diag([2.0, 3.0, 5.0]), normals).areas == pytest.approx([15.0, 10.0, 6.0])


def test_areas_are_found_when_asked_for():
    asked = []
    clips = Clips([0, 0, 0], np.empty((0, 4)), areas=lambda: asked.append(1) or np.array([1.0, 2.0]))
    part = clips[1:]
    assert not asked
    assert part.areas.tolist() == [2.0]
    assert clips.areas.tolist() == [1.0, 2.0]
    assert len(asked) == 1
    assert Clips([0], np.empty((0, 4))).areas is None


def test_bad_clips_are_refused():
    for offsets, planes in (([0, 2], [[1, 0, 0, 1]]), ([1, 1], np.empty((0, 4))), ([0, 1], [[np.nan, 0, 0, 1]])):
        with pytest.raises(surfel.InputError):
            Clips(offsets, planes)
    with pytest.raises(surfel.InputError, match="clips must have one row"):
        surfel.Surfels(np.zeros((3, 3)), clips=some())


def test_axes_follow_affine_maps():
    axes = np.array([[[2.0, 0, 0], [0, 1.0, 0]]])
    cloud = surfel.Surfels([[1.0, 2, 3]], [[0, 0, 1.0]], axes=axes)
    turned = cloud.transformed(rotation((0, 0, 1), 90.0))
    assert np.abs(turned.axes[0]) == pytest.approx(np.abs([[0, 2, 0], [1, 0, 0]]), abs=1e-12)
    stretched = cloud.transformed(scaling((1.0, 4.0, 1.0)))
    assert np.sort(np.linalg.norm(stretched.axes[0], axis=1)) == pytest.approx([2.0, 4.0])
    assert (cloud + cloud)[1:].axes.shape == (1, 2, 3)
    with pytest.raises(surfel.InputError, match="axes must be finite"):
        surfel.Surfels([[1.0, 2, 3]], axes=np.ones((1, 3)))


def test_a_cloud_carries_its_judge():
    cloud = surfel.Surfels(np.random.default_rng(0).standard_normal((50, 3)))
    assert cloud.judge is None
    assert cloud.with_judge("imls")[3:].judge == "imls"
    assert (cloud.with_judge("imls") + cloud).judge is None
    with pytest.raises(surfel.InputError, match="judge must be one of"):
        cloud.with_judge("jury")


def test_rows_that_are_not_finite_take_their_clips_along():
    points = np.zeros((40, 3))
    points[5] = np.nan
    cloud = surfel.Surfels(points, clips=some())
    assert len(cloud.clips) == 39
    assert np.array_equal(cloud.clips.areas, np.delete(some().areas, 5))
