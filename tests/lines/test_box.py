"""The oriented box holds its points, is small, and moves with them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surfel.core.errors import InputError
from surfel.lines.enclosing import OrientedBox, oriented_box

RNG = np.random.default_rng(7)


def turned(seed):
    return Rotation.random(random_state=seed).as_matrix()


def upright_surface(points):
    a, b, c = np.ptp(points, axis=0)
    return 2.0 * (a * b + b * c + c * a)


def clouds():
    normal = RNG.normal(size=(20_000, 3))
    yield "normal", normal
    yield "few", normal[:5]
    yield "stretched", normal * [5.0, 2.0, 0.5] @ turned(1)
    yield "sphere", normal / np.linalg.norm(normal, axis=1, keepdims=True)
    yield "cube", RNG.random((20_000, 3))
    yield "turned cube", RNG.random((20_000, 3)) @ turned(2)
    yield "plane", normal * [3.0, 1.0, 0.0] @ turned(3)
    yield "line", normal * [1.0, 0.0, 0.0] @ turned(4)
    yield "upright line", normal * [0.0, 1.0, 0.0]
    yield "point", np.full((10, 3), 4.0)
    yield "two points", normal[:2]
    yield "far away", normal + 1e6
    yield "huge", normal * 1e300
    yield "tiny", normal * 1e-300
    yield "doubled", np.repeat(normal[:100], 20, axis=0)


@pytest.mark.parametrize(("name", "points"), list(clouds()))
def test_holds_all_points_and_is_never_worse_than_upright(name, points):
    box = oriented_box(points)
    size = max(np.abs(points - points.mean(axis=0)).max(), 1e-16 * np.abs(points).max())
    local = (points - box.centre) @ box.axes.T
    assert np.abs(box.axes @ box.axes.T - np.eye(3)).max() < 1e-14 and np.linalg.det(box.axes) > 0.99
    assert (np.abs(local) <= box.half + 1e-12 * size + 4e-16 * np.abs(points).max()).all()
    assert (np.diff(box.half) <= 1e-12 * size).all()
    with np.errstate(over="ignore"):
        scaled = OrientedBox(box.centre / size, box.axes, box.half / size) if size else box
    assert scaled.surface <= upright_surface(points / (size or 1.0)) * (1.0 + 1e-9)


@pytest.mark.parametrize("number", [0, 500, 100_000])
@pytest.mark.parametrize("half", [(3.0, 2.0, 1.0), (1.0, 1.0, 1.0), (10.0, 1.0, 1.0), (2.0, 1.0, 0.0)])
def test_finds_a_turned_box_again(number, half):
    true = OrientedBox(np.array([1.0, -2.0, 3.0]), turned(9), np.array(half))
    inside = true.centre + (RNG.uniform(-1.0, 1.0, (number, 3)) * half) @ true.axes
    box = oriented_box(np.vstack([true.corners, inside]))
    assert np.allclose(box.half, true.half, atol=1e-12)
    assert np.allclose(box.centre, true.centre, atol=1e-12)


@pytest.mark.parametrize("number", [4, 6, 10, 30, 200, 3000])
def test_no_random_box_is_much_smaller(number):
    points = RNG.normal(size=(number, 3)) * [3.0, 2.0, 1.0]
    surface = oriented_box(points).surface
    least = min(upright_surface(points @ turn.T) for turn in Rotation.random(2000, random_state=1).as_matrix())
    assert surface <= least * 1.001


@pytest.mark.parametrize("number", [6, 50, 5000, 60_000])
def test_permutation_and_rigid_motion(number):
    points = RNG.normal(size=(number, 3)) * [3.0, 2.0, 1.0] @ turned(1)
    box = oriented_box(points)
    for seed in range(3):
        other = oriented_box(np.random.default_rng(seed).permutation(points))
        assert np.allclose(other.half, box.half, atol=1e-12) and np.allclose(other.centre, box.centre, atol=1e-12)
        turn, move = turned(seed), np.array([0.1, -0.7, 0.4])
        moved = oriented_box(points @ turn.T + move)
        assert np.allclose(moved.half, box.half, atol=1e-12)
        assert np.allclose(moved.centre, turn @ box.centre + move, atol=1e-12)
        assert np.allclose(np.abs(moved.axes @ turn @ box.axes.T), np.eye(3), atol=1e-10)


def test_the_same_points_give_the_same_bits():
    points = RNG.normal(size=(60_000, 3))
    first, second = oriented_box(points), oriented_box(points.copy())
    assert all((a == b).all() for a, b in zip(first, second, strict=True))


def test_surface_volume_corners_and_growth():
    box = OrientedBox(np.zeros(3), np.eye(3), np.array([1.0, 2.0, 3.0]))
    assert box.surface == 88.0 and box.volume == 48.0
    assert np.abs(box.corners).tolist() == [[1.0, 2.0, 3.0]] * 8
    assert box.grown(1.0).half.tolist() == [2.0, 3.0, 4.0]


@pytest.mark.parametrize("points", [[], [(0, 0)], [(0, 0, np.nan)]])
def test_bad_points(points):
    with pytest.raises(InputError):
        oriented_box(points)
