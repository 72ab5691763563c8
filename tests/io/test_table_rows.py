"""Long text in windows and parts: the same numbers as numpy reads, and errors at the right line."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfel.core.errors import FileFormatError
from surfel.io import table_rows
from surfel.io.source import Source
from surfel.io.table_rows import TableRows, Text


@pytest.fixture(autouse=True)
def small_windows(monkeypatch):
    monkeypatch.setattr(table_rows, "_WINDOW", 200)
    monkeypatch.setattr(table_rows, "_PART", 60)


def rows_of(text: str, columns: int = 3, how: Text | None = None) -> TableRows:
    data = text.encode()
    return TableRows(Source("a.xyz", io.BytesIO(data), len(data)), columns, how or Text(comments=True))


@given(
    st.lists(st.tuples(*[st.floats(width=64, allow_nan=False)] * 3), min_size=1, max_size=80),
    st.lists(st.sampled_from(["", "  ", "# a comment", "// and another"]), max_size=20),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.booleans(),
)
@settings(max_examples=60)
def test_any_rows(values, between, newline, ended):
    lines = [" ".join(map(repr, row)) for row in values]
    for i, other in enumerate(between):
        lines.insert((i * 7) % (len(lines) + 1), other)
    text = newline.join(lines) + (newline if ended else "")
    how = Text(newline=ord(newline[-1]), comments=True)
    np.testing.assert_array_equal(rows_of(text, how=how).read(1 << 60), np.array(values))
    for size in (1, 5, 1000):
        runs = list(rows_of(text, how=how).runs(size))
        np.testing.assert_array_equal(np.concatenate(runs), np.array(values))
        assert all(len(run) == size for run in runs[:-1])
    points, last = rows_of(text, how=how).read_groups(1 << 60, [[2, 0], [1]])
    np.testing.assert_array_equal(points, np.array(values)[:, [2, 0]])
    np.testing.assert_array_equal(last[:, 0], np.array(values)[:, 1])


def test_not_a_number_and_numbers_for_python():
    words = ["nan", "NaN", "-nan", "inf", "-inf", "INF", "infinity", "1e400", "4.9e-324", "-0.0", "1.#QNAN", "+1"]
    found = rows_of("".join(f"{word} 0 1\n" for word in words)).read(100)[:, 0]
    expected = [np.nan, np.nan, np.nan, np.inf, -np.inf, np.inf, np.inf, np.inf, 5e-324, -0.0, np.nan, 1.0]
    np.testing.assert_array_equal(found, expected)
    many = rows_of("1e400 1 2\n" * 5000)  # more than a part keeps for Python
    assert np.isinf(many.read(1 << 60)[:, 0]).sum() == 5000


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [("1 2", "after 2 values"), ("1 2 3 4", "more values"), ("1 two 3", "'two' is not"), ("1 2 3x", "'3x' is not"),
     ("1 1-2 3", "'1-2' is not"), ("1 2 --3", "'--3' is not"), ("1 2 .", "'.' is not"), ("1 2 1e", "'1e' is not")],
)  # fmt: skip
@pytest.mark.parametrize("at", [0, 1, 33, 99])
def test_the_line_of_an_error(wrong, problem, at):
    lines = ["0.5 1.5 2.5"] * 100
    lines[at] = wrong
    lines.insert(at // 2, "# a comment")
    with pytest.raises(FileFormatError, match=problem) as caught:
        rows_of("\n".join(lines)).read(1 << 60)
    assert caught.value.place == f"line {at + 2}, row {at}"


def test_an_empty_value_between_commas():
    with pytest.raises(FileFormatError, match="value 2 of the line is empty"):
        rows_of("1,,3\n", how=Text(delimiter=ord(","))).read(5)


def test_fewer_rows_than_are_wanted():
    with pytest.raises(FileFormatError, match="after 3 of 7 records"):
        rows_of("1 2 3\n" * 3).read(7, all_of_them=True)
    rows = rows_of("1 2 3\n" * 5)
    assert len(rows.read(2)) == 2 and rows.finish() == 12 and len(rows.read(9)) == 3 and len(rows.read(9)) == 0


def test_a_line_longer_than_the_window():
    text = "1 2 3\n" + " " * 5000 + "4 5 6\n7" + " " * 900 + "8 9\n"
    assert rows_of(text).read(9).tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]


def test_threads_give_the_same(monkeypatch):
    monkeypatch.setattr(table_rows, "_WINDOW", 1 << 22)
    monkeypatch.setattr(table_rows, "_PART", 1 << 16)
    values = np.random.default_rng(0).normal(size=(60_000, 3))
    text = "\n".join(" ".join(map(repr, row)) for row in values.tolist())
    np.testing.assert_array_equal(rows_of(text).read(1 << 60), values)
