import numpy as np
import pytest

from surfel.core.box import corners


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (7, 2), (1_000, 3), (5, 1)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_corners_are_the_extremes_of_each_coordinate(rows, columns, dtype):
    points = (np.random.default_rng(rows).normal(size=(rows, columns)) * 100).astype(dtype)
    found = corners(points)
    assert found.dtype == dtype and found.shape == (2, columns)
    np.testing.assert_array_equal(found, [points.min(axis=0), points.max(axis=0)])


def test_a_coordinate_that_is_nan_somewhere_has_no_extremes():
    found = corners(np.array([[0.0, 1.0], [np.nan, 3.0]]))
    np.testing.assert_array_equal(found, [[np.nan, 1.0], [np.nan, 3.0]])
