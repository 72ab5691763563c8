"""Casting at the door: what is taken, and what the refusals say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surfel import InputError, SurfelError
from surfel.core import cast


def test_points_are_float64_and_contiguous_and_not_copied_without_need():
    given_points = np.zeros((4, 3))
    assert cast.as_points(given_points) is given_points
    for other in (np.zeros((4, 3), np.float32), np.zeros((3, 4)).T, [[0, 1, 2]] * 4, np.zeros((4, 3), bool)):
        points = cast.as_points(other)
        assert points.dtype == np.float64 and points.flags.c_contiguous and points.shape == (4, 3)


@pytest.mark.parametrize("empty", [[], np.empty((0, 3)), np.empty(0), ()])
def test_no_points_are_an_empty_array(empty):
    assert cast.as_points(empty).shape == (0, 3)


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros(3), np.zeros((4, 2)), np.zeros((2, 2, 3)), np.empty((0, 5)), [[0, 1, 2], [0, 1]], "abc",
        [["a", "b", "c"]], np.zeros((4, 3), complex), None, {"x": 1}, np.zeros((2, 3), "M8[s]"), [[1, 2, 10**400]],
    ],
)  # fmt: skip
def test_what_is_no_array_of_points_is_refused(bad):
    with pytest.raises(InputError, match="points"):
        cast.as_points(bad)


def test_the_refusal_of_rows_that_are_not_finite_counts_them_and_names_the_cure():
    points = np.zeros((9, 3))
    points[4, 1], points[7, 2] = np.nan, np.inf
    with pytest.raises(InputError, match=r"places has 2 rows.*row 4.*isfinite") as caught:
        cast.as_points(points, "places")
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, SurfelError)
    assert cast.as_points(points, finite=False) is points


def test_what_a_masked_array_hides_is_no_number():
    seen = np.ma.array(np.arange(12).reshape(4, 3), mask=False)
    assert cast.as_points(seen).tolist() == np.arange(12.0).reshape(4, 3).tolist()
    hidden = np.ma.masked_equal(np.arange(12).reshape(4, 3), 7)
    with pytest.raises(InputError, match=r"points has 1 rows that are not finite \(the first is row 2\)"):
        cast.as_points(hidden)
    points = cast.as_points(hidden, finite=False)
    assert type(points) is np.ndarray and np.isnan(points).sum() == 1 and np.isnan(points[2, 1])


def test_rows_and_vectors_have_the_size_asked_for():
    assert cast.as_rows([[1, 2]], "pairs", 1, 2).tolist() == [[1.0, 2.0]]
    with pytest.raises(InputError, match=r"normals must have shape \(3, 3\); got shape \(2, 3\)"):
        cast.as_rows(np.zeros((2, 3)), "normals", 3)
    for bad in ([1, 2], [1, 2, np.nan], "up", [[1, 2, 3]]):
        with pytest.raises(InputError, match="direction"):
            cast.as_vector(bad, "direction")


@given(st.lists(st.floats(-1e300, 1e300), min_size=3, max_size=3))
def test_a_direction_has_unit_length_however_long_the_vector(vector):
    if not any(vector):
        with pytest.raises(InputError, match="zero vector"):
            cast.as_direction(vector, "up")
        return
    unit = cast.as_direction(vector, "up")
    assert abs(np.linalg.norm(unit) - 1.0) < 1e-12
    assert (np.sign(unit) * np.sign(vector) >= 0).all()


def test_numbers():
    assert cast.as_positive(np.float32(2.0), "radius") == 2.0
    for bad in (0, -1, np.nan, np.inf, "x", None, 10**400):
        with pytest.raises(InputError, match="radius"):
            cast.as_positive(bad, "radius")


def test_counts():
    assert cast.as_count(np.int32(7), "n") == 7
    for bad in (0, -3, 2.0, "7", None, 11):
        with pytest.raises(InputError, match="n must be"):
            cast.as_count(bad, "n", 1, 10)
    with pytest.raises(InputError, match="at least 5"):
        cast.as_count(4, "n", 5)


def test_a_choice_names_what_there_is():
    assert cast.as_choice("ball", "body", ("ball", "box")) == "ball"
    with pytest.raises(InputError, match="body must be one of ball, box; got 'cone'"):
        cast.as_choice("cone", "body", ("ball", "box"))


def test_read_only_arrays_cannot_be_written():
    array = cast.read_only(np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1.0
