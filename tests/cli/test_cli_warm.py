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
    monkeypatch.setattr(warm, "start", lambda: calls.append("start"))
    with output.Output(False, False, measures=measures):
        _notice.compilation_starts()
        _notice.compilation_starts()
    assert len(calls) == started
    assert capsys.readouterr().err.count("compiling kernels") == 1
