"""The examples run, in a folder of their own, and what they print lies near the truth that they print beside it."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

import surfel

FOLDER = Path(__file__).parents[1] / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))
TOLD = re.compile(r"([\d.]+) \+- ([\d.]+), truth ([\d.]+)")
LEAST_TOLD = {
    "01_measure_a_scan": 2,
    "02_sample_and_check": 8,
    "03_by_lines": 5,
    "04_machined_part": 4,
    "05_drilled_scan": 6,
    "06_roughing_surface": 0,
    "07_canopy_sandwich": 0,
    "08_scan_minus_drill": 3,
    "09_two_scans_joined": 5,
    "10_stockpile": 2,
    "11_picture_of_a_cut": 0,
    "12_smoothing": 1,
    "13_descriptors": 0,
}
SAID = {
    "06_roughing_surface": ["fast: 0 points above", "tight: 0 points above"],
    "07_canopy_sandwich": ["canopy: 0 echoes", "ground: 0 echoes"],
    "12_smoothing": ["area-preserving: never shrinks", "plain: has shrunk"],
    "13_descriptors": ["28 of 28 scans are found"],
}


def test_the_examples_are_those_that_are_known_here():
    assert [path.stem for path in EXAMPLES] == sorted(LEAST_TOLD)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_runs_and_its_results_agree_with_the_truth(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    printed = capsys.readouterr().out
    told = [tuple(map(float, found)) for found in TOLD.findall(printed)]
    assert len(told) >= LEAST_TOLD[path.stem]
    for value, error, truth in told:
        assert 0.0 < error < 0.01 * truth
        assert abs(value - truth) < 3.0 * error
    assert len(list(tmp_path.glob("*.png"))) == 1  # the gallery shows it
    assert all(pattern in printed for pattern in SAID.get(path.stem, ()))


def test_the_gallery_shows_them_all_in_small_pictures():
    docs = FOLDER.parent / "docs"
    page = (docs / "gallery.md").read_text(encoding="utf-8")
    for path in EXAMPLES:
        picture = docs / "images" / "gallery" / f"{path.stem}.png"
        assert f"images/gallery/{path.stem}.png" in page and picture.stat().st_size <= 120_000
        code = path.read_text(encoding="utf-8").split('"""', 2)[2].strip()
        assert code in page, f"{path.stem} has changed: run scripts/draw_gallery"


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_it_is_short_and_uses_public_names_only(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert set(re.findall(r"\bsurfel\.(\w+)", text)) <= set(surfel.__all__)
    assert set(re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE)) <= {"matplotlib", "numpy", "scipy", "surfel"}
