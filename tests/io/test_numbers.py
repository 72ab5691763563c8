"""Numbers in text come out as Python's float reads them, to the last bit."""

from __future__ import annotations

import struct
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surfel.io.rows import RowError, parse_rows


def parsed(*tokens: str) -> np.ndarray:
    data = np.frombuffer("\n".join(tokens).encode(), np.uint8)
    return parse_rows(data, 0, (0,)).values[:, 0]


def same_bits(tokens: list[str]) -> None:
    expected = np.array([float(t) for t in tokens])
    found = parsed(*tokens)
    wrong = np.flatnonzero(found.view(np.uint64) != expected.view(np.uint64))
    assert not len(wrong), [(tokens[i], found[i], expected[i]) for i in wrong[:5]]


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=50))
def test_shortest_digits_of_any_double(values):
    same_bits([repr(v) for v in values])


@given(
    st.lists(
        st.from_regex(r"\A[+-]?([0-9]{1,30}(\.[0-9]{0,30})?|\.[0-9]{1,30})([eE][+-]?[0-9]{1,3})?\Z"),
        min_size=1,
        max_size=30,
    )
)
def test_any_spelling(tokens):
    same_bits(tokens)


@given(st.lists(st.integers(0, 2**64 - 1), min_size=1, max_size=50))
def test_ties_between_neighbouring_doubles(bits):
    tokens = []
    for b in bits:
        x = struct.unpack("d", struct.pack("Q", b))[0]
        if np.isfinite(x) and abs(x) < 1e300 and abs(x) > 1e-250:
            half = (Fraction(x) + Fraction(float(np.nextafter(x, np.inf)))) / 2
            exact = half.numerator * 10**1200 // half.denominator  # every such tie has fewer than 1,200 decimals
            digits = f"{abs(exact):01201d}"
            tokens.append(("-" if exact < 0 else "") + digits[:-1200] + "." + digits[-1200:].rstrip("0"))
    if tokens:
        same_bits(tokens)


@pytest.mark.parametrize(
    "token",
    ["0", "-0", "1e400", "-1e400", "1e-400", "5e-324", "2.2250738585072014e-308", "1.7976931348623157e308",
     "9007199254740993", "9007199254740992.5", "340282346999999984391321947108527833088.0000000000000000000",
     "0e999999999999", "inf", "-Infinity", "1.", ".5", "+7", "00001.5", "123456789012345678901234567890"],
)  # fmt: skip
def test_edges(token):
    same_bits([token])


def test_not_a_number_in_all_its_spellings():
    assert np.isnan(parsed("nan", "NaN", "-nan", "nan(ind)", "-nan(snan)", "-1.#IND00", "1.#QNAN0")).all()


@pytest.mark.parametrize(
    "token", ["1_000", "0x10", "1.2.3", "--1", "1e", "e5", ".", "+", "1,5", "abc", "1f", "\x00", "\u0661"]
)
def test_garbage_is_refused_where_it_stands(token):
    with pytest.raises(RowError) as caught:
        parsed("1", token, "2")
    assert caught.value.row == 1


@settings(max_examples=30)
@given(st.integers(0, 600), st.integers(1, 3))
def test_many_numbers_that_the_kernel_leaves_to_python(hard, columns):
    rows = [["nan"] * columns if i % 2 else ["1"] * columns for i in range(hard)]
    text = "\n".join(" ".join(r) for r in rows)
    found = parse_rows(np.frombuffer(text.encode() + b"\n", np.uint8), 0, (0,) * columns).values
    assert found.shape == (hard, columns)
    assert np.isnan(found[1::2]).all() and (found[::2] == 1).all()
