"""The tables of the benchmarks: filters, counts, and a quick run of each."""

from __future__ import annotations

import math

import pytest
from benchmarks.__main__ import main
from benchmarks.clouds import random_cloud
from benchmarks.estimates import Outcome, judge
from benchmarks.rows import ROWS, Case, cases
from benchmarks.shapes import JUDGING, TUNING
from benchmarks.tables import percent, seconds, table

from benchmarks import accuracy, peers, speed


def outcome(error, half_width, row="random 20k", **more):
    return Outcome(row, "spot", "given", 20_000, error, half_width, 0.0, 0.1, **more)


def test_filters_choose_rows_shapes_and_normals():
    assert {case.row for case in cases("random 20k")} == {"random 20k"}
    assert {case.row for case in cases("noise")} == {row.name for row in ROWS if "noise" in row.name}
    assert {case.row for case in cases("noise 0.1 h")} == {"noise 0.1 h"}
    assert [case.shape for case in cases("random 20k", normals="none")] == list(JUDGING)
    assert [case.shape for case in cases("random 20k", normals="none", which="tuning")] == list(TUNING)
    assert {case.shape for case in cases("clean sets", "cube")} == {"cube"}
    assert [case.seed for case in cases("random 5k", "spot", "given", seeds=3)] == [0, 1, 2]
    assert len(list(cases("clean sets", "sphere", "given", seeds=3))) == 1, "the same cloud is not measured twice"
    assert {case.normals for case in cases("noise")} >= {"none"}
    assert not {case.normals for case in cases("noise 1 %")} & {"given"}


def test_a_summary_counts_medians_worst_cases_and_coverage():
    text = accuracy.summary([outcome(0.0005, 0.001), outcome(-0.02, 0.001), outcome(0.0007, 0.001)])
    cells = [cell.strip() for cell in text.splitlines()[2].strip("|").split("|")]
    assert cells == ["random 20k", "given", "3", "0.1 (0.9)", "0.070", "-0.627", "2.00", "2/3", "0.100", "no"]
    text = accuracy.summary([outcome(0.0005, 0.001), outcome(-0.002, 0.001), outcome(0.0007, 0.001)])
    assert text.splitlines()[2].endswith("yes |")


def test_a_volume_that_is_not_given_is_a_miss():
    known = {"row": "solids: random 100k", "volume": 1e-4, "volume_half_width": 1e-3, "centroid": 1e-5, "leak": 0.0}
    assert accuracy.summary([outcome(0.0, 0.1, **known)]).splitlines()[2].endswith("yes |")
    known |= {"volume": math.nan, "volume_half_width": math.nan, "centroid": math.nan}
    assert accuracy.summary([outcome(0.0, 0.1, **known)]).splitlines()[2].endswith("no |")


def test_numbers_are_told_shortly():
    assert [percent(x) for x in (0.00012, 0.0123, 0.123, math.nan)] == ["0.012", "1.23", "12.3", "-"]
    assert percent(0.01, signed=True) == "+1.00"
    assert [seconds(x) for x in (2.5, 0.0123, 4.5e-7)] == ["2.5 s", "12.3 ms", "0.45 us"]
    assert table(["a", "b"], [["x", 1]]) == "| a   |   b |\n| --- | --: |\n| x   |   1 |\n"


@pytest.mark.parametrize("normals", ["given", "none"])
def test_a_case_is_measured(normals, capsys):
    [found] = accuracy.run([Case("random 5k", "sphere", normals, 0)])
    assert abs(found.error) < 0.02 and found.half_width > 0.0 and found.points == 5_000
    assert "random 5k" in capsys.readouterr().out
    assert "| random 5k" in accuracy.report([found])


def test_the_whole_measure_gives_volume_and_centroid():
    found = judge("solids: random 100k", random_cloud("sphere", 4_000), mode="measure", lines=4_096)
    assert abs(found.volume) < 0.02 and found.volume_half_width > 0.0
    assert 0.0 < found.centroid < 0.02 and found.leak < 0.02
    assert "| volume" in accuracy.line_of(found)


def test_a_failure_is_told_and_does_not_stop_the_others(monkeypatch, capsys):
    def fail(*_, **__):
        raise ValueError("no area today")

    monkeypatch.setattr(accuracy, "judge", fail)
    assert accuracy.run([Case("random 5k", "sphere", "given", 0)]) == []
    assert "FAILED: ValueError: no area today" in capsys.readouterr().out


def test_the_accuracy_command_writes_markdown(tmp_path, capsys):
    out, lines = tmp_path / "new" / "a.md", tmp_path / "a.jsonl"
    wanted = ["accuracy", "--only", "random 5k", "--set", "tuning", "--shape", "square", "--normals", "none"]
    assert main([*wanted, "--out", str(out), "--json", str(lines)]) == 0
    text = out.read_text()
    assert "Shapes used for tuning" in text and "| random 5k |" in text and str(tmp_path) not in text
    assert len(lines.read_text().splitlines()) == 1
    assert main(["accuracy", "--only", "no such row"]) == 2
    capsys.readouterr()


def test_peers_are_asked_about_the_same_clouds():
    pytest.importorskip("open3d", exc_type=ImportError)
    methods, _ = peers.installed()
    chosen = {name: methods[name] for name in ("surfel", "Open3D ball pivoting", "Open3D Poisson, density cut")}
    two = iter([("square", lambda: random_cloud("square", 1_000)), ("sphere", lambda: random_cloud("sphere", 1_000))])
    readings = peers.run(two, chosen, warm=False)
    assert len(readings) == 6 and not any(math.isnan(r.error) for r in readings)
    errors = {(r.case, r.method): abs(r.error) for r in readings}
    assert errors["square", "surfel"] < errors["square", "Open3D Poisson, density cut"]
    text = peers.report(readings, ["CGAL is not installed: its methods are left out."])
    assert "| sphere (1,000)" in text and "CGAL is not installed" in text


def test_a_peer_that_fails_is_a_result():
    def broken(_):
        raise RuntimeError("no surface\nlong story")

    [reading] = peers.run(iter([("square", lambda: random_cloud("square", 100))]), {"broken": broken}, warm=False)
    assert math.isnan(reading.error) and reading.note == "failed: RuntimeError: no surface"
    assert "| broken |" in peers.report([reading], []) and "failed" in peers.report([reading], [])


def test_a_part_of_the_speed_table_that_fails_is_told(monkeypatch, capsys):
    monkeypatch.setitem(speed.PARTS, "import", lambda _: 1 / 0)
    [timing] = speed.run(("import",), 1)
    assert timing.reached == "failed" and "ZeroDivisionError" in timing.peer
    assert "ZeroDivisionError" in capsys.readouterr().out


def test_a_speed_table_compares_with_target_and_peer():
    timing = speed._timing("work", 0.1, speed.Spent(0.05, 0.09), "peer", speed.Spent(0.2, 0.2))
    assert timing == speed.Timing("work", "<= 100 ms", "50 ms", "yes", "90 ms", "peer: 200 ms", "4.00 x")
    assert speed._timing("work", 0.1, speed.Spent(0.2, 0.2)).met == "no"
    assert "| work |" in speed.report([timing], 3)
