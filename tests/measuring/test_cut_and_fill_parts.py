"""The parts of cut and fill: triangles beside SciPy's, the lattice of a polygon, sums of signs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from surfel.core.errors import InputError
from surfel.measuring.cut_and_fill_delaunay import delaunay, on_lattice
from surfel.measuring.cut_and_fill_region import Lattice, refuse_crossings, signed_area


def areas(places, triangles):
    a, b, c = (places[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def sets():
    rng = np.random.default_rng(0)
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    grid = np.stack(np.meshgrid(np.arange(30.0), np.arange(20.0)), -1).reshape(-1, 2)
    unit = {
        **{f"random {n}": rng.random((n, 2)) for n in (3, 4, 7, 50, 2000)},
        "strip": np.column_stack([rng.random(800), 1e-6 * rng.random(800)]),
        "circle": 0.5 + 0.5 * np.column_stack([np.cos(angle), np.sin(angle)]),
        "clusters": np.vstack([rng.random((300, 2)), 0.5 + 1e-5 * rng.random((300, 2))]),
    }
    made = {name: on_lattice(p, np.zeros(2), 1.0) for name, p in unit.items()}
    made |= {"grid": grid, "whole numbers": rng.integers(0, 15, (300, 2)).astype(float)}
    made["a line and one point"] = np.vstack([np.column_stack([np.arange(50.0), np.zeros(50)]), [[7.0, 3.0]]])
    return {name: np.unique(p, axis=0) for name, p in made.items()}


SETS = sets()


@pytest.mark.parametrize("name", SETS)
def test_triangles_tile_the_hull_and_are_those_of_qhull(name):
    places = SETS[name]
    found, theirs = delaunay(places), Delaunay(places)
    size = areas(places, found)
    assert (size > 0.0).all()
    assert size.sum() == pytest.approx(np.abs(areas(places, theirs.simplices)).sum(), rel=1e-9)
    assert np.unique(found).size == len(places)


@pytest.mark.parametrize("name", SETS)
def test_no_circle_holds_the_corner_across(name):
    """In whole numbers of any length: of every two triangles at a side, by the determinant of the circle test."""
    places = [(int(x), int(y)) for x, y in SETS[name]]
    across = {}
    for triangle in delaunay(SETS[name]).tolist():
        for i in range(3):
            across[triangle[i], triangle[(i + 1) % 3]] = triangle
    for (u, v), triangle in across.items():
        other = across.get((v, u))
        if other is None:
            continue
        (d,) = (places[k] for k in other if k not in (u, v))
        (a, b), (c, e), (f, g) = ((places[k][0] - d[0], places[k][1] - d[1]) for k in triangle)
        one, two, three = (a * a + b * b), (c * c + e * e), (f * f + g * g)
        parts = [one * (c * g - e * f), two * (f * b - g * a), three * (a * e - b * c)]
        assert sum(parts) <= 1e-14 * sum(map(abs, parts))


def test_points_on_a_line_have_no_triangles():
    assert len(delaunay(np.column_stack([np.arange(9.0), 2.0 * np.arange(9.0)]))) == 0
    assert len(delaunay(np.zeros((1, 2)))) == 0


@pytest.mark.parametrize("seed", range(6))
def test_shares_of_cells_add_up_to_the_polygon_and_its_centroid(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.random(40)) * 2.0 * np.pi
    polygon = np.column_stack([np.cos(angle), np.sin(angle)]) * (0.3 + 0.7 * rng.random(40))[:, None] + [3.0, -7.0]
    lattice = Lattice.over(polygon if seed % 2 else polygon[::-1].copy(), 0.02)
    cells = np.flatnonzero(lattice.slot.ravel() > -2)
    share = lattice.share.ravel()[cells]
    x, y = (polygon - polygon[0]).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    centroid = [float(((q + np.roll(q, -1)) * cross).sum() / (3.0 * cross.sum())) for q in (x, y)]
    assert share.sum() == pytest.approx(lattice.area, rel=1e-12) == abs(signed_area(polygon))
    middle = (share[:, None] * lattice.places(cells)).sum(axis=0) / share.sum()
    np.testing.assert_allclose(middle - polygon[0], centroid, atol=1e-10)


def test_polygons_that_cross_themselves():
    refuse_crossings(np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)]))
    with pytest.raises(InputError, match="cross itself"):
        refuse_crossings(np.array([(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]))
