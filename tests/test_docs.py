"""The documentation builds without a warning and tells of every public name."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import surfel

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_the_api_page_tells_of_every_public_name_at_its_home():
    told = set(re.findall(r"^::: ([\w.]+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE))
    assert told == {f"{home}.{name}" for name, home in surfel._HOME.items()}


def test_equations_are_numbered_in_order_and_references_to_them_exist():
    text = (DOCS / "theory.md").read_text(encoding="utf-8")
    numbers = [int(n) for n in re.findall(r" {4,}\((\d+)\)$", text, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1)) and len(numbers) >= 15
    assert {int(n) for n in re.findall(r"(?<=[ ,])\((\d+)\)", text)} <= set(numbers)


def test_the_documentation_builds(tmp_path):
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings")
    pytest.importorskip("material")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    page = (tmp_path / "site" / "api" / "index.html").read_text(encoding="utf-8")
    assert "standard_error" in page
