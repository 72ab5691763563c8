"""The paper's solids have the areas that are claimed, and its figures and tables can be made."""

import numpy as np
import pytest

from surfel.measuring.baselines import subdivision

pytest.importorskip("matplotlib")
from benchmarks.__main__ import main
from benchmarks.li2003_curves import curve
from benchmarks.li2003_solids import CUBE, GATE, SKELETON, SOLIDS, SPHERE_20, L, area_of_l, depth_of_l
from benchmarks.li2003_tables import LEVELS, table_2, table_3
from benchmarks.pictures import picture

from benchmarks import peers_csg


@pytest.mark.parametrize("known", [*SOLIDS, SPHERE_20], ids=lambda known: known.name)
def test_closed_forms_agree_with_facets(known):
    assert subdivision(known.make(), 25).area == pytest.approx(known.area, rel=5e-4)


def test_the_papers_figures():
    assert area_of_l(depth_of_l()) == pytest.approx(1557.08, abs=1e-9)
    assert SKELETON.area == pytest.approx(1752.83, abs=0.005)
    assert SPHERE_20.area == pytest.approx(5026.55, abs=0.005)


@pytest.mark.parametrize("known", [*SOLIDS, SPHERE_20], ids=lambda known: known.name)
def test_reference_spheres_hold_the_bounds(known):
    shape = known.make()
    ball, (low, high) = known.ball(shape), np.asarray(shape.bounds)
    assert ball.radius == pytest.approx(1.088 * 0.5 * np.linalg.norm(high - low), rel=0.005)
    assert np.allclose(ball.centre, 0.5 * (low + high))


@pytest.mark.parametrize("case", peers_csg.CASES, ids=lambda case: case.name)
def test_areas_and_volumes_agree_with_manifold(case):
    pytest.importorskip("manifold3d")
    solid = peers_csg.as_manifold(case.make(), 128)
    assert solid.surface_area() == pytest.approx(case.area, rel=4e-3)
    assert solid.volume() == pytest.approx(case.volume, rel=7e-3)


def test_curves_fall_and_low_discrepancy_falls_faster():
    random, niederreiter = (curve(CUBE, "tangent", name, 4096) for name in ("random", "niederreiter"))
    assert random.lines[0] == 64 and random.lines[-1] == 4096
    assert niederreiter.rms[-1] < 0.5 * random.rms[-1] < 0.5 * random.rms[0]
    assert random.at(4000.0) == random.rms[-1]


def test_tables_hold_every_level():
    two = table_2(GATE, 1)
    assert sorted(two) == sorted(LEVELS) and two[0.25].elements >= two[8.0].elements
    one = curve(L, "tangent", "niederreiter", 4096)
    three = table_3(L, one, 1)
    assert three[8.0].elements < three[2.0].elements and 0.25 not in three
    assert 100.0 * one.at(three[2.0].elements) <= 2.0


def test_a_picture_shows_the_solid():
    image = picture(SKELETON.make(), (1.0, -1.7, 0.9), size=64)
    assert image.shape == (64, 64, 3) and image.dtype == np.uint8
    white = (image == 255).all(axis=2)
    assert white[0].all() and white[:, 0].all() and 0.3 < white.mean() < 0.8
    assert (image[~white].astype(int).max(axis=1) > 40).all()


@pytest.mark.slow
def test_the_command_writes_everything(tmp_path, capsys):
    pytest.importorskip("skimage")
    out = tmp_path / "li2003.md"
    assert main(["papers", "li2003", "--quick", "--out", str(out)]) == 0
    text = out.read_text()
    assert all(f"Table {k}" in text for k in (1, 2, 3)) and "nan" not in text.lower().replace("nanosecond", "")
    pictures = {path.name for path in tmp_path.glob("*.png")}
    assert pictures == {
        f"li2003-{name}.png"
        for name in ("fig-13", "fig-18", "figs-06-07", "figs-08-11", "figs-12-19-20", "figs-14-17", "figs-21-24")
    }
    assert all(f"]({name})" in text for name in pictures)


@pytest.mark.slow
def test_peers_are_compared():
    found = peers_csg.run(quick=True)
    text = peers_csg.report(found)
    ((case, rows),) = found
    assert case.name == "skeleton" and all(row.area < 0.2 for row in rows)
    assert "surfel.measure" in text
