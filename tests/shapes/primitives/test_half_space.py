"""HalfSpace: its plane, its form, and the polygon in which it cuts a box."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from surfel import InputError
from surfel.shapes.primitives.faces import choose_face
from surfel.shapes.primitives.primitive import square_points

UNIT = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def test_it_holds_what_is_below_its_plane():
    rng = np.random.default_rng(0)
    for normal, offset in zip(rng.standard_normal((20, 3)), rng.standard_normal(20), strict=True):
        shape = surfel.HalfSpace(normal, offset) & surfel.Box(4.0)
        points = rng.uniform(-2.0, 2.0, (500, 3))
        assert np.array_equal(shape.contains(points), points @ normal <= offset)


@pytest.mark.parametrize("normal", [(0, 0, 2), (0, -3, 0), (1, 0, 0), (1, 1, 0), (1, -2, 3), (1e-9, 0, 1), (0, 0, -1)])
def test_its_form_is_its_plane(normal):
    shape = surfel.HalfSpace(normal, 1.5)
    form, placement = shape._convex()
    assert np.abs(placement[:3, :3].T @ placement[:3, :3] - np.eye(3)).max() < 1e-15
    assert np.linalg.det(placement[:3, :3]) == pytest.approx(1.0)
    ends = np.flatnonzero(np.isfinite(form[:6]))
    assert len(ends) == 1
    point = np.zeros(3)
    point[ends[0] % 3] = form[ends[0]]
    assert (placement[:3, :3] @ point + placement[:3, 3]) @ np.array(normal) == pytest.approx(1.5, rel=1e-14)


def test_bounds_end_at_a_plane_across_an_axis():
    inf = math.inf
    assert surfel.HalfSpace((0, 0, 2), 1).bounds.tolist() == [[-inf, -inf, -inf], [inf, inf, 0.5]]
    assert surfel.HalfSpace((0, -1, 0), 3).bounds.tolist() == [[-inf, -3.0, -inf], [inf, inf, inf]]
    assert np.isinf(surfel.HalfSpace((1, 1, 0), 3).bounds).all()


@pytest.mark.parametrize(
    ("normal", "offset", "area"),
    [
        ((0, 0, 1), 0.3, 4.0),
        ((0, 0, 1), 1.0, 4.0),
        ((0, 5, 0), -4.9, 4.0),
        ((1, 1, 0), 0.0, 4.0 * math.sqrt(2.0)),
        ((1, 1, 1), 0.0, 3.0 * math.sqrt(3.0)),  # a regular hexagon
        ((1, 1, 1), 2.5, math.sqrt(3.0) / 2.0 * 0.25),  # a small triangle at a corner
        ((-2, -2, -2), 5.0, math.sqrt(3.0) / 2.0 * 0.25),
        ((1, 1, 1), 3.5, 0.0),
        ((0, 0, 1), 1.5, 0.0),
    ],
)
def test_the_polygon_in_a_box_has_its_area(normal, offset, area):
    shape = surfel.HalfSpace(normal, offset)
    elements = shape._sample_within(square_points(2000), UNIT)
    assert elements.areas.sum() == pytest.approx(area, rel=1e-12, abs=1e-14)
    if area:
        assert len(elements) == 2000
        assert np.abs(elements.points @ np.array(normal, float) - offset).max() <= 1e-14 * np.linalg.norm(normal)
        assert np.abs(elements.points).max() <= 1.0 + 1e-14
        assert np.abs(elements.normals - np.array(normal) / np.linalg.norm(normal)).max() <= 1e-15
    else:
        assert len(elements) == 0


def test_the_samples_of_the_polygon_are_even():
    rng = np.random.default_rng(1)
    normal, offset = np.array([0.3, -0.8, 0.5]), 0.2
    box = np.array([[-1.0, -2.0, 0.0], [1.5, 0.5, 2.0]])
    elements = surfel.HalfSpace(normal, offset)._sample_within(square_points(20_000), box)
    # by rejection: points of a large square of the plane that fall into the box
    unit = normal / np.linalg.norm(normal)
    across = np.cross(unit, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(unit, [1.0, 0.0, 0.0]))
    frame = np.stack([across, np.cross(unit, across)])
    thrown = rng.uniform(-5.0, 5.0, (200_000, 2)) @ frame + offset / np.linalg.norm(normal) * unit
    kept = thrown[((thrown >= box[0]) & (thrown <= box[1])).all(axis=1)]
    assert elements.areas.sum() == pytest.approx(100.0 * len(kept) / 200_000, rel=0.03)
    assert elements.points.mean(axis=0) == pytest.approx(kept.mean(axis=0), abs=0.03)
    assert np.cov(elements.points.T) == pytest.approx(np.cov(kept.T), abs=0.03)


def test_it_is_unbounded():
    shape = surfel.HalfSpace((0, 0, 1), 0)
    assert (shape.area, shape.volume) == (math.inf, math.inf)
    with pytest.raises(InputError, match="finite"):
        shape._sample_within(square_points(4), shape.bounds)


@pytest.mark.parametrize(
    ("normal", "offset", "said"),
    [
        ((0, 0, 0), 1.0, "zero vector"),
        ((0, np.nan, 1), 1.0, "finite"),
        ((0, 1), 1.0, "3 numbers"),
        ((0, 0, 1), np.inf, "finite"),
        ((0, 0, 1), "up", "number"),
    ],
)
def test_bad_planes(normal, offset, said):
    with pytest.raises(InputError, match=said):
        surfel.HalfSpace(normal, offset)


def test_faces_without_area_are_never_chosen():
    u = np.array([0.0, 0.25, 0.5, 0.75, np.nextafter(1.0, 0.0)])
    face, within = choose_face(u, np.array([0.0, 1.0, 0.0, 1.0, 0.0]))
    assert face.tolist() == [1, 1, 3, 3, 3]
    assert within == pytest.approx([0.0, 0.5, 0.0, 0.5, 1.0])
    assert (within < 1.0).all()
