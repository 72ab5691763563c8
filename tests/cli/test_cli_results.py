"""What the commands print, with the work behind them replaced by known results."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import surfel
from surfel.cli import main
from surfel.cli.app import app
from surfel.cli.output import plain
from surfel.core.estimate import Estimate
from surfel.measuring.measurement import Measurement
from surfel.shapes.surfels import Surfels

KEYS = [
    "points", "method", "lines", "area", "volume", "centroid", "inertia", "areas", "sides", "closed", "leak", "spacing",
    "noise", "seed", "seconds", "warnings",
]  # fmt: skip
POINTS = np.random.default_rng(0).random((20, 3))


def known(**changes) -> Measurement:
    values = {
        "area": Estimate(12.5, 0.02),
        "volume": Estimate(3.25, 0.004),
        "centroid": Estimate(np.array([1.0, 2.0, 3.0]), np.full(3, 0.01)),
        "inertia": Estimate(np.eye(3), np.full((3, 3), 0.1)),
        "areas": (Estimate(12.5, 0.02),),
        "closed": True,
        "leak": 0.001,
        "spacing": 0.05,
        "noise": 0.1,
        "cleaning": {"duplicates": 12, "stray": 0, "not_finite": 3},
        "lines": 65_536,
        "seed": 7,
        "points": 20_000,
        "seconds": 0.5,
        "compile_seconds": 9.0,
        "warnings": ("the border is ragged",),
    }
    return Measurement(**(values | changes))


@pytest.fixture
def calls(monkeypatch):
    """Replace reading and measuring; what they were called with is kept."""
    seen = {}

    def read(path, as_=None):
        seen["read"] = (path, as_)
        return Surfels(POINTS)

    def measure(shape, **options):
        options.pop("progress")(0.5, "crossing")
        seen["shape"], seen["measure"] = shape, options
        return seen.get("result", known())

    monkeypatch.setitem(surfel.__dict__, "read", read)
    monkeypatch.setitem(surfel.__dict__, "measure", measure)
    return seen


def test_measure_prints_one_json_object_with_the_promised_keys_in_order(calls, capsys):
    assert main(["measure", "scan.ply", "--json"]) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert [key for key in data if key in KEYS] == KEYS
    assert set(data) - set(KEYS) == {"cleaning", "compile_seconds"}
    for name in ("area", "volume"):
        assert set(data[name]) == {"value", "standard_error", "interval", "reliable", "reason"}
        low, high = data[name]["interval"]
        assert low < data[name]["value"] < high
    assert data["warnings"] == ["the border is ragged"]
    assert err == ""


def test_what_is_not_known_is_null_in_json(calls, capsys):
    calls["result"] = known(volume=None, centroid=None, inertia=None, leak=math.nan, area=Estimate.unknown("too few"))
    assert main(["measure", "scan.ply", "--json"]) == 0
    data = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert data["volume"] is data["centroid"] is data["inertia"] is data["leak"] is None
    assert data["area"] == {
        "value": None,
        "standard_error": None,
        "interval": [None, None],
        "reliable": False,
        "reason": "too few",
    }


PUBLISHED = {"radius_factor": 1.5, "depth": 4, "cells": "line", "density": "even", "denoise": 0}
"""The defaults of the published method."""


def test_every_option_reaches_the_measurement(calls):
    options = ["--as", "points", "--method", "lines", "--lines", "1000", "--tolerance", "0.01", "--model", "chord"]
    options += ["--radius-factor", "3", "--depth", "5", "--cells", "cylinder", "--density", "uneven", "--denoise", "2"]
    assert main(["measure", "scan.ply", *options, "--sequence", "r4", "--seed", "7", "--json"]) == 0
    assert calls["read"] == ("scan.ply", "points")
    assert calls["measure"] == {
        "method": "lines",
        "lines": 1000,
        "tolerance": 0.01,
        "seed": 7,
        "model": "chord",
        "sequence": "r4",
        "radius_factor": 3.0,
        "depth": 5,
        "cells": "cylinder",
        "density": "uneven",
        "denoise": 2,
    }


def test_defaults_are_those_of_the_library(calls):
    assert main(["measure", "scan.ply", "--json"]) == 0
    assert calls["read"] == ("scan.ply", None)
    assert calls["measure"] == {
        "method": None,
        "lines": 65_536,
        "tolerance": None,
        "seed": 0,
        "model": "tangent",
        "sequence": "niederreiter",
        **PUBLISHED,
    }


@pytest.mark.parametrize(("option", "solid"), [("--solid", True), ("--sheet", False)])
def test_solid_and_sheet_are_told_to_the_cloud(calls, option, solid):
    assert main(["measure", "scan.ply", option, "--json"]) == 0
    assert calls["shape"].solid is solid
    assert np.array_equal(calls["shape"].points, POINTS)


def test_the_table_tells_values_errors_units_and_what_was_done(calls, capsys):
    assert main(["measure", "scan[red].ply", "--units", "mm"]) == 0
    out, err = capsys.readouterr()
    for text in (
        "scan[red].ply: 20,000 points", "12.50 +- 0.02 mm^2", "12.4608 to 12.5392", "3.250 +- 0.004 mm^3", "mm^3",
        "0.10% of the lines", "0.05 mm", "dropped 12 duplicates, 3 not finite", "9.0 s compiling",
    ):  # fmt: skip
        assert text in " ".join(out.split()), text
    assert "stray" not in out
    assert err == "surfel: warning: the border is ragged\n"


def test_the_table_says_what_is_not_reliable(calls, capsys):
    calls["result"] = known(
        area=Estimate(2.0, math.inf, reliable=False, reason="noise of 0.8 spacings"),
        volume=Estimate.unknown("the surface leaks"),
    )
    assert main(["measure", "scan.ply"]) == 0
    out = capsys.readouterr().out
    assert "not reliable: noise of 0.8 spacings" in out and "no interval" in out
    assert "unknown" in out and "the surface leaks" in out


def test_a_sheet_has_no_volume_row(calls, capsys):
    calls["result"] = known(volume=None, centroid=None, inertia=None, closed=False)
    assert main(["measure", "scan.ply"]) == 0
    out = capsys.readouterr().out
    assert "volume" not in out and "centroid" not in out


def test_quiet_keeps_the_result_and_drops_the_notes(calls, capsys):
    assert main(["measure", "scan.ply", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert "12.50 +- 0.02" in out
    assert err == ""


def test_the_picture_is_written_whole(calls, tmp_path, capsys, monkeypatch):
    from surfel.core.patches import Patches

    pytest.importorskip("matplotlib")
    patches = Patches(POINTS, np.tile([0.0, 0.0, 1.0], (20, 1)), np.linspace(0.0, 1.0, 20))
    monkeypatch.setattr(Surfels, "_patches", lambda self, n: patches)
    target = tmp_path / "a $picture$.png"
    assert main(["measure", "scan.ply", "--plot", str(target), "--json"]) == 0
    assert target.read_bytes().startswith(b"\x89PNG") and target.read_bytes().endswith(b"IEND\xaeB`\x82")
    assert list(tmp_path.iterdir()) == [target]


def test_info_and_convert_print_what_they_are_told(monkeypatch, capsys):
    facts = {"format": "ply", "points": 12_345, "normals": True, "bounds": np.array([[0.0, 0, 0], [1, 2, np.inf]])}
    monkeypatch.setitem(
        surfel.__dict__, "info", lambda path, full=False, progress=None: facts | ({"duplicates": 3} if full else {})
    )
    monkeypatch.setitem(
        surfel.__dict__, "convert", lambda a, b, as_=None, **_: {"points": 5, "lost": ["colors"], "as": as_}
    )
    assert main(["info", "scan.ply", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bounds"] == [[0.0, 0.0, 0.0], [1.0, 2.0, None]]
    assert main(["info", "scan.ply", "--full"]) == 0
    out = capsys.readouterr().out
    assert "12,345" in out and "yes" in out and "0, 0, 0  to  1, 2, unknown" in out and "duplicates" in out
    assert main(["convert", "a.ply", "b.xyz", "--as", "points"]) == 0
    out = capsys.readouterr().out
    assert "a.ply -> b.xyz" in out and "colors" in out


def test_plain_holds_only_what_json_can_hold():
    given = {1: np.float32(1.5), "a": (math.nan, -math.inf, None, True), "b": np.arange(2), "c": {"x\udcff"}, "d": 1j}
    assert plain(given) == {"1": 1.5, "a": [None, None, None, True], "b": [0, 1], "c": ["x\\udcff"], "d": "1j"}
    json.dumps(plain(given), allow_nan=False)


@pytest.mark.parametrize("command", ["", "measure", "info", "convert", "sample", "demo"])
def test_every_command_has_help(command):
    done = CliRunner().invoke(app, [*command.split(), "--help"])
    assert done.exit_code == 0
    assert "Usage" in done.output and "None" not in done.output
