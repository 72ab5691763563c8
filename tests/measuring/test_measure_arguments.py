"""Unsuited arguments: each message tells what came, what was expected, what to do."""

from __future__ import annotations

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel

CLOUD = surfel.Surfels(truth.sphere(400, 1).points)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"method": "mesh"}, "method must be one of patches, lines, qmca; got 'mesh'"),
        ({"lines": 15}, "lines must be between 16"),
        ({"lines": 1e5}, "lines must be a whole number"),
        ({"lines": "many"}, "lines must be a whole number"),
        ({"seed": -1}, "seed must be at least 0"),
        ({"seed": 0.5}, "seed"),
        ({"seed": None}, "seed"),
        ({"tolerance": 0.0}, "tolerance must be positive"),
        ({"tolerance": np.nan}, "tolerance must be finite"),
        ({"model": "secant"}, "model must be one of"),
        ({"reference": "cone"}, "reference must be one of auto, ball, box"),
        ({"sequence": "fibonacci", "method": "lines"}, "sequence"),
        ({"sequence": 7, "method": "lines"}, "sequence"),
    ],
)
def test_arguments(options, says):
    with pytest.raises(surfel.InputError, match=says):
        surfel.measure(CLOUD, **{"lines": 64, **options})


def test_a_model_that_does_not_fit_the_body_is_refused():
    with pytest.raises(surfel.InputError, match="belongs to the ball"):
        surfel.measure(CLOUD, method="lines", lines=64, model="chord", reference="box")


@pytest.mark.parametrize("shape", [None, CLOUD.points, "part.ply", 3, [CLOUD]])
def test_what_is_no_shape(shape):
    with pytest.raises(surfel.InputError, match="shape must be"):
        surfel.measure(shape)


def test_a_tolerance_out_of_reach_is_refused_in_the_end(monkeypatch):
    from surfel.measuring import by_lines

    monkeypatch.setattr(by_lines, "MOST_LINES", 4096)
    with pytest.raises(surfel.ConvergenceError, match=r"not known to 1e-09 .* ask for less"):
        surfel.measure(CLOUD, lines=1024, tolerance=1e-9)


def test_a_tolerance_out_of_reach_is_foreseen(monkeypatch):
    from surfel.measuring import by_lines

    cast, known = [], by_lines._cast
    monkeypatch.setattr(by_lines, "_cast", lambda *a: cast.append(a[4] - a[3]) or known(*a))
    with pytest.raises(surfel.ConvergenceError, match=r"not known to 1e-09 .* would be after about \de\+\d+ of them"):
        surfel.measure(CLOUD, lines=64, tolerance=1e-9)
    assert by_lines.SHIFTS * sum(cast) < 1e5


@pytest.mark.parametrize("order", [0.5, 1.0])
def test_the_lines_needed_are_foreseen_from_how_the_error_fell(order):
    from surfel.measuring.by_lines import _lines_needed

    shaky = np.exp(np.random.default_rng(0).normal(0.0, 0.05, 6))
    widths = list(shaky * 0.01 * (1000.0 * 2.0 ** np.arange(6)) ** -order)
    final = 0.01 * 1e8**-order  # reached after 1e8 lines
    assert 1e6 < _lines_needed(widths, 32_000, final) < 1e8
    assert _lines_needed(widths[:4], 8000, final) == 0.0  # too early to tell
    assert _lines_needed([0.0, *widths], 32_000, final) == 0.0
    assert _lines_needed([np.inf, *widths], 32_000, final) == 0.0


def test_a_tolerance_within_reach_is_reached():
    m = surfel.measure(CLOUD, lines=64, tolerance=2e-3)
    low, high = m.volume.interval(0.95)
    assert m.lines > 64 * 2**4 and high > low  # though more than a few doublings were needed


def test_the_number_of_lines_that_were_cast_is_told():
    for lines in (16, 17, 1000):
        m = surfel.measure(CLOUD, lines=lines)
        assert lines <= m.lines <= lines + 15
    assert surfel.measure(CLOUD, method="lines", lines=1000).lines >= 2000


def test_progress_is_told_and_may_stop_the_work():
    shares = []
    surfel.measure(CLOUD, lines=200_000, progress=lambda share, what: shares.append(share))
    assert shares == sorted(shares) and shares[-1] == 1.0

    def stop(share, what):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        surfel.measure(CLOUD, lines=64, progress=stop)
    assert surfel.measure(CLOUD, lines=64).lines == 64  # and all works as before


def test_a_scipy_engine_may_be_the_sequence():
    from scipy.stats import qmc

    m = surfel.measure(CLOUD, method="lines", lines=4096, sequence=qmc.Halton(4, scramble=False))
    assert m.area.value == pytest.approx(4 * np.pi, rel=0.05)


def test_time_is_told_without_compilation():
    m = surfel.measure(CLOUD, lines=64)
    assert m.seconds > 0.0 and m.compile_seconds >= 0.0
