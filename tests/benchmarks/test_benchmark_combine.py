"""The benchmarks of Booleans: orders of growth, pairs that cross, and what the report says."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.gaal2005 import PAPER
from benchmarks.gaal2005_structures import _cell
from benchmarks.judge_cases import known_solid

from benchmarks import peers_combine


def test_orders_of_growth():
    assert _cell([1.0, 4.0, 16.0], (10, 40, 160)) == "1, 4, 16 (1.00)"
    assert _cell([2.0, 4.0], (10, 40)) == "2, 4 (0.50)"
    assert _cell([2.0, None], (10, 40)) == "-"


def test_the_gain_as_the_paper_counts_it():
    assert [round(100.0 * (level / flood - 1.0)) for level, flood in PAPER.values()] == [14, 16, 20]


def test_a_small_pair_through_every_method():
    pytest.importorskip("manifold3d")
    one, two = known_solid("box"), peers_combine.moved(known_solid("box"))
    assert two.mesh.area == pytest.approx(one.mesh.area) and two.mesh.contains(np.zeros((1, 3)))[0]
    rows = peers_combine.booleans(("box", "box"), one, two, 4000, 1)
    assert {row.operation for row in rows} == set(peers_combine.OPERATIONS)
    ours = [row for row in rows if row.method.startswith("surfel")]
    assert len(ours) == 3 and all(row.area < 0.02 and row.volume < 0.03 for row in ours)
    text = peers_combine.report(rows, [peers_combine.Inside("box", "surfel.Classifier", 0.005, 0.01, 0.02)], ["said"])
    assert "box and box" in text and "0.005" in text and "- said" in text
