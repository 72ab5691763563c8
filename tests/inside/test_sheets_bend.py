"""Sheets that bend within the eight nearest surfels are one sheet, in its true place; edges stay two."""

from __future__ import annotations

import math

import numpy as np
import pytest

import shapes_with_truth as truth
from surfel.inside import sheets
from surfel.inside.operand import Operand


@pytest.mark.parametrize("spacing", [0.2, 0.3, 0.4])
def test_a_thin_tube_stands_where_it_is(spacing):
    tube = 0.1
    area = 4.0 * math.pi**2 * tube
    count = int(area / (spacing * tube) ** 2)
    cloud, asked = (truth.torus(n, seed, 1.0, tube) for n, seed in ((count, 1), (5000, 2)))
    value = sheets.judge(Operand.of(cloud.points, cloud.normals), asked.points).value
    assert abs(value.mean()) < 0.001 * tube
    assert value.std() < 0.01 * tube


@pytest.mark.parametrize("sides", [4, 6, 8, 12])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_edges_stay_sharp(sides, sign):
    rng = np.random.default_rng(sides)
    turn = 2.0 * math.pi / sides
    half = 0.5 * math.tan(0.5 * turn)
    angle = turn * rng.integers(sides, size=4000)
    along = rng.uniform(-half, half, 4000)
    normals = np.stack([np.cos(angle), np.sin(angle), np.zeros(4000)], axis=1)
    points = 0.5 * normals + along[:, None] * np.stack([-normals[:, 1], normals[:, 0], np.zeros(4000)], axis=1)
    points[:, 2] = rng.random(4000)
    places = rng.uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 0.8], (40_000, 3))
    ways = turn * np.arange(sides)
    depth = (places[:, :1] * np.cos(ways) + places[:, 1:2] * np.sin(ways)).max(axis=1) - 0.5
    close = np.abs(depth) < math.sqrt(2.0 * half * sides / 4000)
    value = sheets.judge(Operand.of(points, sign * normals), places[close]).value
    wrong = (sign * value < 0.0) != (depth[close] < 0.0)
    assert wrong.mean() < 2e-4
