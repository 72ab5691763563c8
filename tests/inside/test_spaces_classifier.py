"""The classifier against solids whose inside is known, and against itself moved, flipped, opened, threaded."""

from __future__ import annotations

import pickle

import numba
import numpy as np
import pytest

from surfel.core.affine import rotation, translation
from surfel.core.errors import InputError
from surfel.inside.classes import IN, ON_OPPOSED, ON_SAME, OUT
from surfel.inside.classify import Classifier
from surfel.inside.decision import SHEETS
from surfel.inside.operand import Operand

Floats = np.ndarray
SIZE = np.array([0.9, 0.7, 0.6])


def sphere(n: int, seed: int = 0) -> tuple[Floats, Floats]:
    p = np.random.default_rng(seed).standard_normal((n, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    return p, p.copy()


def box(n: int, size: Floats = SIZE, seed: int = 0) -> tuple[Floats, Floats]:
    """Return random points of a box about the origin, and their normals."""
    rng = np.random.default_rng(seed)
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis, side = rng.choice(3, n, p=faces / faces.sum()), rng.choice([-1.0, 1.0], n)
    points, normals = rng.uniform(-0.5, 0.5, (n, 3)) * size, np.zeros((n, 3))
    points[np.arange(n), axis] = 0.5 * side * size[axis]
    normals[np.arange(n), axis] = side
    return points, normals


def in_box(q: Floats, size: Floats = SIZE) -> Floats:
    return (np.abs(q) < 0.5 * size).all(axis=1)


def in_sphere(q: Floats) -> Floats:
    return np.linalg.norm(q, axis=1) < 1.0


def places(n: int, reach: float = 1.4, seed: int = 9) -> Floats:
    return np.random.default_rng(seed).uniform(-reach, reach, (n, 3))


def motion() -> Floats:
    return translation([0.21, -0.13, 0.17]) @ rotation([1.0, 0.4, 0.2], 63.0)


def test_smooth_solid() -> None:
    classifier = Classifier(Operand.of(*sphere(20_000)))
    q = places(100_000)
    found = classifier.classify(q)
    assert (found.inside != in_sphere(q)).mean() <= 0.0003
    assert classifier.decision.judge == SHEETS and len(found.judged) < 0.1 * len(q)


@pytest.mark.parametrize("slabs", [True, False])
def test_sharp_edges(slabs: bool) -> None:
    points, normals = box(30_000)
    spacing = np.sqrt(2.0 * (0.63 + 0.54 + 0.42) / len(points))
    rng = np.random.default_rng(2)
    edge = np.stack([np.full(20_000, 0.45), np.full(20_000, 0.35), rng.uniform(-0.28, 0.28, 20_000)], axis=1)
    q = edge + rng.normal(0.0, 0.7 * spacing, edge.shape)
    assert (Classifier(Operand.of(points, normals), slabs=slabs).classify(q).inside != in_box(q)).mean() <= 0.002


def test_a_hollow_in_a_box() -> None:
    points, normals = box(30_000)
    room = Operand.of(np.concatenate([points, 0.5 * points[:8000]]), np.concatenate([normals, -normals[:8000]]))
    q = places(50_000, 0.6)
    assert (Classifier(room).classify(q).inside != (in_box(q) & ~in_box(2.0 * q))).mean() <= 0.001


@pytest.mark.parametrize("turn", [0.0, 40.0])
def test_thin_plate(turn: float) -> None:
    size = np.array([0.9, 0.7, 0.012])
    points, normals = box(30_000, size)
    r = rotation([1.0, 0.3, 0.5], turn)[:3, :3]
    classifier = Classifier(Operand.of(points @ r.T, normals @ r.T))
    q = places(60_000, 0.5)
    q[:30_000, 2] *= 0.03
    assert not classifier.leaky
    assert (classifier.classify(q @ r.T).inside != in_box(q, size)).mean() <= 0.0002


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_scattered_flips_are_turned(share: float) -> None:
    points, normals = sphere(20_000)
    flip = np.random.default_rng(5).random(len(points)) < share
    normals[flip] *= -1.0
    classifier = Classifier(Operand.of(points, normals))
    q = places(50_000)
    assert (classifier.classify(q).inside != in_sphere(q)).mean() <= 0.0005
    assert (classifier.flipped != flip[classifier.operand.order]).mean() < 0.01


def test_a_flipped_patch_is_turned() -> None:
    points, normals = box(30_000)
    patch = np.linalg.norm(points - points[0], axis=1) < 0.25
    normals[patch] *= -1.0
    classifier = Classifier(Operand.of(points, normals))
    q = places(50_000, 0.6)
    assert (classifier.classify(q).inside != in_box(q)).mean() <= 0.003
    assert classifier.flipped.mean() == pytest.approx(patch.mean(), abs=0.005)


def test_normals_that_all_point_inward_are_turned() -> None:
    points, normals = sphere(5000)
    classifier = Classifier(Operand.of(points, -normals))
    assert classifier.flipped.all()
    assert classifier.classify([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]]).kind.tolist() == [IN, OUT]


def test_uneven_density() -> None:
    points, normals = sphere(120_000)
    keep = (points[:, 0] > 0.0) | (np.random.default_rng(4).random(len(points)) < 1.0 / 30.0)
    q = places(50_000)
    classifier = Classifier(Operand.of(points[keep], normals[keep]))
    assert not classifier.leaky
    assert (classifier.classify(q).inside != in_sphere(q)).mean() <= 0.001


def test_an_open_surface_leaks_and_is_answered() -> None:
    points, normals = sphere(20_000)
    keep = points[:, 2] > -0.9
    classifier = Classifier(Operand.of(points[keep], normals[keep]))
    q = places(50_000)
    wrong = classifier.classify(q).inside != in_sphere(q)
    assert classifier.leaky and 0.0 < classifier.conflict < 0.03
    assert wrong[q[:, 2] > -0.85].mean() <= 0.0005


def test_a_closed_surface_does_not_leak() -> None:
    classifier = Classifier(Operand.of(*box(5000)))
    assert not classifier.leaky and classifier.conflict < 0.01 and not classifier.flipped.any()


def test_coincident_surfaces_are_on() -> None:
    cloud = Operand.of(*box(20_000))
    classifier = Classifier(cloud)
    assert (classifier.classify(cloud).kind == ON_SAME).all()
    assert (classifier.classify(cloud.points + cloud.origin, -cloud.normals).kind == ON_OPPOSED).all()


def test_another_sample_of_the_same_surface_is_on() -> None:
    classifier = Classifier(Operand.of(*sphere(20_000, 0)))
    points, normals = sphere(20_000, 1)
    assert (classifier.classify(points, normals).kind == ON_SAME).mean() > 0.99
    assert not classifier.classify(points).on.any()  # nothing is on without normals


def test_boxes_that_touch_are_on_at_their_common_face_alone() -> None:
    points, normals = box(20_000)
    classifier = Classifier(Operand.of(points, normals))
    moved = points + [0.9, 0.1, 0.0]
    kind = classifier.classify(moved, normals).kind
    face = normals[:, 0] == -1.0
    assert (kind[face & (moved[:, 1] < 0.35)] == ON_OPPOSED).mean() > 0.99
    assert not (kind[face & (moved[:, 1] > 0.37)] >= ON_SAME).any()
    assert (kind[moved[:, 0] > 0.47] == OUT).all()


def test_crossing_surfaces_are_hardly_ever_on() -> None:
    points, normals = sphere(20_000, 1)
    found = Classifier(Operand.of(*sphere(20_000))).classify(points + [0.8, 0.0, 0.0], normals)
    assert found.on.mean() < 0.001


def test_disjoint_contained_and_empty() -> None:
    classifier = Classifier(Operand.of(*sphere(5000)))
    points, normals = sphere(2000, 1)
    nothing = Operand.of(np.empty((0, 3)), np.empty((0, 3)))
    one = Classifier(Operand.of([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]]))
    assert (classifier.classify(points + [5.0, 0.0, 0.0]).kind == OUT).all()
    assert (classifier.classify(0.5 * points, normals).kind == IN).all()
    assert (Classifier(nothing).classify(points).kind == OUT).all()
    assert len(classifier.classify(nothing).kind) == 0
    assert one.classify([[0.0, 0.0, 9.0]]).kind.tolist() == [OUT]


def test_a_moving_cloud_gets_the_answers_of_its_places() -> None:
    classifier = Classifier(Operand.of(*sphere(10_000)))
    other, pose = Operand.of(*box(20_000)), motion()
    world = (other.points + other.origin) @ pose[:3, :3].T + pose[:3, 3]
    by_blocks = classifier.classify(other, pose=pose)
    one_by_one = classifier.classify(world, other.normals @ pose[:3, :3].T)
    assert (by_blocks.kind == one_by_one.kind).all() and (by_blocks.near == one_by_one.near).all()
    assert (by_blocks.inside != in_sphere(world)).mean() <= 0.001


def test_near_reaches_as_far_as_asked() -> None:
    classifier = Classifier(Operand.of(*sphere(10_000)))
    q = places(20_000)
    gap = np.abs(np.linalg.norm(q, axis=1) - 1.0)
    found = classifier.classify(q, reach=0.2)
    cloud = Operand.of(q, np.ones_like(q) / np.sqrt(3.0))
    assert found.near[gap < 0.2].all() and not found.near[gap > 0.6].any()
    assert (classifier.classify(cloud, reach=0.2).near == found.near[cloud.order]).all()


def test_rigid_motion_of_everything_changes_little() -> None:
    points, normals = box(10_000)
    r, t = motion()[:3, :3], motion()[:3, 3] + 1e4
    q = places(30_000, 0.6)
    here = Classifier(Operand.of(points, normals)).classify(q).inside
    there = Classifier(Operand.of(points @ r.T + t, normals @ r.T)).classify(q @ r.T + t).inside
    assert (here != there).mean() < 0.001


def test_order_of_the_points_does_not_matter() -> None:
    points, normals = box(10_000)
    mixed = np.random.default_rng(0).permutation(len(points))
    q = places(30_000, 0.6)
    a = Classifier(Operand.of(points, normals)).classify(q)
    b = Classifier(Operand.of(points[mixed], normals[mixed])).classify(q)
    assert (a.kind == b.kind).all()


def test_same_bits_on_one_and_two_threads() -> None:
    before, found = numba.get_num_threads(), []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        classifier = Classifier(Operand.of(*box(60_000)))
        answer = classifier.classify(Operand.of(*sphere(60_000)), pose=motion())
        assert classifier._coloured is not None
        grid = classifier._coloured.grid
        found.append((answer.kind, answer.near, answer.value, grid.border, grid.inside, classifier._slabs.planes))
    numba.set_num_threads(before)
    for a, b in zip(*found, strict=True):
        assert a.tobytes() == b.tobytes()


def test_clouds_a_million_spacings_apart() -> None:
    points, normals = box(20_000)
    classifier = Classifier(Operand.of(*sphere(20_000)))
    found = classifier.classify(Operand.of(points, normals), pose=translation([1e4, 3e3, 0.0]))
    assert (found.kind == OUT).all() and not len(found.judged)
    pair = Operand.of(np.concatenate([points, points + 1e4]), np.concatenate([normals, normals]))
    both = Classifier(pair, judge=SHEETS).classify([[0.0, 0.0, 0.3], [1e4, 1e4, 1e4 + 0.29], [5e3, 5e3, 5e3]])
    assert both.inside.tolist() == [False, True, False]


def test_refusals() -> None:
    cloud = Operand.of(*sphere(500))
    classifier = Classifier(cloud)
    with pytest.raises(InputError, match="judge must be one of"):
        Classifier(cloud, judge="guess")
    with pytest.raises(InputError, match="rigid"):
        classifier.classify(cloud, pose=np.diag([2.0, 2.0, 2.0, 1.0]))
    with pytest.raises(InputError, match="normals must be left out"):
        classifier.classify(cloud, cloud.normals)
    with pytest.raises(InputError, match="reach"):
        classifier.classify(cloud, reach=-1.0)
    with pytest.raises(InputError, match="finite"):
        classifier.classify([[np.nan, 0.0, 0.0]])
    with pytest.raises(InputError, match="areas must be finite and not negative"):
        Operand.of(np.zeros((1, 3)), np.zeros((1, 3)), areas=[-1.0])
    with pytest.raises(InputError, match="normals must be finite"):
        Operand.of(np.zeros((1, 3)), np.full((1, 3), np.nan))


def test_a_classifier_can_be_pickled() -> None:
    classifier = Classifier(Operand.of(*sphere(2000)))
    q = places(2000)
    again = pickle.loads(pickle.dumps(classifier))
    assert (again.classify(q).kind == classifier.classify(q).kind).all()
