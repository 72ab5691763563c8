"""The trim keeps all data, runs along cells and diagonals, and its polygons enclose just what it keeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfel.bounding.occupancy import HIGH, LEFT, LOW, RIGHT, WHOLE, outside
from surfel.bounding.trim import kept_share, outlines, trimmed


def cells(text):
    """Return an occupancy from rows of # and dots; the first row is the cell of least u."""
    return np.array([[WHOLE if letter == "#" else 0 for letter in row] for row in text.split()], np.uint8)


def signed_area(polygon):
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def winding(polygons, place):
    """Return how often the polygons run round a place that lies on none of them."""
    total = 0.0
    for polygon in polygons:
        a, b = polygon - place, np.roll(polygon, -1, axis=0) - place
        total += np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.einsum("ij,ij->i", a, b)).sum()
    return round(total / (2.0 * np.pi))


def test_a_staircase_becomes_a_diagonal():
    trim = trimmed(cells("#... ##.. ###. ####"))
    expected = cells("#... ##.. ###. ####")
    expected[0, 1] = expected[1, 2] = expected[2, 3] = RIGHT | LOW
    np.testing.assert_array_equal(trim, expected)
    assert [p.tolist() for p in outlines(trim)] == [[[0, 0], [4, 0], [4, 4], [3, 4], [0, 1]]]


def test_holes_are_kept_and_bays_are_not():
    trim = trimmed(cells("##### #...# #...# #...# #####"))
    assert (trim == WHOLE).all()
    bay = trimmed(cells("##### #...# #...# #...# #...#"))
    assert (bay[2:, 2] == 0).all()
    assert bay[1, 1] == LEFT | LOW and bay[1, 3] == LEFT | HIGH  # its inner corners are cut


def test_a_corner_that_juts_out_without_data_is_cut():
    occupancy = cells("... .#. ...")
    occupancy[1, 1] = RIGHT | HIGH
    assert trimmed(occupancy)[1, 1] == RIGHT | HIGH
    occupancy[1, 1] = LOW
    assert trimmed(occupancy)[1, 1] == LOW  # both upper corners are bare
    occupancy = cells("... .## ...")
    occupancy[1, 1] = HIGH
    assert trimmed(occupancy)[1, 1] == HIGH  # like a roof against the neighbour


def test_shares():
    np.testing.assert_array_equal(kept_share(np.array([[0, 1, 3, 7, 15]], np.uint8)), [[0.0, 0.25, 0.5, 0.75, 1.0]])


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 12), st.integers(3, 12), st.floats(0.05, 0.95), st.integers(0, 10_000))
def test_random_grids(rows, columns, share, seed):
    rng = np.random.default_rng(seed)
    occupancy = np.where(rng.random((rows, columns)) < share, rng.integers(1, 16, (rows, columns)), 0).astype(np.uint8)
    trim = trimmed(occupancy)
    assert (occupancy & ~trim == 0).all()
    polygons = outlines(trim)
    assert np.isclose(sum(map(signed_area, polygons)), kept_share(trim).sum())
    for polygon in polygons:
        steps = np.diff(np.concatenate([polygon, polygon[:1]]), axis=0)
        slanted = (steps != 0).all(axis=1)
        assert (np.abs(steps[slanted, 0]) == np.abs(steps[slanted, 1])).all()  # along cells or diagonal to them
        assert len(np.unique(polygon, axis=0)) == len(polygon)
    h, k = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    middles = {LEFT: (0.2, 0.51), RIGHT: (0.8, 0.51), LOW: (0.51, 0.2), HIGH: (0.51, 0.8)}
    for quarter, (i, j) in middles.items():
        for a, b in zip(h.ravel(), k.ravel(), strict=True):
            assert winding(polygons, np.array([a + i, b + j])) == int(trim[a, b] & quarter != 0)


def test_the_mask_of_a_spline_is_its_trim(make_spline):
    occupancy = cells("#..... ##.... ###... ...... .#.... ...... ...... #.....")
    spline = make_spline(np.ones((11, 9)), occupancy=occupancy)
    uv = np.random.default_rng(0).uniform(-1.0, 9.0, (5000, 2))
    mask = spline.trim_mask(uv)
    polygons = spline.trim_polygons()
    assert mask.any() and not mask.all()
    np.testing.assert_array_equal(mask[:400], [winding(polygons, place) == 1 for place in uv[:400]])
    np.testing.assert_array_equal(mask, ~np.isnan(spline(uv)))
    points = spline.frame.to_world(uv, 5.0)
    np.testing.assert_array_equal(spline.trim_mask(points), mask)


@pytest.mark.parametrize("state", range(1, 16))
def test_every_set_of_quarters_has_outlines(state):
    trim = np.zeros((3, 3), np.uint8)
    trim[1, 1] = state
    assert np.isclose(sum(map(signed_area, outlines(trim))), kept_share(trim).sum())


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_what_is_outside_is_what_scipy_leaves_empty(share):
    from scipy.ndimage import binary_fill_holes

    for seed in range(20):
        occupancy = (np.random.default_rng(seed).random((9, 14)) < share).astype(np.uint8)
        assert (outside(occupancy) == ~binary_fill_holes(occupancy > 0)).all()
