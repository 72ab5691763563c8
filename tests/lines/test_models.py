"""The three models and the box give one measure of lines: the invariant one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from surfel.core.errors import InputError
from surfel.core.lines import Lines
from surfel.lines.enclosing import Ball, OrientedBox
from surfel.lines.models import MODELS, line_block, lines_through_ball, lines_through_box
from surfel.lines.sequences import SEQUENCES, from_shifts, shifts, unit_points

CENTRE, RADIUS = np.array([3.0, -2.0, 5.0]), 2.5
BALL = Ball(CENTRE, RADIUS)
BOX = OrientedBox(CENTRE, Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), np.array([1.6, 1.3, 1.1]))
BODIES = [*((model, BALL) for model in MODELS), ("tangent", BOX)]


def crossings_of_sphere(lines, centre, radius):
    to = centre - lines.origins
    along = (to * lines.directions).sum(axis=1)
    return 2.0 * (np.square(to).sum(axis=1) - along**2 < radius**2)


def crossings_of_box(lines, box):
    origins, directions = (lines.origins - box.centre) @ box.axes.T, lines.directions @ box.axes.T
    first, second = (-box.half - origins) / directions, (box.half - origins) / directions
    return 2.0 * (np.minimum(first, second).max(axis=1) < np.maximum(first, second).min(axis=1))


def crossings_of_flat(lines, centre, axes, inside):
    t = ((centre - lines.origins) @ axes[2]) / (lines.directions @ axes[2])
    place = lines.origins + t[:, None] * lines.directions - centre
    return 1.0 * inside(place @ axes[0], place @ axes[1])


def turned(seed):
    return Rotation.random(random_state=seed).as_matrix()


TARGETS = {
    "sphere at the centre": (4 * np.pi, lambda lines: crossings_of_sphere(lines, CENTRE, 1.0)),
    "sphere aside": (np.pi, lambda lines: crossings_of_sphere(lines, np.add(CENTRE, (0.5, 0.3, -0.4)), 0.5)),
    "sphere elsewhere": (np.pi, lambda lines: crossings_of_sphere(lines, np.add(CENTRE, (-0.4, 0.5, 0.3)), 0.5)),
    "box": (
        2 * (0.8 * 0.6 + 0.6 * 1.0 + 1.0 * 0.8),
        lambda lines: crossings_of_box(lines, OrientedBox(CENTRE + 0.2, turned(4), np.array([0.4, 0.3, 0.5]))),
    ),
    "square": (
        1.0,
        lambda lines: crossings_of_flat(
            lines, np.add(CENTRE, (0.2, -0.3, 0.1)), turned(5), lambda u, v: np.maximum(abs(u), abs(v)) < 0.5
        ),
    ),
    "square elsewhere": (
        1.0,
        lambda lines: crossings_of_flat(
            lines, CENTRE - (0.2, 0.1, 0.2), turned(6), lambda u, v: np.maximum(abs(u), abs(v)) < 0.5
        ),
    ),
    "disk": (
        np.pi * 0.49,
        lambda lines: crossings_of_flat(
            lines, np.add(CENTRE, (0, 0.3, 0.2)), turned(7), lambda u, v: u * u + v * v < 0.49
        ),
    ),
}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("model", "body"), BODIES)
def test_areas_wherever_they_lie(model, body, target):
    area, crossings = TARGETS[target]
    estimates = []
    for shift in shifts(11, 16):
        lines = line_block("niederreiter", model, body, 0, 4096, 4096, shift)
        estimates.append((lines.weights * crossings(lines)).sum() / np.pi)
    mean, error, _ = from_shifts(estimates)
    assert error < 0.02 * area
    assert abs(mean - area) < 4.0 * error


def chord_lengths(lines):
    offset = np.linalg.norm(lines.origins - CENTRE, axis=1)
    return 2.0 * np.sqrt(np.maximum(RADIUS**2 - offset**2, 0.0))


@pytest.mark.parametrize("model", MODELS)
def test_chord_length_has_the_density_l_over_2_r_squared(model):
    points = unit_points("niederreiter", 0, 2**15)
    lengths = chord_lengths(lines_through_ball(points, CENTRE, RADIUS, model))
    assert kstest(lengths, lambda length: length**2 / (4.0 * RADIUS**2)).statistic < 0.004
    assert np.isclose(lengths.mean(), 4.0 * RADIUS / 3.0, rtol=1e-3)
    random = chord_lengths(lines_through_ball(unit_points("random", 0, 20_000), CENTRE, RADIUS, model))
    assert kstest(random, lambda length: length**2 / (4.0 * RADIUS**2)).pvalue > 1e-3


@pytest.mark.parametrize("model", MODELS)
def test_directions_are_isotropic_for_every_length(model):
    lines = lines_through_ball(unit_points("niederreiter", 0, 2**15), CENTRE, RADIUS, model)
    lengths = chord_lengths(lines)
    for part in (lengths < np.median(lengths), lengths >= np.median(lengths)):
        d = lines.directions[part]
        assert np.abs(d.T @ d / len(d) - np.eye(3) / 3.0).max() < 0.01
        for axis in turned(1):
            assert abs(np.abs(d @ axis).mean() - 0.5) < 0.01
            feet = (lines.origins[part] - CENTRE) @ axis
            assert abs(feet.mean()) < 0.02 * RADIUS


@pytest.mark.parametrize("model", MODELS)
def test_origins_are_the_points_nearest_to_the_centre(model):
    lines = lines_through_ball(unit_points("niederreiter", 0, 60_000), CENTRE, RADIUS, model)
    away = lines.origins - CENTRE
    assert np.abs(np.linalg.norm(lines.directions, axis=1) - 1.0).max() < 1e-15
    assert np.abs((away * lines.directions).sum(axis=1)).max() < 1e-11
    assert np.linalg.norm(away, axis=1).max() <= RADIUS * (1.0 + 1e-14)
    assert np.allclose(lines.weights, 2.0 * np.pi**2 * RADIUS**2 / 60_000, rtol=1e-14)


CORNERS = np.array(np.meshgrid(*[[0.0, 0.25, 0.5, 1.0 - 2**-53, 1.0]] * 4)).reshape(4, -1).T


@pytest.mark.parametrize("model", MODELS)
def test_corners_of_the_cube_give_lines(model):
    lines = lines_through_ball(CORNERS, np.zeros(3), 1.0, model)
    assert np.isfinite(lines.origins).all()
    assert np.abs(np.linalg.norm(lines.directions, axis=1) - 1.0).max() < 1e-15
    assert np.linalg.norm(lines.origins, axis=1).max() < 1.0 + 1e-14


@pytest.mark.parametrize("half", [(1.0, 1.0, 1.0), (3.0, 0.1, 1.0), (2.0, 1.0, 0.0), (0.0, 1.0, 2.0), (1.0, 0.0, 2.0)])
def test_all_lines_hit_the_box(half):
    box = OrientedBox(CENTRE, turned(3), np.array(half))
    lines = lines_through_box(np.vstack([unit_points("niederreiter", 0, 4096), CORNERS]), box)
    assert np.abs(np.linalg.norm(lines.directions, axis=1) - 1.0).max() < 1e-15
    assert np.abs(((lines.origins - CENTRE) * lines.directions).sum(axis=1)).max() < 1e-13
    assert np.isclose(lines.weights.sum(), 0.5 * np.pi * box.surface, rtol=1e-12)
    assert (crossings_of_box(lines, box.grown(1e-9)) == 2.0).all()


def test_box_has_the_mean_chord_of_cauchy():
    lines = lines_through_box(unit_points("niederreiter", 0, 2**15), BOX)
    origins, directions = (lines.origins - BOX.centre) @ BOX.axes.T, lines.directions @ BOX.axes.T
    first, second = (-BOX.half - origins) / directions, (BOX.half - origins) / directions
    length = np.maximum(first, second).min(axis=1) - np.minimum(first, second).max(axis=1)
    assert np.isclose(length.mean(), 4.0 * BOX.volume / BOX.surface, rtol=2e-3)


def test_flat_box_measures_what_lies_in_it():
    box = OrientedBox(CENTRE, np.eye(3), np.array([1.0, 0.7, 0.0]))
    lines = lines_through_box(unit_points("niederreiter", 0, 4096), box)
    found = crossings_of_flat(lines, CENTRE, np.eye(3), lambda u, v: np.maximum(abs(u), abs(v) / 0.7) < 1.0 + 1e-9)
    assert np.isclose((lines.weights * found).sum() / np.pi, 2.8, rtol=1e-12)


def slope_of_error(sequence, model):
    """Order of the RMS error, pooled over an off-centre sphere and a box in the unit ball, N = 2^8 ... 2^17."""
    numbers = 2 ** np.arange(8, 18)
    squares = np.zeros(len(numbers))
    box = OrientedBox(np.array([-0.1, 0.1, 0.1]), np.eye(3), np.array([0.2, 0.3, 0.2]))
    for shift in shifts(0, 16):
        lines = line_block(sequence, model, Ball(np.zeros(3), 1.0), 0, numbers[-1], numbers[-1], shift)
        for area, hits in (
            (4 * np.pi * 0.16, crossings_of_sphere(lines, np.array([0.2, 0.1, -0.1]), 0.4)),
            (box.surface, crossings_of_box(lines, box)),
        ):
            squares += (2.0 * np.pi * np.cumsum(hits)[numbers - 1] / numbers / area - 1.0) ** 2
    return np.polyfit(np.log(numbers), 0.5 * np.log(squares), 1)[0]


@pytest.mark.parametrize("model", ["tangent", "chord"])
def test_order_of_convergence_is_better_than_monte_carlo(model):
    assert slope_of_error("niederreiter", model) < -0.62  # plain Monte Carlo: -0.5


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("body", [BALL, BOX])
def test_blocks_are_the_whole(sequence, body):
    shift = shifts(1, 1)[0]
    whole = line_block(sequence, "tangent", body, 0, 1000, 1000, shift)
    parts = [
        line_block(sequence, "tangent", body, a, b - a, 1000, shift) for a, b in ((0, 256), (256, 999), (999, 1000))
    ]
    for name in ("origins", "directions", "weights"):
        assert (getattr(whole, name) == np.concatenate([getattr(part, name) for part in parts])).all()


@pytest.mark.parametrize("model", MODELS)
def test_one_and_two_threads_give_the_same_bits(model):
    import numba

    points = unit_points("niederreiter", 0, 60_000)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = lines_through_ball(points, CENTRE, RADIUS, model)
    finally:
        numba.set_num_threads(before)
    two = lines_through_ball(points, CENTRE, RADIUS, model)
    assert (one.origins == two.origins).all() and (one.directions == two.directions).all()


def test_bad_arguments():
    good = np.full((2, 4), 0.5)
    assert isinstance(lines_through_ball(good, (0, 0, 0), 1), Lines)
    assert len(lines_through_ball(np.empty((0, 4)), (0, 0, 0), 1)) == 0
    for arguments in [
        (good, (0, 0), 1.0),
        (good, (0, 0, np.nan), 1.0),
        (good, (0, 0, 0), 0.0),
        (good, (0, 0, 0), np.inf),
        (good, (0, 0, 0), 1.0, "secant"),
        (good[:, :3], (0, 0, 0), 1.0),
        (good + 0.6, (0, 0, 0), 1.0),
        (good - 0.6, (0, 0, 0), 1.0),
        (good * np.nan, (0, 0, 0), 1.0),
        (0.5, (0, 0, 0), 1.0),
    ]:
        with pytest.raises(InputError):
            lines_through_ball(*arguments)
    with pytest.raises(InputError, match="no surface"):
        lines_through_box(good, OrientedBox(np.zeros(3), np.eye(3), np.array([1.0, 0.0, 0.0])))
    for arguments in [
        ("r4", "tangent", Ball(np.zeros(3), 0.0), 0, 1, 1),
        ("r4", "tangent", "ball", 0, 1, 1),
        ("r4", "secant", BALL, 0, 1, 1),
        ("r4", "tangent", BALL, 0, 1, 0),
        ("r4", "tangent", BALL, -1, 1, 1),
    ]:
        with pytest.raises(InputError):
            line_block(*arguments)
