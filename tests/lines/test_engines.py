"""The engine keeps to SciPy's interface."""

import copy
import pickle

import numpy as np
import pytest
from scipy.stats import kstest, qmc

from surfel.core.errors import InputError
from surfel.lines.engines import Niederreiter
from surfel.lines.niederreiter import niederreiter


def test_unscrambled_is_the_sequence():
    assert (Niederreiter(3, scramble=False).random(100) == niederreiter(100, 3)).all()


def test_reset_and_fast_forward():
    engine = Niederreiter(4, rng=1)
    whole = engine.random(256)
    assert engine.num_generated == 256
    assert (engine.reset().random(100) == whole[:100]).all()
    assert (engine.random(28) == whole[100:128]).all()
    assert (engine.fast_forward(10).random(5) == whole[138:143]).all()
    assert isinstance(engine.reset(), Niederreiter) and engine.num_generated == 0


def test_scrambling_depends_on_the_seed_only():
    first = Niederreiter(4, rng=1).random(64)
    assert (first == Niederreiter(4, rng=1).random(64)).all()
    assert (first == Niederreiter(4, rng=np.random.default_rng(1)).random(64)).all()
    assert not (first == Niederreiter(4, rng=2).random(64)).any()


def test_scrambling_keeps_the_net_and_makes_points_uniform():
    points = Niederreiter(2, rng=5).random(256)
    cells = np.floor(points * 16).astype(int)
    assert (np.bincount(cells[:, 0] * 16 + cells[:, 1], minlength=256) == 1).all()
    first = np.array([Niederreiter(2, rng=seed).random(1)[0] for seed in range(400)])
    assert kstest(first[:, 0], "uniform").pvalue > 1e-4 and kstest(first[:, 1], "uniform").pvalue > 1e-4


@pytest.mark.parametrize("number", [64, 256, 1024])
@pytest.mark.parametrize("scramble", [False, True])
def test_discrepancy_is_below_random(number, scramble):
    mine = qmc.discrepancy(Niederreiter(4, scramble=scramble, rng=0).random(number))
    random = [qmc.discrepancy(np.random.default_rng(seed).random((number, 4))) for seed in range(5)]
    assert mine < 0.5 * min(random)


def test_scipy_takes_the_engine():
    normal = qmc.MultivariateNormalQMC(mean=[0.0, 1.0, 2.0], engine=Niederreiter(3, rng=0))
    sample = normal.random(1024)
    assert np.allclose(sample.mean(axis=0), [0.0, 1.0, 2.0], atol=0.01)
    assert np.allclose(np.cov(sample.T), np.eye(3), atol=0.03)
    whole = Niederreiter(2, rng=0).integers(0, u_bounds=8, n=64)
    assert (np.bincount(whole[:, 0], minlength=8) == 8).all()


def test_copies_go_on_alike():
    engine = Niederreiter(4, rng=1).fast_forward(7)
    twin, sent = copy.deepcopy(engine), pickle.loads(pickle.dumps(engine))
    points = engine.random(9)
    assert (points == twin.random(9)).all() and (points == sent.random(9)).all()


@pytest.mark.parametrize("dimension", [0, 21, 2.5])
def test_bad_dimension(dimension):
    with pytest.raises(InputError):
        Niederreiter(dimension)
