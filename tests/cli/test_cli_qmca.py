"""``surfel measure --method qmca``: its options reach the method, and what it cannot do is said in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel.cli import main

BALL = truth.even_sphere(3000)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "ball.xyz"
    np.savetxt(path, np.column_stack([BALL.points, BALL.normals]), fmt="%.17g")
    return str(path)


def measured(capsys, *arguments):
    assert main(["measure", *arguments, "--method", "qmca", "--lines", "2000", "--json", "--quiet"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_options_reach_the_method(file, capsys):
    cloud = surfel.read(file)
    options = {"radius_factor": 2.5, "depth": 3, "cells": "cylinder", "density": "uneven", "denoise": 1}
    given = [part for name, value in options.items() for part in (f"--{name.replace('_', '-')}", str(value))]
    expected = surfel.measure(cloud, method="qmca", lines=2000, seed=4, **options).area.value
    assert measured(capsys, file, *given, "--seed", "4")["area"]["value"] == expected
    for name in options:
        rest = {key: value for key, value in options.items() if key != name}
        without = [part for key, value in rest.items() for part in (f"--{key.replace('_', '-')}", str(value))]
        assert measured(capsys, file, *without, "--seed", "4")["area"]["value"] != expected


def test_the_result_is_told_without_an_error_bar(file, capsys):
    told = measured(capsys, file)
    assert told["method"] == "qmca" and told["lines"] == 2000 and told["volume"] is None
    assert told["area"]["standard_error"] is None and told["area"]["interval"] == [None, None]
    assert told["area"]["reliable"] is False and "no error bar" in told["area"]["reason"]
    assert told["cleaning"] == {"non_finite": 0, "without_normal": 0, "duplicates": 0}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--radius-factor", "-2"], "radius_factor must be positive; got -2"),
        (["--depth", "40"], "depth must be between 1 and 10; got 40"),
        (["--tolerance", "0.1"], "no error bar that a tolerance"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line(file, capsys, options, said):
    assert main(["measure", file, "--method", "qmca", *options]) == 2
    err = capsys.readouterr().err
    assert said in err and len(err.strip().splitlines()) == 1 and "Traceback" not in err
