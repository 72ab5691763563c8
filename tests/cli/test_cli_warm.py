"""The helper process of the first run: it compiles what measuring needs, and is never in the way."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from surfel import _notice
from surfel.cli import output, warm

MEASURE = """
import importlib, json
import numpy as np
import surfel

points = np.random.default_rng(0).standard_normal((3000, 3))
points /= np.linalg.norm(points, axis=1, keepdims=True)
surfel.measure(surfel.Surfels(points, points.copy()))
hits, misses = [], []
for name in ("index.bvh_build", "index.bvh_trace", "index.morton", "surface.border", "surface.fans", "surface.noise",
             "shapes.sheets", "measuring.line_sums"):
    for kernel, function in vars(importlib.import_module("surfel." + name)).items():
        dispatcher = getattr(function, "dispatcher", function)
        if getattr(function, "__module__", "") == "surfel." + name and hasattr(dispatcher, "stats"):
            hits += [kernel] * bool(dispatcher.stats.cache_hits)
            misses += [kernel] * bool(dispatcher.stats.cache_misses)
print(json.dumps([hits, misses]))
"""
REPORT = """
import json, surfel
from surfel._numba import compile_seconds
from surfel.cli.part import BoredBlock

surfel.write("{folder}/part.ply", surfel.Surfels(*BoredBlock().sample(40_000)))
scan = surfel.read("{folder}/part.ply")
surfel.measure(scan)
told = [compile_seconds()]
surfel.bound(scan, direction=(0, 0, 1), shape=(12, 12), mode="tight").verify(scan)
told.append(compile_seconds())
surfel.measure(scan - surfel.Sphere(1).translated((2, -1.5, 1)))
told.append(compile_seconds())
print(json.dumps([told[1] - told[0], told[2] - told[1]]))
"""
BY_THE_COMMAND = {"_nearby", "_holds_origin"}  # behind the cells, which the command compiles itself


@pytest.mark.slow
def test_a_measurement_finds_in_the_cache_what_the_helper_compiled(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def run(*arguments):
        command = [sys.executable, *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=True).stdout

    run("-m", "surfel.cli.warm")
    hits, misses = json.loads(run("-c", MEASURE))
    assert set(misses) <= BY_THE_COMMAND
    last = {
        "_survey",
        "_collect",
        "_centers",
        "_fill_leaves",
        "trace",
        "place_hits",
        "_bend",
        "_merge_all",
        "_integrate",
    }
    assert last | {"_quadric_residuals", "is_covered", "_key_lines"} <= set(hits)


@pytest.mark.slow
def test_the_report_finds_in_the_cache_what_its_helper_compiled(tmp_path):
    """All but what the first pictures need: the command compiles that meanwhile."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    program = REPORT.format(folder=str(tmp_path))
    warmed = [sys.executable, "-m", "surfel.cli.warm", "report"]
    subprocess.run(warmed, env=environment, timeout=900, check=True)
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900, check=True)
    assert json.loads(run.stdout) == [0.0, 0.0]  # nothing was compiled


def test_a_helper_ends_when_it_is_told_to():
    helper = warm.start()
    if helper is None:
        pytest.skip("one core")
    assert helper.poll() is None
    warm.stop(helper)
    assert helper.poll() is not None
    warm.stop(helper)


def test_no_helper_where_none_can_be_had(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(warm, "_cores", lambda: 1)
        assert warm.start() is None
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", "")
        assert warm.start() is None
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", "/no/such/python")
        assert warm.start() is None
    warm.stop(None)


@pytest.mark.parametrize(("own", "measures", "started"), [(True, True, 1), (True, False, 0), (False, True, 0)])
def test_only_a_measuring_process_of_our_own_has_a_helper(monkeypatch, capsys, own, measures, started):
    calls = []
    monkeypatch.setattr(_notice, "own_process", own)
    monkeypatch.setattr(warm, "start", calls.append)
    with output.Output(False, False, measures=measures):
        _notice.compilation_starts()
        _notice.compilation_starts()
    assert len(calls) == started
    assert capsys.readouterr().err.count("compiling kernels") == 1
