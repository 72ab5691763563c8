"""Table 1 of Gaal: which surfels of either solid each operation keeps, and which of them turn their normals."""

from __future__ import annotations

import numpy as np
import pytest

import surfel

N = 6000
AWAY = np.array([0.9, 0.3, -0.2])


def ball(seed, center, radius):
    normals = np.random.default_rng(seed).standard_normal((N, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return surfel.Surfels(radius * normals + center, normals=normals)


@pytest.fixture(scope="module")
def solids():
    return ball(0, np.zeros(3), 1.0), ball(1, AWAY, 0.8)


ROWS = {  # operation: does it keep the surfels of S1 that are inside of S2, those of S2 inside of S1; which one turns
    "S1 or S2": (lambda a, b: a | b, False, False, None),
    "S1 and S2": (lambda a, b: a & b, True, True, None),
    "S1 less S2": (lambda a, b: a - b, False, True, 1),
    "S2 less S1": (lambda a, b: b - a, True, False, 0),  # the paper prints S1 \ S2 a second time
}


@pytest.mark.parametrize("row", ROWS)
def test_the_row(solids, row):
    make, first_inside, second_inside, turned = ROWS[row]
    one, two = solids
    result = surfel.combine(make(one, two), cut="none").surfels
    expected = []
    for leaf, (cloud, center, radius, wanted) in enumerate(
        ((one, AWAY, 0.8, first_inside), (two, np.zeros(3), 1.0, second_inside))
    ):
        inside = np.linalg.norm(cloud.points - center, axis=1) < radius
        chosen = cloud.points[inside == wanted]
        normals = cloud.normals[inside == wanted] * (-1.0 if turned == leaf else 1.0)
        expected.append(np.column_stack([chosen, normals]))
    want = {tuple(r) for r in np.vstack(expected).round(9)}
    found = {tuple(r) for r in np.column_stack([result.points, result.normals]).round(9)}
    wrong = len(want ^ found)
    assert wrong <= 0.002 * 2 * N  # surfels within a hair of the other surface


def test_the_rows_share_out_all_surfels(solids):
    one, two = solids
    kept = {row: surfel.combine(make(one, two), cut="none").kept for row, (make, *_) in ROWS.items()}
    for leaf in (0, 1):
        assert kept["S1 or S2"][leaf] + kept["S1 and S2"][leaf] == N
    assert kept["S1 less S2"][0] == kept["S1 or S2"][0] and kept["S1 less S2"][1] == kept["S1 and S2"][1]
    assert kept["S2 less S1"] == (kept["S1 or S2"][1], kept["S1 and S2"][0])
