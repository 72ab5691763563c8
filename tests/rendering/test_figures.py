"""Figures and notebook reprs of clouds, measurements and splines."""

from __future__ import annotations

import io
import math
import pickle

import numpy as np
import pytest
from benchmarks.render import ball

import surfel
from surfel.core.estimate import Estimate
from surfel.measuring.measurement import Measurement


def result() -> Measurement:
    return Measurement(area=Estimate(12.5, 0.1), volume=Estimate(4.2, 0.05), closed=True, leak=0.0, warnings=("a < b",))


def test_a_measurement_is_a_table_in_a_notebook():
    html = result()._repr_html_()
    assert html.startswith("<table>") and "12.5" in html and "4.2" in html and "a &lt; b" in html


def test_a_cloud_is_a_table_in_a_notebook():
    html = surfel.Surfels([[0, 0, 0], [1, 2, 3]], attributes={"<b>": [1, 2]})._repr_html_()
    assert "1, 2, 3" in html and "&lt;b&gt;" in html and "<b>" not in html
    assert "0" in surfel.Surfels(np.empty((0, 3)))._repr_html_()


def test_a_measurement_is_plotted():
    pytest.importorskip("matplotlib")
    axes = result().plot("mm").axes[0]
    labels = [text.get_text() for text in axes.texts]
    assert any("area" in label and "mm^2" in label for label in labels)
    assert math.isclose(axes.containers[0].lines[2][0].get_segments()[0][1][0], 100.0 * 1.96 * 0.1 / 12.5, rel_tol=1e-3)


def test_a_spline_is_plotted_over_its_points():
    pytest.importorskip("matplotlib")
    points = ball(500).points
    figure = surfel.bound(points, shape=(4, 4)).plot(points)
    assert len(figure.axes) == 4
    with pytest.raises(surfel.InputError, match="points"):
        surfel.bound(points, shape=(4, 4)).plot([[1, 2]])


def test_a_measurement_shows_how_it_converges():
    pytest.importorskip("matplotlib")
    measured = surfel.measure(surfel.Sphere(1) - surfel.Box(1), lines=4096)
    results = measured.convergence(3)
    assert [found.lines for found in results] == [1024, 2048, 4096] and results[-1] is measured
    truth = 4.0 * math.pi / 3.0 - 1.0
    errors = [abs(found.volume.value - truth) for found in results]
    assert all(error < 4.0 * found.volume.standard_error for error, found in zip(errors, results, strict=True))
    figure = measured.plot("mm")
    assert len(figure.axes) == 2 and "mm^3" in figure.axes[1].get_title()
    band = figure.axes[1].collections[0].get_paths()[0].vertices
    low, high = measured.volume.interval(0.95)
    at_end = band[band[:, 0] == measured.lines, 1]
    assert at_end.min() == pytest.approx(low) and at_end.max() == pytest.approx(high)
    assert figure.axes[1].lines[1].get_xdata()[-1] == measured.lines
    with pytest.raises(surfel.InputError, match="steps"):
        measured.convergence(-1)


def test_a_measurement_from_elsewhere_shows_its_intervals_alone():
    pytest.importorskip("matplotlib")
    travelled = pickle.loads(pickle.dumps(surfel.measure(surfel.Sphere(1), lines=1024)))
    assert len(travelled.plot().axes) == 1
    with pytest.raises(surfel.InputError, match="shape is not known"):
        travelled.convergence()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slice_of_space_tells_what_the_classifier_does(axis):
    from surfel.booleans.figures import slice_of
    from surfel.inside.grid import BORDER, IN, OUT

    inner = surfel.Classifier(ball(3000, 1.0, (0.3, 0.1, -0.2)))._inner
    grid, origin = inner._coloured.grid, inner.operand.origin
    for cell in (5, 12):
        found = slice_of(grid, axis, cell)
        p, q = np.nonzero(np.isin(found, (IN, OUT)))
        places = np.insert(np.column_stack([p, q]), axis, cell, axis=1)
        points = grid.low + origin + grid.step * (places + 0.5)
        assert np.array_equal(inner.classify(points).inside, found[p, q] == IN)
        assert cell == 5 or (found == BORDER).any()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slice_of_an_octree_shows_each_leaf_once(axis):
    from surfel.booleans.figures import leaves_of
    from surfel.inside.grid import BORDER, IN
    from surfel.inside.octree import build_octree

    operand = ball(3000, 1.0, (0.3, 0.1, -0.2)).operand
    tree = build_octree(operand, 5)
    squares, colours = leaves_of(tree, operand, axis, 15)
    areas = np.prod(squares[:, 2] - squares[:, 0], axis=1)
    assert areas.sum() == 32**2 and len(set(areas)) > 2  # the layer is covered, by leaves of several sizes
    middles = 0.5 * (squares[:, 0] + squares[:, 2])
    assert len(np.unique(middles, axis=0)) == len(middles)
    step = tree.size / 32
    centre = np.delete((np.array([0.3, 0.1, -0.2]) - operand.origin - tree.low) / step, axis)
    far = np.linalg.norm(middles - centre, axis=1) * step
    assert (far[colours == BORDER] > 0.8).all()
    assert (far[colours == IN] < 1.0).mean() > 0.9  # level by level errs beside the border, as published
    assert (colours[far < 0.8] == IN).all()


def test_space_is_plotted():
    pytest.importorskip("matplotlib")
    space = surfel.Classifier(ball(3000))
    axes = space.plot("z", at=0.25).axes[0]
    assert "z = 0.25" in axes.get_title() and set(np.unique(axes.images[0].get_array())) == {0, 1, 2}
    axes = space.plot("z", at=0.25, octree=5).axes[0]
    assert axes.get_title().startswith("octree at z = 0.25") and len(axes.collections[0].get_paths()) > 100
    for wrong, said in (({"axis": "w"}, "axis"), ({"at": 9.0}, "at=9"), ({"octree": 9}, "octree must be between 1")):
        with pytest.raises(surfel.InputError, match=said):
            space.plot(**wrong)
    assert surfel.Classifier(surfel.Surfels(np.empty((0, 3)))).plot().axes


def test_the_curve_of_a_cut_is_plotted():
    pytest.importorskip("matplotlib")
    result = surfel.combine(ball(4000) - ball(3000, 0.7, (0.5, -0.7, 0.3)))
    axes = result.plot().axes[0]
    assert "1 curve, 1 closed" in axes.get_title()
    drawn = np.column_stack(axes.lines[1].get_data_3d())
    assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0, atol=5e-3)


def pixels_of(png: bytes) -> np.ndarray:
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)))


def test_a_cloud_is_a_picture_in_a_notebook():
    pixels = pixels_of(ball(20_000)._repr_png_())
    inked = (pixels < 255).any(axis=2)
    ys, xs = np.nonzero(inked)
    middle = inked[ys.min() + 60 : ys.max() - 60, xs.min() + 60 : xs.max() - 60]
    assert middle.mean() > 0.97 and abs(np.ptp(xs) - np.ptp(ys)) < 8
    assert pixels[len(pixels) // 2, pixels.shape[1] // 2].sum() > pixels[ys.min() + 3, xs[ys.argmin()]].sum()


def test_the_picture_of_a_cloud_shows_its_colors_and_what_is_nearer():
    points = np.array([[0.0, 0.0, 0.0], [0.55, -0.72, 0.42]])  # the second right before the first
    red_before_blue = surfel.Surfels(points, colors=np.array([[0, 0, 255], [255, 0, 0]], np.uint8))
    inked = pixels_of(red_before_blue._repr_png_())
    inked = inked[(inked < 255).any(axis=2)]
    assert (inked[:, 0] > 200).mean() > 0.7  # one may stick out from behind the other by a pixel


@pytest.mark.parametrize(
    "points", [np.empty((0, 3)), [[1, 2, 3]], [[1, 2, 3]] * 5, [[1e300, 0, 0], [-1e300, 0, 0]], [[0, 0, 0], [0, 0, 1]]]
)
def test_every_cloud_has_a_picture_or_none_but_no_error(points):
    found = surfel.Surfels(points)._repr_png_()
    assert found is None or found.startswith(b"\x89PNG")
