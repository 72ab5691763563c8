"""Niederreiter's sequence against a slow construction from its definition, and as a net."""

from itertools import product

import numpy as np
import pytest

from surfel.core.errors import InputError
from surfel.lines.niederreiter import direction_numbers, niederreiter

# The irreducible polynomials over GF(2), as every table of them has them: coefficients of x^0, x^1, ...
POLYNOMIALS = ["01", "11", "111", "1101", "1011", "11001", "10011", "11111", "101001", "100101", "111101", "111011"]
# Index t of the nets of Niederreiter's sequence: the sum of (degree - 1).
T_VALUES = [0, 0, 1, 3, 5, 8, 11, 14]


def naive_matrix(polynomial, bits):
    """Rows of a generator matrix by Algorithm 738's linear recurrence, on lists of coefficients."""
    p = [int(c) for c in polynomial]
    degree = len(p) - 1
    power, rows = [1], []
    while len(rows) < bits:
        before = len(power) - 1
        product_ = [0] * (len(power) + degree)
        for i, a in enumerate(power):
            for j, b in enumerate(p):
                product_[i + j] ^= a & b
        power = product_
        order = len(power) - 1
        series = [0] * before + [1] * (order - before)
        while len(series) < bits + degree:
            series.append(sum(power[k] & series[len(series) - order + k] for k in range(order)) % 2)
        rows += [series[u : u + bits] for u in range(degree)]
    return np.array(rows[:bits])


def naive_point(index, dimension, bits=53):
    gray = index ^ (index >> 1)
    digits = np.array([(gray >> r) & 1 for r in range(bits)])
    point = []
    for polynomial in POLYNOMIALS[:dimension]:
        y = naive_matrix(polynomial, bits) @ digits % 2
        point.append(sum(int(d) << (bits - 1 - j) for j, d in enumerate(y)) / 2**bits)
    return point


def test_points_equal_the_slow_construction_bit_by_bit():
    points = niederreiter(600, 12)
    for index in (0, 1, 2, 3, 5, 64, 255, 256, 257, 599):
        assert points[index].tolist() == naive_point(index, 12)


@pytest.mark.parametrize("index", [2**20 + 77, 2**32, 2**40 - 1, 2**53 - 1])
def test_late_points_equal_the_slow_construction(index):
    assert niederreiter(1, 6, start=index)[0].tolist() == naive_point(index, 6)


def test_rows_are_the_laurent_series_of_the_definition():
    bits = 53
    columns = direction_numbers(8)
    for i, polynomial in enumerate(POLYNOMIALS[:8]):
        p = int(polynomial[::-1], 2)
        degree = p.bit_length() - 1
        power = 1
        for j in range(bits - bits % degree):
            u = j % degree
            if u == 0:
                power = multiply(power, p)
            row = sum(((int(columns[r, i]) >> (bits - 1 - j)) & 1) << (bits - 1 - r) for r in range(bits))
            product_ = multiply(row, power)  # of the series cut off after x^-53, times x^53
            if u == 0:
                g = product_ >> bits
                assert g != 0 and g.bit_length() <= degree  # so p does not divide g
            rest = divide(g << u, power) << bits
            assert (product_ ^ rest).bit_length() <= power.bit_length() - 1  # equal but for what was cut off


def multiply(a, b):
    result = 0
    for k in range(b.bit_length()):
        if (b >> k) & 1:
            result ^= a << k
    return result


def divide(a, b):
    while a.bit_length() >= b.bit_length():
        a ^= b << (a.bit_length() - b.bit_length())
    return a


def test_first_coordinate_is_van_der_corput_in_gray_order():
    assert niederreiter(8, 1)[:, 0].tolist() == [0.0, 0.5, 0.75, 0.25, 0.375, 0.875, 0.625, 0.125]


@pytest.mark.parametrize("dimension", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("start", [0, 3 * 2**10, 2**32 + 2**10])
def test_aligned_runs_are_nets(dimension, start):
    m, t = 10, T_VALUES[dimension - 1]
    points = niederreiter(2**m, dimension, start)
    for split in product(range(m - t + 1), repeat=dimension):
        if sum(split) != m - t:
            continue
        cells = np.floor(points * 2.0 ** np.array(split)).astype(int)
        label = np.ravel_multi_index(cells.T, tuple(2**k for k in split))
        assert (np.bincount(label, minlength=2 ** (m - t)) == 2**t).all()


def test_every_coordinate_of_all_dimensions_is_stratified():
    degrees = [1] * 2 + [2] + [3] * 2 + [4] * 3 + [5] * 6 + [6] * 6
    for coordinate, degree in zip(niederreiter(4096, 20, start=4096).T, degrees, strict=True):
        cells = 2 ** (12 // degree * degree)  # a coordinate of degree e is a net after each e digits
        assert (np.bincount(np.floor(coordinate * cells).astype(int), minlength=cells) == 4096 // cells).all()


def test_blocks_fit_together():
    whole = niederreiter(3000, 7, start=100)
    parts = [niederreiter(n, 7, start) for start, n in ((100, 1), (101, 155), (256, 256), (512, 2588))]
    assert (whole == np.concatenate(parts)).all()


def test_no_points():
    assert niederreiter(0, 4).shape == (0, 4)
    assert niederreiter(0, 4, start=2**53).shape == (0, 4)


@pytest.mark.parametrize(
    "arguments", [(1, 0), (1, 21), (-1, 2), (1.5, 2), (1, 2, -1), (1, 2, 2**53), (2, 2, 2**53 - 1)]
)
def test_bad_arguments(arguments):
    with pytest.raises(InputError):
        niederreiter(*arguments)
