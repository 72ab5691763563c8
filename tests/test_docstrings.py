"""Every example in a docstring runs and prints what it says, and the doors of the house all have one."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import surfel

MODULES = [m.name for m in pkgutil.walk_packages(surfel.__path__, "surfel.") if m.name != "surfel.__main__"]
DOORS = ["measure", "read", "write", "info", "convert", "sample", "Surfels", "Mesh", "Estimate"]


@pytest.mark.parametrize("name", ["surfel", *MODULES])
def test_examples_print_what_they_say(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with np.printoptions():
        report = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert report.failed == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", DOORS)
def test_every_door_has_an_example(name):
    assert ">>>" in getattr(surfel, name).__doc__
