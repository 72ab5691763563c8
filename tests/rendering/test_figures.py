"""Figures and notebook reprs of clouds, measurements and splines."""

from __future__ import annotations

import math

import numpy as np
import pytest

import surfel
from pictured import ball
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
