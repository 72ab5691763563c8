"""What holds for every exact primitive, wherever it is placed: crossings, normals, samples, bounds, closed forms."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import surfel
from primitives_with_truth import CASES, PLACEMENTS, lines_round, places, to_local
from surfel import InputError, Lines
from surfel._numba import threads_for
from surfel.shapes.primitives.primitive import square_points

by_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
by_placement = pytest.mark.parametrize("placement", PLACEMENTS)
SAMPLED = [case for case in CASES if case.shape.sampled]
by_sampled = pytest.mark.parametrize("case", SAMPLED, ids=lambda case: case.name)


def placed(case, placement):
    matrix = PLACEMENTS[placement]
    shape = case.shape if placement == "in place" else case.shape.transformed(matrix)
    return shape, matrix


def outward(case, matrix, points):
    """Unit normals of the placed surface by central differences of the distance in the world."""
    step = 1e-6 * case.size
    slopes = [
        case.distance(to_local(points + step * axis, matrix)) - case.distance(to_local(points - step * axis, matrix))
        for axis in np.eye(3)
    ]
    normals = np.stack(slopes, axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def off_edges(case, points, matrix):
    """Which points are away from edges: there the normals a little to all sides agree."""
    step = 3e-5 * case.size
    sides = [outward(case, matrix, points + step * axis * sign) for axis in np.eye(3) for sign in (-1.0, 1.0)]
    return np.min([(side * sides[0]).sum(axis=1) for side in sides], axis=0) > 0.99


@by_placement
@by_case
def test_crossings_lie_on_the_surface_and_alternate(case, placement):
    shape, matrix = placed(case, placement)
    lines = lines_round(np.asarray(shape.bounds), 6000, seed=1)
    found = shape.cross(lines)
    assert len(found.t) > 50
    assert (found.counts % 2 == 0).all()
    local = to_local(places(lines, found), matrix)
    assert np.abs(case.distance(local)).max() <= 1e-12 * case.size
    assert (found.cosine[0::2] <= 0.0).all()
    assert (found.cosine[1::2] >= 0.0).all()
    same_line = found.lines[1:] == found.lines[:-1]
    assert (np.diff(found.t)[same_line] > 0.0).all()
    middle = 0.5 * (found.t[0::2] + found.t[1::2])
    inside = lines.origins[found.lines[0::2]] + middle[:, None] * lines.directions[found.lines[0::2]]
    assert (case.distance(to_local(inside, matrix)) < 1e-12 * case.size).all()
    assert (found.weight == 1.0).all()
    assert (found.leaf == 0).all()


@by_placement
@by_case
def test_cosines_are_those_of_the_normals(case, placement):
    shape, matrix = placed(case, placement)
    lines = lines_round(np.asarray(shape.bounds), 2000, seed=2)
    found = shape.cross(lines)
    points = places(lines, found)
    clear = off_edges(case, points, matrix)
    expected = (outward(case, matrix, points) * lines.directions[found.lines]).sum(axis=1)
    assert clear.mean() > 0.5
    assert np.abs(found.cosine - expected)[clear].max() <= 2e-3 if case.name == "rod" else 2e-4


@by_sampled
def test_lines_that_touch_hit_twice_or_not_at_all(case):
    rng = np.random.default_rng(3)
    elements = case.shape.patches(1500)
    along = np.cross(elements.normals, rng.standard_normal((len(elements), 3)))
    for depth in (0.0, 1e-15, -1e-15, 1e-12, 1e-9, -1e-9, 1e-6):
        lines = Lines.of(elements.points - depth * case.size * elements.normals, along, 1.0)
        found = case.shape.cross(lines)
        assert (found.counts % 2 == 0).all()
        assert np.abs(case.distance(places(lines, found))).max(initial=0.0) <= 1e-12 * case.size
        assert (found.cosine[0::2] <= 0.0).all()
        assert (found.cosine[1::2] >= 0.0).all()
        if depth >= 1e-9:
            assert (found.counts >= 2).all()


@by_case
@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
def test_origins_far_away_give_the_same_hits(case, distance):
    lines = lines_round(np.asarray(case.shape.bounds), 3000, seed=4)
    shift = distance * case.size
    far = Lines(lines.origins - shift * lines.directions, lines.directions, lines.weights)
    found = case.shape.cross(far)
    assert (found.counts % 2 == 0).all()
    rounding = 4.0 * np.finfo(float).eps * shift
    # the last bit of t alone moves a point along the line so far
    assert np.abs(case.distance(places(far, found))).max() <= 1e-12 * case.size + 4.0 * rounding
    near = case.shape.cross(lines)
    same = near.counts == found.counts
    assert same.mean() > 0.99
    pairs = np.repeat(same, near.counts), np.repeat(same, found.counts)
    moved = np.abs(near.t[pairs[0]] + shift - found.t[pairs[1]]) * np.abs(near.cosine[pairs[0]])
    assert np.quantile(moved, 0.99) <= 1e-12 * case.size + 4.0 * rounding


@by_case
def test_the_bits_are_the_same_on_one_and_two_threads(case):
    lines = lines_round(np.asarray(case.shape.bounds), 20_000, seed=5)
    with threads_for(10**9, 1):
        one = case.shape.cross(lines)
    with threads_for(10**9, 2):
        two = case.shape.cross(lines)
    for name in ("offsets", "t", "cosine", "weight", "leaf"):
        assert np.array_equal(getattr(one, name), getattr(two, name))


@by_case
def test_lines_find_area_and_volume(case):
    lines = lines_round(np.asarray(case.shape.bounds), 60_000, seed=6)
    found = case.shape.cross(lines)
    hits = np.bincount(found.lines, minlength=len(lines)) * lines.weights * len(lines) / np.pi
    inside = np.bincount(found.lines, np.sign(found.cosine) * found.t, len(lines)) * lines.weights * len(lines)
    for values, true in ((hits, case.shape.area), (inside / (2.0 * np.pi), case.shape.volume)):
        error = values.std() / np.sqrt(len(lines))
        assert abs(values.mean() - true) < 4.5 * error
        assert error < (0.25 if case.name in ("rod", "wire torus") else 0.02) * true


@by_sampled
def test_samples_lie_on_the_surface_with_its_normals(case):
    elements = case.shape.patches(2048)
    assert len(elements) == 2048
    assert np.abs(case.distance(elements.points)).max() <= 1e-13 * case.size
    assert np.abs(np.linalg.norm(elements.normals, axis=1) - 1.0).max() <= 1e-14
    clear = off_edges(case, elements.points, np.eye(4))
    assert clear.mean() > 0.5
    agree = (elements.normals * outward(case, np.eye(4), elements.points)).sum(axis=1)
    assert agree[clear].min() > 1.0 - 1e-6
    assert elements.areas.min() > 0.0
    if np.ptp(elements.areas) == 0.0:
        assert elements.areas.sum() == pytest.approx(case.shape.area, rel=1e-13)
    else:  # the areas are those of the map, and right on average
        assert elements.areas.sum() == pytest.approx(case.shape.area, rel=5e-4)


@by_sampled
def test_samples_are_even(case):
    """Against the divergence theorem, which knows nothing of areas, and against hits of lines, which are even too."""
    elements = case.shape.patches(65_536)
    volume = (elements.points * elements.normals).sum(axis=1) @ elements.areas / 3.0
    thin = case.name in ("rod", "wire torus")
    assert volume == pytest.approx(case.shape.volume, rel=2e-3 if thin else 1e-4)
    assert np.abs(elements.areas @ elements.normals).max() <= 2e-4 * case.shape.area
    lines = lines_round(np.asarray(case.shape.bounds), 400_000 if thin else 100_000, seed=7)
    hits = places(lines, case.shape.cross(lines))
    for moment in (lambda p: p[:, 0] ** 2, lambda p: p[:, 2] ** 2, lambda p: np.abs(p[:, 0]) * p[:, 1] ** 2):
        by_elements = moment(elements.points) @ elements.areas / case.shape.area
        values = moment(hits)
        error = 2.5 * values.std() / np.sqrt(len(values))  # hits of one line belong together
        assert abs(values.mean() - by_elements) < 3.0 * error


@by_sampled
def test_samples_of_no_and_of_one_place(case):
    for n in (0, 1, 2, 7):
        elements = case.shape._sample(square_points(n))
        assert elements.points.shape == elements.normals.shape == (n, 3)
        assert elements.areas.shape == (n,)
    corners = np.array([[0.0, 0.0], [0.0, 1.0 - 2.0**-53], [1.0 - 2.0**-53, 0.0], [1.0 - 2.0**-53] * 2])
    elements = case.shape._sample(corners)
    assert np.isfinite(elements.points).all()
    assert np.abs(case.distance(elements.points)).max() <= 1e-12 * case.size
    assert np.isfinite(elements.normals).all()


@by_placement
@by_sampled
def test_bounds_are_tight(case, placement):
    shape, matrix = placed(case, placement)
    points = case.shape.patches(40_000).points @ matrix[:3, :3].T + matrix[:3, 3]
    low, high = np.asarray(shape.bounds)
    extent = (high - low).max()
    assert (points >= low - 1e-12 * extent).all()
    assert (points <= high + 1e-12 * extent).all()
    assert np.abs(points.min(axis=0) - low).max() <= 0.03 * extent
    assert np.abs(points.max(axis=0) - high).max() <= 0.03 * extent


@by_case
def test_copies_are_equal_solids(case):
    for twin in (pickle.loads(pickle.dumps(case.shape)), copy.copy(case.shape)):
        assert twin.area == case.shape.area
        assert repr(twin) == repr(case.shape)
    assert case.shape.contains([[100.0, 0.0, 0.0]]).tolist() == [False]
    with pytest.raises(AttributeError):
        case.shape.bounds = None


@by_case
def test_points_inside_are_told_from_points_outside(case):
    low, high = np.asarray(case.shape.bounds)
    points = np.random.default_rng(8).uniform(low, high, (3000, 3))
    level = case.distance(points)
    clear = np.abs(level) > 1e-9
    assert np.array_equal(case.shape.contains(points)[clear], level[clear] < 0.0)


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf, "large", None, 1e200, 1e-200])
def test_bad_sizes(size):
    makers = [
        lambda: surfel.Box(size),
        lambda: surfel.Box((1.0, size, 1.0)),
        lambda: surfel.Sphere(size),
        lambda: surfel.Ellipsoid((1.0, 1.0, size)),
        lambda: surfel.Cylinder(size, 1.0),
        lambda: surfel.Cylinder(1.0, size),
        lambda: surfel.Cone(1.0, 1.0, size),
        lambda: surfel.Cone(size, 0.0, 1.0),
        lambda: surfel.Torus(2.0, size),
        lambda: surfel.Torus(size, 1.0),
        lambda: surfel.Cyclide(3.0, 2.9, size),
        lambda: surfel.Cyclide(3.0, size, 1.0),
        lambda: surfel.Cyclide(size, 2.9, 1.0),
    ]
    for make in makers:
        with pytest.raises(InputError):
            make()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: surfel.Box((1.0, 2.0)), "one number or three"),
        (lambda: surfel.Ellipsoid((1.0, 2.0, 3.0, 4.0)), "one number or three"),
        (lambda: surfel.Cone(0.0, 0.0, 1.0), "both"),
        (lambda: surfel.Cone(-1.0, 0.0, 1.0), "negative"),
        (lambda: surfel.Torus(1.0, 1.0), "smaller than major"),
        (lambda: surfel.Torus(1.0, 2.0), "smaller than major"),
        (lambda: surfel.Cyclide(1.0, 2.0, 0.5), "larger than a"),
        (lambda: surfel.Cyclide(3.0, 2.0, 2.0), "between c"),
        (lambda: surfel.Cyclide(3.0, 2.9, 3.0), "between c"),
        (lambda: surfel.Sphere((1.0, 2.0, 3.0)), "number"),
    ],
)
def test_sizes_that_do_not_fit(make, said):
    with pytest.raises(InputError, match=said):
        make()


def test_sizes_of_any_unit():
    for unit in (1e-90, 1e-9, 1e9, 1e90):
        for shape in (surfel.Torus(2.0 * unit, unit), surfel.Cyclide(3.0 * unit, 2.9 * unit, unit)):
            lines = lines_round(np.asarray(shape.bounds), 500)
            counts = shape.cross(lines).counts
            same = type(shape)(*(value / unit for value in (getattr(shape, f) for f in shape.__dataclass_fields__)))
            near = Lines(lines.origins / unit, lines.directions, lines.weights)
            assert (counts == same.cross(near).counts).mean() > 0.99
