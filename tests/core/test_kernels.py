"""Kernels without an entry for Python: kernels call them, and Python is told that it cannot."""

from __future__ import annotations

import pytest

from surfel._numba import inlined, inner, kernel


@inner
def _twice(x):
    return 2.0 * x


@inlined
def _next(x):
    return x + 1.0


@kernel
def _both(x):
    return _next(_twice(x))


def test_kernels_call_them():
    assert _both(3.0) == 7.0


@pytest.mark.parametrize("function", [_twice, _next])
def test_python_cannot(function):
    with pytest.raises(TypeError, match="is for kernels alone"):
        function(3.0)
    assert function.py_func(3.0) in (4.0, 6.0)
