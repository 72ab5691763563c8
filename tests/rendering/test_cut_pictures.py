"""Trees: the image-space operation against the reference, and the edge of a cut against its true curve."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.render import ball, cube

import surfel
from surfel import Camera

SIZE = (160, 120)
CAMERA = Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
BITE = (0.5, -0.7, 0.3)


def trees() -> dict[str, surfel.Difference | surfel.Union | surfel.Intersection]:
    a, b, c = ball(20_000), ball(12_000, 0.7, BITE), ball(8_000, 0.5, (0.0, 0.2, 0.9))
    return {
        "cloud - cloud": a - b,
        "cloud & cloud": a & b,
        "cloud | cloud": a | b,
        "cloud - exact": a - surfel.Cylinder(radius=0.4, height=4).rotated((1, 1, 0), 35),
        "exact - cloud": surfel.Box(1.6) - b,
        "exact & cloud": surfel.Box(1.5) & a,
        "three clouds": (a - b) | (c - surfel.Box(0.5).translated((0, 0, 1.3))),
        "sheet & exact": a.with_solid(False) & surfel.HalfSpace((0, 1, 0), 0.2),
    }


@pytest.mark.parametrize("name", list(trees()))
def test_a_tree_looks_as_the_reference_does(name):
    tree = trees()[name]
    image = surfel.render(tree, CAMERA, SIZE)
    truth = surfel.render(tree, CAMERA, SIZE, reference=True)
    covered = np.count_nonzero((image.ids >= 0) | (truth.ids >= 0))
    assert covered > 1000
    assert np.count_nonzero(image.ids != truth.ids) <= 0.006 * covered
    with np.errstate(invalid="ignore"):
        far = np.abs(image.depth - truth.depth) > 0.05
    assert np.count_nonzero(far & (image.ids == truth.ids)) <= 0.003 * covered


def test_trees_of_exact_shapes_and_of_clouds_agree():
    image = surfel.render(ball(40_000) - ball(20_000, 0.7, BITE), CAMERA, SIZE)
    truth = surfel.render(surfel.Sphere(1) - surfel.Sphere(0.7).translated(BITE), CAMERA, SIZE)
    covered = np.count_nonzero(truth.ids >= 0)
    assert np.count_nonzero(image.ids != truth.ids) <= 0.005 * covered
    both = (image.ids >= 0) & (image.ids == truth.ids)
    assert np.abs(image.depth[both] - truth.depth[both]).max() < 0.05
    agree = np.einsum("ijk,ijk->ij", image.normals, truth.normals)[both]
    assert agree.mean() > 0.999


@pytest.mark.parametrize(("zoom", "most"), [(6, 0.5), (40, 1.0)])
def test_the_edge_of_a_cut_of_two_curved_clouds_is_the_true_curve(zoom, most):
    cloud, exact = ball(40_000) - ball(30_000, 0.7, BITE), surfel.Sphere(1) - surfel.Sphere(0.7).translated(BITE)
    whole = surfel.render(exact, CAMERA, SIZE)
    ys, xs = np.nonzero(whole.ids == 1)
    edge = xs.argmax()
    camera = Camera(CAMERA.eye, whole.point_at(int(xs[edge]), int(ys[edge])), field=42).zoomed(zoom)
    image, truth = (surfel.render(shape, camera, SIZE, smooth=False) for shape in (cloud, exact))
    length = np.count_nonzero(truth.ids[:, 1:] != truth.ids[:, :-1]) + np.count_nonzero(truth.ids[1:] != truth.ids[:-1])
    assert length > 60
    assert np.count_nonzero(image.ids != truth.ids) / (length / np.sqrt(2.0)) <= most


def test_the_edge_of_a_cut_of_clean_primitives_is_the_true_curve():
    hole = surfel.Cylinder(radius=0.5, height=4).rotated((1, 0, 0), 90)
    camera = Camera((2.2, -2.9, 1.7), (0.35355, -1.0, 0.35355), field=42).zoomed(30)
    image, truth = (surfel.render(block - hole, camera, SIZE, smooth=False) for block in (cube(60), surfel.Box(2)))
    length = np.count_nonzero(truth.ids[:, 1:] != truth.ids[:, :-1]) + np.count_nonzero(truth.ids[1:] != truth.ids[:-1])
    assert length > 60
    assert np.count_nonzero(image.ids != truth.ids) / (length / np.sqrt(2.0)) <= 0.25


def test_the_back_of_what_is_subtracted_shows_the_cut():
    image = surfel.render(ball(20_000) - ball(12_000, 0.7, BITE), CAMERA, SIZE)
    place = image.point_at(*[int(v.mean()) for v in np.nonzero(image.ids == 1)][::-1])
    assert np.linalg.norm(place - np.array(BITE)) == pytest.approx(0.7, abs=0.01)
    assert np.linalg.norm(place) < 0.9


def test_a_solid_less_itself_is_nothing():
    cloud = ball(3000)
    assert surfel.render(cloud - cloud, CAMERA, SIZE).covered == 0.0
    twin = surfel.Surfels(cloud.points, normals=cloud.normals)
    assert surfel.render(cloud - twin, CAMERA, SIZE).covered == 0.0
    assert surfel.render(surfel.Box(1) - surfel.Box(1), CAMERA, SIZE).covered == 0.0


def test_a_moving_camera_classifies_nothing_anew(monkeypatch):
    from surfel.inside.classify import Classifier
    from surfel.inside.operand import Operand

    tree = ball(5000) - ball(3000, 0.7, BITE)
    surfel.render(tree, CAMERA, SIZE)
    asked = []
    classify = Classifier.classify

    def watched(self, queries, *arguments, **named):
        asked.append(isinstance(queries, Operand))
        return classify(self, queries, *arguments, **named)

    monkeypatch.setattr(Classifier, "classify", watched)
    surfel.render(tree, CAMERA.orbited(20), SIZE)
    assert asked and not any(asked)


def test_many_leaves_work():
    balls = [ball(400, 0.25, (x, y, 0)) for x in (-0.5, 0, 0.5) for y in (-0.5, 0, 0.5)]
    image = surfel.render(surfel.Difference(surfel.Box(1.2), *balls), CAMERA, SIZE)
    truth = surfel.render(surfel.Difference(surfel.Box(1.2), *balls), CAMERA, SIZE, reference=True)
    assert np.count_nonzero(image.ids != truth.ids) <= 0.01 * np.count_nonzero(truth.ids >= 0)
    assert len(np.unique(image.ids)) > 5


def test_the_result_of_combine_looks_as_the_tree_does():
    tree = ball(12_000) - ball(8_000, 0.7, BITE)
    image, made = surfel.render(tree, CAMERA, SIZE), surfel.render(surfel.combine(tree), CAMERA, SIZE)
    covered = np.count_nonzero(image.ids >= 0)
    assert np.count_nonzero((image.ids >= 0) != (made.ids >= 0)) <= 0.01 * covered
    with np.errstate(invalid="ignore"):
        assert np.count_nonzero(np.abs(image.depth - made.depth) > 0.05) <= 0.02 * covered


@pytest.mark.parametrize("cut", ["clip", "split"])
def test_the_result_of_a_cut_shows_what_its_tree_shows_without_holes(cut):
    """Its disks have the size of their shares; drawn so, random points would leave holes all over."""
    rng = np.random.default_rng(3)

    def random_ball(centre, radius):
        normals = rng.standard_normal((6_000, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return surfel.Surfels(radius * normals + centre, normals=normals)

    tree = random_ball((0, 0, 0), 1.0) - random_ball((0.5, -0.7, 0.3), 0.8)
    camera = surfel.Camera((2.2, -2.9, 1.7), (0, 0, 0), field=42)
    whole = surfel.render(tree, camera, (240, 180))
    result = surfel.render(surfel.combine(tree, cut=cut).surfels, camera, (240, 180))
    covered = whole.ids >= 0
    assert np.count_nonzero((result.ids >= 0) != covered) <= 0.01 * np.count_nonzero(covered)
    both = covered & (result.ids >= 0)
    deeper = np.abs(result.depth[both] - whole.depth[both]) > 0.05
    assert np.count_nonzero(deeper) <= 0.02 * np.count_nonzero(covered)
