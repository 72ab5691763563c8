"""Surfels: copied at the door, read-only, sliced, joined, mapped, pickled, shared by threads."""

from __future__ import annotations

import pickle
import threading

import numpy as np
import pytest

import shapes_with_truth as truth
import surfel
from surfel import InputError, Surfels


@pytest.fixture
def full():
    ring = truth.torus(200, 1)
    rng = np.random.default_rng(0)
    return Surfels(
        ring.points,
        normals=3.0 * ring.normals,
        radii=rng.random(200),
        colors=rng.integers(0, 255, (200, 3), dtype=np.uint8),
        attributes={"intensity": rng.random(200).astype(np.float32), "class": np.arange(200, dtype=np.uint8)},
        solid=True,
        provenance={"format": "test"},
    )


def _arrays(cloud):
    return [cloud.points, cloud.normals, cloud.radii, cloud.colors, *cloud.attributes.values()]


def test_arrays_are_copied_and_read_only(full):
    mine = np.zeros((5, 3))
    cloud = Surfels(mine, normals=mine, radii=mine[:, 0], colors=mine, attributes={"a": mine})
    mine += 7.0
    assert (
        not cloud.points.any() and not cloud.radii.any() and not cloud.colors.any() and not cloud.attributes["a"].any()
    )
    for array in _arrays(full):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    for name in ("points", "normals", "solid", "attributes", "surface"):
        with pytest.raises(AttributeError):
            setattr(full, name, None)
    with pytest.raises(TypeError):
        full.attributes["more"] = np.zeros(200)
    assert mine.flags.writeable


def test_normals_have_unit_length_or_are_zero_where_unknown():
    normals = np.array([[0, 0, 2.0], [0, 0, 0], [np.nan, 0, 1], [1e-200, 1e-200, 0], [1e200, 0, 1e200], [np.inf, 0, 0]])
    kept = Surfels(np.zeros((6, 3)), normals=normals).normals
    np.testing.assert_allclose(np.linalg.norm(kept, axis=1), [1, 0, 0, 1, 1, 0], atol=1e-15)
    assert kept[0].tolist() == [0.0, 0.0, 1.0]


def test_rows_that_are_not_finite_are_dropped_everywhere_and_counted(full):
    points = full.points.copy()
    points[3, 0], points[9, 2], points[10] = np.nan, np.inf, -np.inf
    cloud = Surfels(points, full.normals, full.radii, full.colors, full.attributes)
    keep = np.delete(np.arange(200), [3, 9, 10])
    assert len(cloud) == 197 and cloud.dropped == 3
    for ours, theirs in zip(_arrays(cloud), _arrays(full), strict=True):
        np.testing.assert_array_equal(ours, theirs[keep])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"normals": np.zeros((3, 3))}, r"normals must have shape \(4, 3\)"),
        ({"normals": "up"}, "normals"),
        ({"radii": [1.0, 2.0]}, "radii"),
        ({"radii": [1.0, 2.0, -1.0, 0.0]}, "radii must be finite and not negative"),
        ({"radii": [1.0, 2.0, np.nan, 0.0]}, "radii"),
        ({"colors": np.zeros((4, 2))}, r"colors must have shape \(4, 3\) or \(4, 4\)"),
        ({"colors": np.zeros(4)}, "colors"),
        ({"attributes": {"time": np.zeros(3)}}, "attribute 'time' must have one row for each of the 4 points"),
        ({"attributes": {"name": np.array([None] * 4)}}, "attribute 'name'"),
        ({"solid": "yes"}, "solid must be True, False or None"),
        ({"solid": 1}, "solid must be True, False or None"),
        ({"solid": np.zeros(2)}, "solid must be True, False or None"),
    ],
)
def test_what_does_not_fit_is_refused(options, says):
    with pytest.raises(InputError, match=says):
        Surfels(np.zeros((4, 3)), **options)


def test_the_boolean_of_numpy_says_solid_too():
    assert Surfels(np.zeros((1, 3)), solid=np.bool_(False)).solid is False
    assert Surfels(np.zeros((1, 3)), solid=np.bool_(True)).solid is True
    assert surfel.measure(Surfels(truth.sphere(500).points, solid=np.bool_(False)), lines=64).volume is None


@pytest.mark.parametrize(
    "rows",
    [
        slice(10, 50, 3),
        np.arange(200) % 2 == 0,
        np.array([5, 3, 3]),
        [1, 2],
        slice(0, 0),
        -1,
        0,
        199,
        np.int32(7),
        -200,
    ],
)
def test_slices_take_everything_along(full, rows):
    part = full[rows]
    expected = np.atleast_1d(np.arange(200)[rows])
    for ours, theirs in zip(_arrays(part), _arrays(full), strict=True):
        np.testing.assert_array_equal(ours, theirs[expected])
    assert part.solid is True and part.provenance == full.provenance


@pytest.mark.parametrize("row", [200, -201, 10**12])
def test_rows_that_are_not_there_are_an_index_error(full, row):
    with pytest.raises(IndexError):
        full[row]


def test_a_loop_over_a_cloud_ends(full):
    assert sum(len(one) for one in full) == 200


def test_joining_keeps_what_both_know(full):
    other = Surfels(np.ones((2, 3)), normals=np.ones((2, 3)), attributes={"intensity": [1.0, 2.0]})
    both = full + other
    assert len(both) == 202
    np.testing.assert_array_equal(both.points[200:], other.points)
    np.testing.assert_allclose(both.normals, np.concatenate([full.normals, other.normals]), atol=1e-15)
    assert both.radii is None and both.colors is None and set(both.attributes) == {"intensity"}
    assert both.solid is None
    assert (full + full).solid is True
    with pytest.raises(TypeError):
        full + np.zeros((2, 3))


@pytest.mark.parametrize(
    ("mine", "other", "kind", "joined"),
    [
        (np.uint8([[0, 51, 255]]), np.uint8([[1, 2, 3]]), np.uint8, [[0, 51, 255], [1, 2, 3]]),
        (np.float32([[0, 0.5, 1]]), np.float64([[0.25, 0, 1]]), np.float64, [[0, 0.5, 1], [0.25, 0, 1]]),
        (np.uint8([[0, 51, 255]]), np.int64([[1, 2, 3]]), np.int64, [[0, 51, 255], [1, 2, 3]]),
        (np.uint8([[0, 51, 255]]), np.float32([[0, 0.5, 1]]), np.float64, [[0, 0.2, 1], [0, 0.5, 1]]),
        (np.uint16([[0, 13107, 65535]]), np.uint8([[0, 51, 255]]), np.float64, [[0, 0.2, 1], [0, 0.2, 1]]),
    ],
)
def test_joined_colors_are_of_one_scale(mine, other, kind, joined):
    a, b = Surfels(np.zeros((1, 3)), colors=mine), Surfels(np.ones((1, 3)), colors=other)
    assert (a + b).colors.dtype == kind
    np.testing.assert_allclose((a + b).colors, joined)
    np.testing.assert_allclose((b + a).colors, joined[::-1])


def test_text_and_numbers_are_not_joined():
    a = Surfels(np.zeros((1, 3)), attributes={"kind": ["roof"], "pass": [1]})
    b = Surfels(np.ones((1, 3)), attributes={"kind": [2], "pass": [2]})
    assert set((a + b).attributes) == {"pass"} == set((b + a).attributes)


def test_text_says_what_is_known(full):
    assert repr(full) == "Surfels(200 points, normals, radii, colors, intensity, class)"
    assert repr(Surfels(np.zeros((3, 3)))) == "Surfels(3 points)"


def _affine(linear, shift=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, shift
    return matrix


@pytest.mark.parametrize(
    ("linear", "factor"),
    [(truth.rotation(1), 1.0), (2.5 * np.eye(3), 2.5), (np.diag([-1.0, 1.0, 1.0]), 1.0), (-truth.rotation(2), 1.0)],
)
def test_similar_maps_move_points_turn_normals_and_scale_radii(full, linear, factor):
    moved = full.transformed(_affine(linear, [1.0, 2.0, 3.0]))
    np.testing.assert_allclose(moved.points, full.points @ np.asarray(linear).T + [1.0, 2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(moved.normals, full.normals @ np.asarray(linear).T / factor, atol=1e-12)
    np.testing.assert_allclose(moved.radii, full.radii * factor)
    assert moved.solid is True and set(moved.attributes) == set(full.attributes)


def test_normals_stay_normal_and_outward_under_any_affine_map():
    ball = truth.sphere(500, 2)
    linear = np.array([[1.0, 0.7, 0.0], [0.0, -2.0, 0.3], [0.2, 0.0, 0.5]])
    moved = Surfels(ball.points, normals=ball.normals).transformed(_affine(linear))
    inner = moved.points @ np.linalg.inv(linear).T
    expected = inner @ np.linalg.inv(linear)  # the gradient of |x|^2 / 2 carried along
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(moved.normals, expected, atol=1e-12)
    assert (np.einsum("ij,ij->i", moved.normals, moved.points) > 0).all()


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        (_affine(np.diag([1.0, 1.0, 0.0])), "singular"),
        (_affine(np.zeros((3, 3))), "singular"),
        (_affine(np.eye(3), [np.nan, 0, 0]), "finite"),
        (np.eye(3), r"shape \(4, 4\)"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
        ("turn", "matrix"),
    ],
)
def test_maps_that_are_no_maps_are_refused(full, matrix, says):
    with pytest.raises(InputError, match=says):
        full.transformed(matrix)


def test_cropping_keeps_what_lies_inside_a_solid(full):
    box = surfel.Mesh(*truth.box_mesh((4.0, 4.0, 0.3)))
    part = full.cropped(box)
    inside = np.abs(full.points[:, 2]) < 0.15
    np.testing.assert_array_equal(part.points, full.points[inside])
    np.testing.assert_array_equal(part.colors, full.colors[inside])
    assert 0 < len(part) < 200


def test_bounds():
    points = np.array([[0.0, 5.0, -1.0], [2.0, 3.0, 4.0]])
    assert Surfels(points).bounds.tolist() == [[0.0, 3.0, -1.0], [2.0, 5.0, 4.0]]
    with pytest.raises(InputError, match="empty"):
        Surfels(np.empty((0, 3))).bounds


def test_a_pickled_cloud_is_the_same_and_still_read_only(full):
    area = full.patches().areas.sum()
    small = len(pickle.dumps(Surfels(full.points)))
    used = Surfels(full.points)
    used.patches()
    assert len(pickle.dumps(used)) == small  # what was learnt is not carried along
    back = pickle.loads(pickle.dumps(full))
    for ours, theirs in zip(_arrays(back), _arrays(full), strict=True):
        np.testing.assert_array_equal(ours, theirs)
        assert not ours.flags.writeable and ours.dtype == theirs.dtype
    assert (back.solid, dict(back.provenance), back.dropped) == (True, {"format": "test"}, 0)
    assert back.patches().areas.sum() == area


def test_the_first_use_from_many_threads_computes_once(monkeypatch):
    from surfel.shapes import cloud_surface

    calls = []
    original = cloud_surface.local_patches
    monkeypatch.setattr(cloud_surface, "local_patches", lambda *a, **k: (calls.append(1), original(*a, **k))[1])
    cloud = Surfels(truth.torus(4000, 2).points)
    found, errors = [], []
    ready = threading.Barrier(6)

    def work():
        try:
            ready.wait(30)
            found.append(surfel.measure(cloud, lines=2048).to_dict())
        except BaseException as error:
            errors.append(error)

    workers = [threading.Thread(target=work) for _ in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(120)
    assert not errors and len(calls) == 1
    assert len({m["area"]["value"] for m in found}) == 1 and len({m["volume"]["value"] for m in found}) == 1


def test_with_solid_says_it_anew(full):
    assert full.with_solid(None).solid is None and full.with_solid(False).solid is False and full.solid is True
