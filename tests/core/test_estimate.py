"""Estimate: intervals, printing, and the honest absence of a number."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.stats import norm, t

from surfel import Estimate, InputError
from surfel.core.estimate import combine_errors


@pytest.mark.parametrize("level", [0.5, 0.9, 0.95, 0.999])
def test_the_interval_is_normal_or_students(level):
    low, high = Estimate(3.0, 0.5).interval(level)
    assert (low, high) == pytest.approx(norm.interval(level, 3.0, 0.5), rel=1e-12)
    low, high = Estimate(3.0, 0.5, freedom=15.0).interval(level)
    assert (low, high) == pytest.approx(t.interval(level, 15, 3.0, 0.5), rel=1e-9)
    assert isinstance(low, float)


def test_vectors_have_intervals_by_component():
    value, error = np.arange(9.0).reshape(3, 3), np.full((3, 3), 0.1)
    low, high = Estimate(value, error).interval()
    assert low.shape == (3, 3)
    np.testing.assert_allclose(high - low, 2 * 1.959964 * 0.1, rtol=1e-6)


@pytest.mark.parametrize("level", [0.0, 1.0, -1, 95, math.nan, "most", None])
def test_a_confidence_is_a_share(level):
    with pytest.raises(InputError, match="confidence"):
        Estimate(1.0, 0.1).interval(level)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0571287, 0.00004, "0.05713 +- 0.00004"),
        (12.566370, 0.0123, "12.566 +- 0.012"),
        (12.566370, 0.0096, "12.566 +- 0.010"),
        (123456.0, 2300.0, "123000 +- 2000"),
        (1.0, 0.0, "1 +- 0"),
        (math.nan, math.inf, "nan +- inf"),
        (-0.5, 0.25, "-0.5 +- 0.2"),
        (3e-20, 1e-22, "3e-20 +- 1e-22"),
        (1.5e15, 3e12, "1.5e+15 +- 3e+12"),
    ],
)
def test_printing_rounds_to_what_is_known(value, error, text):
    assert str(Estimate(value, error)) == text


def test_printing_vectors():
    assert str(Estimate(np.array([1.0, 2.0]), np.array([0.1, 0.02]))) == "[1.00 +- 0.10, 2.00 +- 0.02]"


def test_where_no_number_exists_it_says_why():
    none = Estimate.unknown("the surface is open", np.full(3, np.nan))
    assert not none.reliable and none.reason == "the surface is open"
    assert np.isinf(none.standard_error).all() and none.standard_error.shape == (3,)
    told = none.to_dict()
    assert told["value"] == [None] * 3 and told["interval"] == [[None] * 3] * 2
    json.dumps(told, allow_nan=False)
    assert Estimate.unknown("why").to_dict()["standard_error"] is None


def test_a_dictionary_holds_plain_numbers():
    told = Estimate(np.float64(2.0), np.float32(0.5), freedom=7.0).to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert set(told) == {"value", "standard_error", "interval", "reliable", "reason"}
    assert told["interval"][0] < told["value"] < told["interval"][1]


def test_scaling_keeps_the_error_positive_and_the_rest():
    scaled = Estimate(2.0, 0.5, False, "why", 3.0).scaled(-2.0)
    assert (scaled.value, scaled.standard_error, scaled.reliable, scaled.reason, scaled.freedom) == (
        -4.0, 1.0, False, "why", 3.0,
    )  # fmt: skip
    assert float(scaled) == -4.0


def test_errors_join_as_the_root_of_the_sum_of_squares_at_any_scale():
    assert combine_errors(3.0, 4.0) == 5.0
    np.testing.assert_array_equal(combine_errors(np.array([3.0, 6.0]), np.array([4.0, 8.0]), 0.0), [5.0, 10.0])
    assert combine_errors(3e200, 4e200) == pytest.approx(5e200)
    assert combine_errors(3e-200, 4e-200) == pytest.approx(5e-200)
