"""What Polynomial takes, what it refuses, and what it says then."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from surfel import Box, HalfSpace, InputError, Polynomial

BALL = {(2, 0, 0): 1.0, (0, 2, 0): 1.0, (0, 0, 2): 1.0, (0, 0, 0): -1.0}


@pytest.mark.parametrize(
    ("terms", "says"),
    [
        ({}, "empty"),
        ({(1, 0, 0): 0.0}, "empty or all zero"),
        ({(0, 0, 0): -1.0}, "constant"),
        ({(0, 0, 0): -1.0, (2, 0, 0): 0.0}, "constant"),
        ({(0.5, 0, 0): 1.0}, "whole numbers"),
        ({(2.0, 0, 0): 1.0}, "whole numbers"),
        ({(-1, 0, 0): 1.0}, "negative"),
        ({(1, 0): 1.0}, "three exponents"),
        ({(1, 0, 0, 0): 1.0}, "three exponents"),
        ({(1, 0, 0): math.nan}, "finite"),
        ({(1, 0, 0): math.inf}, "finite"),
        ({(1, 0, 0): "one"}, "number"),
        ({(1, 0, 0): 1j}, "number"),
        ({1: 1.0}, "mapping"),
        (None, "mapping"),
        (3.0, "mapping"),
        ([((1, 0, 0), 1.0), ((1, 0, 0), 2.0)], "twice"),
    ],
)
def test_terms_that_are_refused(terms, says):
    with pytest.raises(InputError, match=says):
        Polynomial(terms, Box(2.0))


def test_regions_that_are_refused():
    with pytest.raises(InputError, match="intersect it with a box"):
        Polynomial(BALL, HalfSpace((0.0, 0.0, 1.0), 0.0))
    with pytest.raises(InputError, match="must be a shape"):
        Polynomial(BALL, 2.0)
    with pytest.raises(InputError, match="sheet"):
        Polynomial(BALL, Polynomial(BALL, Box(2.0), capped=False))
    open_mesh = surfel.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]])
    with pytest.raises(InputError, match="open mesh"):
        Polynomial(BALL, open_mesh)
    with pytest.raises(InputError, match="capped"):
        Polynomial(BALL, Box(2.0), capped="yes")


def test_what_it_says_of_itself():
    solid = Polynomial(BALL, Box((2.0, 4.0, 6.0)))
    sheet = Polynomial(BALL, Box(2.0), capped=False)
    assert solid.degree == 2
    assert (solid.solid, sheet.solid) == (True, False)
    assert (solid.area, solid.volume, solid.sampled) == (None, None, False)
    assert np.array_equal(solid.bounds, [[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]])
    assert Polynomial(tuple(BALL.items()), Box(2.0)).terms == sheet.terms
    assert Polynomial({(np.int64(1), 0, 0): np.float32(2.0)}, Box(1.0)).terms == (((1, 0, 0), 2.0),)
    assert len({solid, sheet}) == 2
    with pytest.raises(AttributeError):
        solid.capped = False


def test_inside_is_where_it_is_negative_and_within():
    ball = Polynomial(BALL, Box((4.0, 4.0, 1.0)))
    points = [[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [1.1, 0.0, 0.0], [0.0, 0.0, 0.6], [9.0, 9.0, 9.0]]
    assert ball.contains(points).tolist() == [True, True, False, False, False]
    with pytest.raises(InputError, match="sheet"):
        Polynomial(BALL, Box(3.0), capped=False).contains(points)


def test_a_polynomial_within_a_polynomial():
    inner = Polynomial({(1, 0, 0): 1.0}, Polynomial(BALL, Box(3.0)))  # half a ball
    hits = inner.cross(surfel.Lines.of([[0.0, 0.1, 0.0]], [[1.0, 0.0, 0.0]], 1.0))
    assert np.allclose(hits.t, [-math.sqrt(0.99), 0.0], atol=1e-15)
