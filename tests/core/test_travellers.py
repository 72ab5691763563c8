"""Lines, crossings, errors and blocks: what travels between the rooms."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from surfel import Crossings, FileFormatError, InputError, Lines, MissingExtraError, SurfelError
from surfel.core.execute import blocks, run_blocks


def test_lines_are_scaled_to_unit_directions_and_one_weight_serves_all():
    lines = Lines.of([[0, 0, 0], [1, 0, 0]], [[0, 0, 5], [3, 4, 0]], 0.5)
    assert len(lines) == 2
    np.testing.assert_allclose(lines.directions, [[0, 0, 1], [0.6, 0.8, 0]])
    assert lines.weights.tolist() == [0.5, 0.5]


@pytest.mark.parametrize(
    ("origins", "directions", "what"),
    [
        ([[0, 0, 0]], [[0, 0, 0]], "zero"),
        ([[0, 0, 0]], [[0, np.nan, 0]], "finite"),
        ([[0, 0, np.inf]], [[0, 0, 1]], "origins"),
        ([[0, 0, 0]], [[0, 0, 1], [0, 1, 0]], "directions"),
        ([[0, 0]], [[0, 0, 1]], "origins"),
    ],
)
def test_bad_lines_are_refused(origins, directions, what):
    with pytest.raises(InputError, match=what):
        Lines.of(origins, directions, 1.0)


def test_crossings_are_compressed_rows():
    crossings = Crossings(
        np.array([0, 2, 2, 5]), np.arange(5.0), np.ones(5), np.array([0.5, 0.25, 1.0, 1.0, 2.0]), np.zeros(5, np.int32)
    )
    assert len(crossings) == 3
    assert crossings.counts.tolist() == [2, 0, 3]
    assert crossings.lines.tolist() == [0, 0, 2, 2, 2]
    assert crossings.weight_per_line().tolist() == [0.75, 0.0, 4.0]


@pytest.mark.parametrize(
    "error",
    [
        InputError("radius must be positive"),
        FileFormatError("a.ply", "the header ends early", "line 7", "save it again"),
        MissingExtraError("pye57", "e57"),
    ],
)
def test_errors_are_of_the_house_and_travel_between_processes(error):
    assert isinstance(error, SurfelError)
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error) and str(back) == str(error) and back.__dict__ == error.__dict__


def test_errors_say_where_and_what_to_do():
    assert str(FileFormatError("a.ply", "cut", "byte 9", "save it again")) == "a.ply: cut (byte 9); save it again"
    assert "pip install 'surfel[e57]'" in str(MissingExtraError("pye57", "e57"))
    assert isinstance(MissingExtraError("pye57", "e57"), ImportError)


@pytest.mark.parametrize(("items", "size"), [(0, 4), (1, 4), (8, 4), (9, 4)])
def test_blocks_cover_everything_once(items, size):
    spans = blocks(items, size)
    assert [i for first, last in spans for i in range(first, last)] == list(range(items))
    assert all(0 < last - first <= size for first, last in spans)


def test_results_come_in_order_and_progress_is_told():
    told = []
    results = run_blocks(lambda x: x * x, [3, 1, 2], progress=lambda share, what: told.append((share, what)), label="w")
    assert results == [9, 1, 4]
    assert told == [(1 / 3, "w"), (2 / 3, "w"), (1.0, "w")]


def test_a_policy_that_loses_results_is_found_out():
    class Lossy:
        def map(self, function, tasks):
            return [function(task) for task in list(tasks)[:-1]]

    with pytest.raises(SurfelError, match="2 results for 3"):
        run_blocks(lambda x: x, [1, 2, 3], Lossy())
