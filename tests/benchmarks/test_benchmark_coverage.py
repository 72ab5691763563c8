"""The coverage of trees' intervals is counted, not assumed."""

from __future__ import annotations

from benchmarks.coverage_trees import Case, cases, report


def test_a_few_trees_run():
    found = list(cases(trees=2, seeds=1, truth=1 << 16))
    assert {case.kind for case in found} >= {"area by lines", "volume"}
    assert len({case.tree for case in found}) == 2


def test_the_table_counts_what_held():
    found = [Case("volume", k, k % 20 > 0, 5.0 if k % 20 == 0 else 0.5) for k in range(100)]
    line = next(row for row in report(found, 100, 1).splitlines() if row.startswith("| volume"))
    assert [cell.strip() for cell in line.split("|")[1:-1]] == ["volume", "100", "95.0", "yes", "0.50", "5.0"]
    shaky = report([Case("volume", k, k % 5 > 0, 1.0) for k in range(100)], 100, 1)
    assert "80.0 |       no" in shaky
