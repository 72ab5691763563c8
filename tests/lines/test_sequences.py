"""Blocks of points: access anywhere, the shape of each sequence, shifts and their statistics."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import kstest, qmc
from scipy.stats import t as student

from surfel.core.errors import InputError
from surfel.lines.engines import Niederreiter
from surfel.lines.niederreiter import niederreiter
from surfel.lines.sequences import SEQUENCES, from_shifts, shifts, unit_points


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("dimension", [1, 3, 4])
def test_blocks_fit_together(sequence, dimension):
    shift = np.linspace(0.1, 0.9, dimension)
    whole = unit_points(sequence, 0, 700, dimension, shift)
    parts = [unit_points(sequence, a, b - a, dimension, shift) for a, b in ((0, 1), (1, 300), (300, 513), (513, 700))]
    assert (whole == np.concatenate(parts)).all()
    assert whole.shape == (700, dimension) and whole.min() >= 0.0 and whole.max() < 1.0


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_points_are_even(sequence):
    points = unit_points(sequence, 0, 4096)
    limit = 0.03 if sequence == "random" else 0.004
    for coordinate in points.T:
        assert kstest(coordinate, "uniform").statistic < limit
    pairs = np.corrcoef(points.T) - np.eye(4)
    assert np.abs(pairs).max() < (0.05 if sequence == "random" else 0.03)


@pytest.mark.parametrize("sequence", ["niederreiter", "r4", "sobol", "halton"])
@pytest.mark.parametrize("number", [64, 256, 1024])
def test_discrepancy_is_below_random(sequence, number):
    shift = shifts(3, 1)[0]
    mine = qmc.discrepancy(unit_points(sequence, 0, number, shift=shift))
    random = [qmc.discrepancy(unit_points("random", 5000 * k, number)) for k in range(5)]
    assert mine < 0.5 * min(random)


def test_niederreiter_starts_where_nets_stay_nets():
    points = unit_points("niederreiter", 0, 4096, 4)
    assert (points == niederreiter(4096, 4, start=2**32)).all()
    cells = np.floor(points * 2.0 ** np.array([3, 2, 2, 2])).astype(int)
    assert (np.bincount(np.ravel_multi_index(cells.T, (8, 4, 4, 4))) == 8).all()
    assert (points.max(axis=1) > 0.0).all()  # no point at the origin


def test_r4_is_the_kronecker_sequence_of_the_generalised_golden_ratio():
    phi = max(r.real for r in np.roots([1, 0, 0, 0, -1, -1]) if abs(r.imag) < 1e-12)
    steps = phi ** -np.arange(1.0, 5.0)
    expected = (0.5 + np.arange(1, 101)[:, None] * steps) % 1.0
    assert np.abs(unit_points("r4", 0, 100) - expected).max() < 1e-13
    golden = (0.5 + np.arange(1, 101) * (np.sqrt(5.0) - 1.0) / 2.0) % 1.0
    assert np.abs(unit_points("r4", 0, 100, 1)[:, 0] - golden).max() < 1e-13


def test_r4_is_exact_far_out():
    from fractions import Fraction
    from math import isqrt

    start = 10**12
    golden = Fraction(isqrt(5 << 400) - (1 << 200), 2 << 200)
    exact = float((Fraction(1, 2) + (start + 1) * golden) % 1)
    assert abs(unit_points("r4", start, 1, 1)[0, 0] - exact) < 1e-7  # 64 bits less the 40 of the index


def test_shift_is_modulo_one():
    plain = unit_points("sobol", 0, 64)
    shift = np.array([0.0, 0.5, 1.25, -0.25])
    moved = unit_points("sobol", 0, 64, shift=shift)
    assert np.allclose(moved, (plain + shift) % 1.0, atol=1e-15)
    assert unit_points("niederreiter", 0, 256, shift=np.full(4, -1e-30)).max() < 1.0


@pytest.mark.parametrize(
    "engine",
    [
        qmc.Sobol(4, scramble=True, rng=np.random.default_rng(3)),
        qmc.Halton(4, scramble=True, rng=np.random.default_rng(3)),
        Niederreiter(4, rng=3),
    ],
)
def test_engines_of_scipy(engine):
    engine.fast_forward(5)
    whole = unit_points(engine, 0, 64)
    assert engine.num_generated == 5
    assert (unit_points(engine, 17, 40) == whole[17:57]).all()
    assert (engine.random(10) == whole[5:15]).all()
    assert unit_points(engine, 3, 0).shape == (0, 4)


def test_bad_arguments():
    for arguments in [("sobl", 0, 1), ("r4", -1, 1), ("r4", 0, -1), ("r4", 0, 1, 0), ("niederreiter", 0, 1, 21)]:
        with pytest.raises(InputError):
            unit_points(*arguments)
    with pytest.raises(InputError, match="4 numbers"):
        unit_points("r4", 0, 1, shift=[0.5])
    with pytest.raises(InputError, match="dimension 4"):
        unit_points(qmc.Halton(3), 0, 1)
    with pytest.raises(InputError, match="one of niederreiter"):
        unit_points(7, 0, 1)


def test_shifts_depend_on_the_seed_and_not_on_their_number():
    assert (shifts(7, 16)[:4] == shifts(7, 4)).all()
    assert not (shifts(7, 4) == shifts(8, 4)).any()
    assert kstest(shifts(0, 1000).ravel(), "uniform").pvalue > 1e-3
    for bad in [(-1, 2), (0, 0), (0, 2, 0), (0.5, 2)]:
        with pytest.raises(InputError):
            shifts(*bad)


def test_from_shifts_is_the_mean_and_its_error():
    values = np.random.default_rng(0).normal(size=(16, 3))
    mean, error, freedom = from_shifts(values)
    assert np.allclose(mean, values.mean(axis=0), rtol=1e-14)
    assert np.allclose(error, values.std(axis=0, ddof=1) / 4.0, rtol=1e-13)
    assert freedom == 15.0
    mean, error, freedom = from_shifts([2.5])
    assert (mean, error, freedom) == (2.5, np.inf, 0.0)
    with pytest.raises(InputError):
        from_shifts([])


def test_intervals_of_shifts_hold_what_they_promise():
    hits = 0
    for seed in range(200):
        means = [np.prod(unit_points("niederreiter", 0, 256, shift=s), axis=1).mean() for s in shifts(seed, 16)]
        mean, error, freedom = from_shifts(means)
        hits += abs(mean - 1.0 / 16.0) <= student.ppf(0.975, freedom) * error
    assert 176 <= hits <= 199  # 95 % of 200, within four standard deviations


def test_import_is_light():
    code = "import sys, surfel.lines.models as m; print(*(f'scipy.{s}' in sys.modules for s in ('stats', 'spatial')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
