"""Clip planes pass through every format that keeps columns, and damaged columns stay plain attributes."""

from __future__ import annotations

import numpy as np
import pytest

import surfel
from surfel.io.clip_columns import AREA, clips_from, columns_of
from surfel.shapes.clips import Clips


def cloud():
    rng = np.random.default_rng(1)
    points = rng.random((5, 3))
    planes = rng.standard_normal((4, 4))
    planes[:, :3] /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    clips = Clips([0, 0, 3, 3, 4, 4], planes, rng.random((5, 3)), rng.random(5))
    return surfel.Surfels(points, normals=points, attributes={"leaf": np.arange(5)}, clips=clips)


@pytest.mark.parametrize("suffix", ["ply", "npz", "pcd", "csv", "xyz", "las", "e57"])
@pytest.mark.filterwarnings("ignore::surfel.SurfelWarning")
def test_clips_come_back(tmp_path, suffix):
    before = cloud()
    surfel.write(tmp_path / f"c.{suffix}", before)
    after = surfel.read(tmp_path / f"c.{suffix}")
    assert after.clips.counts.tolist() == before.clips.counts.tolist()
    for name in ("planes", "places", "areas"):
        np.testing.assert_allclose(getattr(after.clips, name), getattr(before.clips, name), rtol=1e-6, atol=1e-7)
    assert "leaf" in after.attributes and not any(name.startswith("clip_") for name in after.attributes)


def test_clips_without_areas_and_without_planes():
    for clips in (Clips([0, 0], np.empty((0, 4))), Clips([0, 1], [[1.0, 0.0, 0.0, 0.5]])):
        back, rest = clips_from(columns_of(clips))
        assert back.areas is None and back.counts.tolist() == clips.counts.tolist() and rest == {}


def test_incomplete_columns_stay_attributes():
    columns = columns_of(cloud().clips)
    del columns["clip_y"]
    clips, rest = clips_from(columns)
    assert clips is None and set(rest) == set(columns)
    words = {**columns_of(cloud().clips), AREA: np.array(["a"] * 5)}
    assert clips_from(words)[0] is None
