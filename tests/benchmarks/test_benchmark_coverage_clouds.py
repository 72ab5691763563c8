"""The coverage of clouds' intervals is counted, on shapes that did not make them."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.coverage_clouds import NOISES, SIZES, Answer, Case, answered, cases_of, report, run
from benchmarks.coverage_shapes import _FAMILIES as FORMULAS
from benchmarks.coverage_shapes import CALIBRATING, JUDGING, shape
from benchmarks.samplings import SAMPLINGS
from benchmarks.shapes import ANALYTIC, MESHES

from benchmarks import coverage_clouds


def test_no_shape_judges_what_it_made():
    assert not set(CALIBRATING) & set(JUDGING)
    assert len(JUDGING) >= 20


def test_there_are_enough_cases_of_every_kind():
    found = [case for name in JUDGING for case in cases_of(name)]
    assert len(found) >= 400
    for values, of in ((SIZES, "size"), (SAMPLINGS, "sampling"), (NOISES, "noise"), ((True, False), "normals")):
        assert {getattr(case, of) for case in found} == set(values)
        for value in values:
            assert sum(getattr(case, of) == value for case in found) >= 20
    assert found == [case for name in JUDGING for case in cases_of(name)]


@pytest.mark.parametrize(
    "name", ["ellipsoid", "ripples 3", "tree 30", "hull 1", "twisted prism 1", "blob 1", "moebius 1"]
)
def test_shapes_without_a_file_are_sampled_where_they_are(name):
    known = shape(name)
    points, normals = known.draw(500, np.random.default_rng(0))
    assert points.shape == normals.shape == (500, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)
    assert known.area > 0.0


def test_the_ellipsoid_has_the_area_of_its_formula():
    from surfel import Ellipsoid, measure

    assert shape("ellipsoid").area == pytest.approx(float(measure(Ellipsoid((1.0, 0.6, 0.3))).area.value), rel=1e-4)


def test_shapes_that_bound_a_solid_have_its_volume():
    assert shape("ellipsoid").volume == pytest.approx(4.0 / 3.0 * np.pi * 0.18, rel=1e-4)
    assert shape("moebius 1").volume is None
    assert shape("terrain 1").volume is None


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_clouds_are_what_they_are_called(sampling):
    case = Case("ellipsoid", 5000, sampling, 0.0, True, 1)
    cloud = case.cloud()
    assert 0.8 * 5000 < len(cloud.points) < 1.2 * 5000
    np.testing.assert_array_equal(cloud.points, case.cloud().points)
    if sampling in ("16x", "30x"):
        count, _ = np.histogram(cloud.points[:, 0], 10)
        assert count[-2:].sum() > 4 * count[:2].sum()


def test_a_case_is_measured():
    answer = answered(Case("ellipsoid", 5000, "random", 0.1, False, 2))
    assert abs(answer.error) < 0.02
    assert 0.0003 < answer.half_width < 0.05


def test_a_run_is_taken_up_where_it_was_broken_off(tmp_path, monkeypatch):
    rows, told = str(tmp_path / "rows.jsonl"), []
    monkeypatch.setattr(coverage_clouds, "JUDGING", ("ellipsoid",))
    monkeypatch.setattr(coverage_clouds, "answered", lambda case: Answer(case, 0.001, 0.01, True, "", 0.1, 0.0, 0.1))
    assert run(True, told=told.append, rows=rows, minutes=0.0) == []
    assert told == ["ellipsoid: 0 of 0, 6 to do"]
    whole = run(True, told=told.append, rows=rows)
    assert len(whole) == 6
    monkeypatch.setattr(coverage_clouds, "answered", None)
    assert run(True, told=told.append, rows=rows, minutes=0.0) == whole


def test_the_table_counts_what_held_and_what_was_refused():
    def answer(name: str, seed: int, error: float, reliable: bool = True) -> Answer:
        return Answer(Case(name, 5000, "random", 0.1, False, seed), error, 0.01, reliable, "", 0.1)

    found = [answer("ellipsoid", k, 0.02 if k % 20 == 0 else 0.005) for k in range(100)]
    line = next(row for row in report(found).splitlines() if row.startswith("| all"))
    assert [cell.strip() for cell in line.split("|")[1:7]] == ["all", "100", "0", "95.0", "93 to 97", "yes"]
    refused = found + [answer("ellipsoid", 100 + k, 0.5, reliable=False) for k in range(100)]
    line = next(row for row in report(refused).splitlines() if row.startswith("| all"))
    cells = [cell.strip() for cell in line.split("|")[1:7]]
    assert cells[2] == "100"
    assert float(cells[3]) == pytest.approx(100 * 95 / 180, abs=0.1)  # refusals above a tenth are misses
    assert cells[5] == "no"


def test_level_sets_are_closed():
    known = shape("blob 11")
    points, normals = known.draw(40_000, np.random.default_rng(1))
    np.testing.assert_allclose(normals.mean(axis=0), 0.0, atol=0.02)
    assert np.einsum("ij,ij->i", points, normals).mean() > 0.0  # outward


def test_every_shape_of_the_families_is_a_mesh_or_a_formula():
    for name in (*CALIBRATING, *JUDGING):
        kind, _, number = name.rpartition(" ")
        assert name in MESHES or name in ANALYTIC or name in FORMULAS or (kind in FORMULAS and number.isdigit())
