"""Every judge: right away from the surface, the same after a motion, on any number of threads, and on odd input."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import even_sphere, rotation, sphere
from surfel._numba import threads_for
from surfel.core.errors import InputError
from surfel.inside.judges import NAMES, choose, named
from surfel.inside.operand import Operand

FAST = tuple(name for name in NAMES if name != "brute")


@pytest.fixture(scope="module")
def ball() -> Operand:
    cloud = sphere(2500, seed=1)
    return Operand.of(cloud.points, cloud.normals)


@pytest.fixture(scope="module")
def places() -> np.ndarray:
    rng = np.random.default_rng(2)
    direction = rng.standard_normal((3000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * rng.uniform(0.0, 2.0, (3000, 1))


@pytest.mark.parametrize("name", NAMES)
def test_places_away_from_a_sphere_are_judged_right(name, ball, places):
    distance = np.linalg.norm(places, axis=1)
    found = named(name)(ball, places)
    clear = np.abs(distance - 1.0) > 2.0 * ball.spacing
    assert (found.inside == (distance < 1.0))[clear].all()
    assert (found.inside == (found.value < 0.0)).all()
    assert found.certain[clear].mean() > 0.9
    assert (found.inside == (distance < 1.0))[found.certain].mean() > 0.99
    assert found.inside.shape == found.value.shape == found.certain.shape == (3000,)


@pytest.mark.parametrize("name", FAST)
def test_values_of_distance_judges_are_distances_near_the_surface(name, ball):
    if name in ("winding", "indicator"):
        pytest.skip("its value is no distance")
    off = np.random.default_rng(3).uniform(-0.08, 0.08, 500)
    place = even_sphere(500).points * (1.0 + off[:, None])
    found = named(name)(ball, place, skip=False)
    assert np.abs(found.value - off).max() < 0.02


@pytest.mark.parametrize("name", FAST)
def test_a_rigid_motion_changes_nothing_but_rounding(name, ball, places):
    cloud = sphere(2500, seed=1)
    turn, shift = rotation(4), np.array([100.0, -30.0, 7.0])
    moved = Operand.of(cloud.points @ turn.T + shift, cloud.normals @ turn.T)
    here, there = named(name)(ball, places).inside, named(name)(moved, places @ turn.T + shift).inside
    assert (here == there).mean() > (0.98 if name == "indicator" else 0.997)  # a grid turns not with the cloud


@pytest.mark.parametrize("name", FAST)
def test_the_order_of_the_points_changes_nothing_but_ties(name, ball, places):
    cloud = sphere(2500, seed=1)
    mixed = np.random.default_rng(5).permutation(2500)
    other = Operand.of(cloud.points[mixed], cloud.normals[mixed])
    assert (named(name)(ball, places).inside == named(name)(other, places).inside).all()


@pytest.mark.parametrize("name", FAST)
def test_the_order_of_the_places_changes_nothing(name, ball, places):
    mixed = np.random.default_rng(6).permutation(len(places))
    assert (named(name)(ball, places).inside[mixed] == named(name)(ball, places[mixed]).inside).mean() > 0.999


@pytest.mark.parametrize("name", NAMES)
def test_one_and_two_threads_give_the_same_bits(name):
    cloud = sphere(4000, seed=7)
    place = np.random.default_rng(8).uniform(-1.5, 1.5, (60_000 if name != "brute" else 2000, 3))
    found = []
    for threads in (1, 2):
        with threads_for(10**9, threads):
            found.append(named(name)(Operand.of(cloud.points, cloud.normals), place))
    assert found[0].value.tobytes() == found[1].value.tobytes()
    assert (found[0].certain == found[1].certain).all()


@pytest.mark.parametrize("scale", [1e-30, 1e30])
@pytest.mark.parametrize("name", FAST)
def test_units_of_any_size_will_do(name, scale, ball, places):
    cloud = sphere(2500, seed=1)
    other = Operand.of(cloud.points * scale, cloud.normals)
    assert (named(name)(ball, places).inside == named(name)(other, places * scale).inside).mean() > 0.999


@pytest.mark.parametrize("name", NAMES)
def test_of_an_empty_cloud_everything_is_outside(name):
    found = named(name)(Operand.of(np.empty((0, 3)), np.empty((0, 3))), [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    assert not found.inside.any() and (found.value > 0.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_no_places_give_no_answers(name, ball):
    assert [len(part) for part in named(name)(ball, np.empty((0, 3)))] == [0, 0, 0]


@pytest.mark.parametrize("name", NAMES)
def test_a_single_surfel_does_not_break_a_judge(name):
    found = named(name)(Operand.of([[1.0, 2.0, 3.0]], np.array([[0.0, 0.0, 1.0]])), [[1.0, 2.0, 2.0], [1.0, 2.0, 4.0]])
    assert np.isfinite(found.value).all() or name == "indicator"
    if name not in ("winding", "indicator", "mls"):  # of no area, and three surfels make a plane
        assert found.inside.tolist() == [True, False]


@pytest.mark.parametrize("name", NAMES)
def test_surfels_in_one_place_and_unknown_normals_do_not_break_a_judge(name):
    points = np.repeat(sphere(40).points, 30, axis=0)
    for normals in (points, np.zeros_like(points)):
        found = named(name)(Operand.of(points, normals), np.concatenate([points[:50], points[:50] * 0.5]))
        assert not np.isnan(found.value).any()
    assert not found.inside.any()  # of unknown normals nothing is inside
    assert name == "winding" or not found.certain.any()  # which finds that nothing goes round anything


@pytest.mark.parametrize("name", NAMES)
def test_places_that_are_no_places_are_refused(name, ball):
    with pytest.raises(InputError, match="queries must have shape"):
        named(name)(ball, [1.0, 2.0, 3.0, 4.0])
    with pytest.raises(InputError, match="not finite"):
        named(name)(ball, [[0.0, np.nan, 0.0]])


@pytest.mark.parametrize("name", NAMES)
def test_a_judge_takes_a_cloud_as_it_takes_its_operand(name, ball, places):
    import surfel

    cloud = surfel.Surfels(*_parts(sphere(2500, seed=1)))
    few = places[:200]
    assert np.array_equal(named(name)(cloud, few).value, named(name)(ball, few).value)
    assert choose(cloud) == choose(ball)
    with pytest.raises(InputError, match=r"a cloud must be a surfel\.Surfels or an Operand; got ndarray"):
        named(name)(cloud.points, few)


def test_parameters_out_of_range_are_refused(ball):
    for name in ("imls", "two-cluster"):
        with pytest.raises(InputError, match="k must be at least 1"):
            named(name)(ball, [[0.0, 0.0, 0.0]], k=0)
    with pytest.raises(InputError, match="beta must be at least 1"):
        named("winding")(ball, [[0.0, 0.0, 0.0]], beta=0.5)
    with pytest.raises(InputError, match="cells must be between 4 and 512"):
        named("indicator")(ball, [[0.0, 0.0, 0.0]], cells=2)
    with pytest.raises(InputError, match="bias"):
        named("mls")(ball, [[0.0, 0.0, 0.0]], bias=0.0)


def test_unknown_judges_are_refused_by_name():
    with pytest.raises(InputError, match="judge must be one of brute, nearest"):
        named("oracle")


class TestChoice:
    def test_smooth(self):
        assert choose(Operand.of(*_parts(sphere(6000)))).name == "two-nearest"

    def test_edges(self):
        from shapes_with_truth import box

        chosen = choose(Operand.of(*_parts(box(6000))))
        assert chosen.name == "two-cluster" and "sharp edges" in chosen.reason

    @pytest.mark.parametrize(("sigma", "name"), [(0.2, "imls"), (1.0, "indicator")])
    def test_noise(self, sigma, name):
        cloud = sphere(8000)
        chosen = choose(Operand.of(cloud.noisy(sigma, 1), cloud.normals))
        assert chosen.name == name and "noise" in chosen.reason

    @pytest.mark.parametrize(("share", "name"), [(0.02, "imls"), (0.2, "indicator")])
    def test_flips(self, share, name):
        cloud = sphere(8000)
        flip = np.where(np.random.default_rng(0).random(8000) < share, -1.0, 1.0)[:, None]
        chosen = choose(Operand.of(cloud.points, cloud.normals * flip))
        assert chosen.name == name and "contradict" in chosen.reason

    def test_empty_and_tiny(self):
        assert choose(Operand.of(np.empty((0, 3)), np.empty((0, 3)))).name in NAMES
        assert choose(Operand.of([[0.0, 0.0, 0.0]], np.array([[0.0, 0.0, 1.0]]))).name in NAMES

    def test_the_package_still_offers_the_function(self):
        from surfel.inside import judges

        assert callable(judges.choose)


def _parts(cloud):
    return cloud.points, cloud.normals
