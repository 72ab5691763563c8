"""The moving least squares surface: order of accuracy, fixed points, the formula, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from shapes_with_truth import rotation, sphere, square, torus, uneven_sphere
from surfel.core.errors import InputError
from surfel.inside.mls import project
from surfel.inside.operand import Operand


def operand_of(cloud):
    return Operand.of(cloud.points, cloud.normals)


def off_torus(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1.0, points[:, 2]) - 0.35


@pytest.mark.parametrize(("degree", "error"), [(0, 2e-2), (1, 2e-2), (2, 1.2e-3), (3, 1.2e-3), (4, 2e-4)])
def test_a_higher_degree_comes_nearer_to_a_curved_surface(degree, error):
    cloud = torus(20_000, 1)
    rng = np.random.default_rng(2)
    places = cloud.points[:2000] + cloud.normals[:2000] * rng.uniform(-0.05, 0.05, (2000, 1))
    found = project(places, operand_of(cloud), degree=degree, k=30)
    off = np.abs(off_torus(found.points))
    assert np.quantile(off, 0.99) < error
    assert found.converged.mean() > 0.97
    if degree >= 2:
        assert np.einsum("ij,ij->i", found.normals, cloud.normals[:2000]).min() > 0.995


def test_the_plane_fit_does_not_know_the_curvature():
    cloud = torus(20_000, 1)
    plain, curved = (project(cloud.points[:500], operand_of(cloud), degree=d, k=30).points for d in (0, 2))
    assert np.abs(off_torus(plain)).mean() > 10.0 * np.abs(off_torus(curved)).mean()


def test_projected_points_are_fixed_points():
    cloud = sphere(5000, 3)
    operand = operand_of(cloud)
    once = project(cloud.points[:300] * 1.05, operand)
    twice = project(once.points, operand)
    assert np.abs(twice.points - once.points).max() < 0.02 * operand.spacing


def test_a_plane_is_reproduced_exactly():
    cloud = square(2000, 4)
    places = np.column_stack([np.random.default_rng(5).uniform(0.2, 0.8, (200, 2)), np.linspace(-0.1, 0.1, 200)])
    for degree in range(5):
        found = project(places, operand_of(cloud), degree=degree, k=30)
        assert np.abs(found.points - places * [1.0, 1.0, 0.0]).max() < 1e-9
        assert np.allclose(found.normals, [0.0, 0.0, 1.0], atol=1e-6)


def test_one_step_from_a_surfel_is_the_formula():
    """Weighted plane about the nearest surfel, foot of the place on it, weighted polynomial over the foot."""
    cloud = sphere(800, 6)
    operand = operand_of(cloud)
    place, h, k = np.array([0.3, -0.5, 0.9]), 0.3, 12
    found = project(place[None], operand, degree=2, h=h, k=k, steps=1)

    def neighbours(at):
        square = ((cloud.points - at) ** 2).sum(axis=1)
        rows = np.argsort(square)[:k]
        return cloud.points[rows], np.exp(-square[rows] / h**2)

    start = cloud.points[np.argmin(((cloud.points - place) ** 2).sum(axis=1))]
    points, weight = neighbours(start)
    middle = np.average(points, weights=weight, axis=0)
    normal = np.linalg.eigh((points - middle).T @ ((points - middle) * weight[:, None]))[1][:, 0]
    normal *= np.sign(normal @ start)
    foot = place - ((place - middle) @ normal) * normal
    points, weight = neighbours(foot)
    u, v = np.linalg.svd(normal[None])[2][1:]
    x, y, f = (points - foot) @ u, (points - foot) @ v, (points - foot) @ normal
    basis = np.stack([np.ones(k), x, y, x * x, x * y, y * y], axis=1) * np.sqrt(weight)[:, None]
    g = np.linalg.lstsq(basis, f * np.sqrt(weight), rcond=None)[0]
    assert found.points[0] == pytest.approx(foot + g[0] * normal, abs=1e-6)
    slope = normal - g[1] * u - g[2] * v
    assert found.normals[0] == pytest.approx(slope / np.linalg.norm(slope), abs=1e-5)


def test_the_bias_shortens_the_steps():
    cloud = sphere(2000, 7)
    operand = operand_of(cloud)
    place = cloud.points[:100] * 1.4
    whole, half = (project(place, operand, degree=0, bias=bias, steps=1).points for bias in (1.0, 0.5))
    nearest = cloud.points[np.argmin(((place[:, None] - cloud.points) ** 2).sum(axis=2), axis=1)]
    assert np.allclose(half - nearest, 0.5 * (whole - nearest), atol=1e-12)


def test_far_places_come_back_to_the_surface():
    """Undamped, steps from farther away than the radius of curvature grow."""
    cloud = sphere(3000, 8)
    found = project(cloud.points[:300] * 50.0, operand_of(cloud), degree=2)
    assert np.abs(np.linalg.norm(found.points, axis=1) - 1.0).max() < 1e-3
    assert np.isfinite(found.points).all()


def test_the_default_width_follows_the_density():
    cloud = uneven_sphere(6000, 9)
    found = project(cloud.points[::10] * 1.02, operand_of(cloud))
    assert np.abs(np.linalg.norm(found.points, axis=1) - 1.0).max() < 3e-3


def test_a_rigid_motion_goes_through():
    cloud = torus(6000, 10)
    turn, shift = rotation(11), np.array([5.0, -3.0, 1e3])
    places = cloud.points[:200] * 1.03
    here = project(places, operand_of(cloud))
    there = project(places @ turn.T + shift, Operand.of(cloud.points @ turn.T + shift, cloud.normals @ turn.T))
    assert np.quantile(np.abs(here.points @ turn.T + shift - there.points).max(axis=1), 0.98) < 1e-6
    assert np.quantile(np.abs(here.normals @ turn.T - there.normals).max(axis=1), 0.98) < 1e-5


def test_small_clouds_lower_the_degree():
    triangle = Operand.of([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], np.tile([0.0, 0, 1], (3, 1)))
    found = project([[0.2, 0.2, 0.5]], triangle, degree=4)
    assert np.allclose(found.points, [[0.2, 0.2, 0.0]], atol=1e-9)
    assert found.normals.tolist() == [[0.0, 0.0, 1.0]]


def test_bad_input_is_refused():
    operand = operand_of(sphere(100))
    place = [[0.0, 0.0, 1.1]]
    for bad, message in (
        ({"degree": 5}, "degree must be between 0 and 4"),
        ({"degree": 1.5}, "degree must be a whole number"),
        ({"k": 2}, "k must be at least 3"),
        ({"h": 0.0}, "h must be positive"),
        ({"bias": 0.0}, "bias must be above 0"),
        ({"bias": 1.5}, "bias must be above 0"),
        ({"steps": 0}, "steps must be at least 1"),
    ):
        with pytest.raises(InputError, match=message):
            project(place, operand, **bad)
    with pytest.raises(InputError, match="no surface to project onto"):
        project(place, Operand.of(np.empty((0, 3)), np.empty((0, 3))))
    with pytest.raises(InputError, match="shape"):
        project([1.0, 2.0], operand)
    assert len(project(np.empty((0, 3)), operand).points) == 0


def test_a_cloud_is_projected_onto_as_its_operand_is():
    import surfel

    cloud = sphere(2000, 12)
    places = cloud.points[:50] * 1.05
    found = project(places, surfel.Surfels(cloud.points, cloud.normals), degree=2)
    assert np.array_equal(found.points, project(places, operand_of(cloud), degree=2).points)
    with pytest.raises(InputError, match="Surfels or an Operand; got list"):
        project(places, [[0.0, 0.0, 1.0]])
