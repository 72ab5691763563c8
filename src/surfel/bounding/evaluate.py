"""The value of a bicubic spline and its derivatives: every number that is compared with a point comes from here.

The spline is the uniform tensor-product B-spline over the cells ``[0, n - 1] x [0, m - 1]`` with coefficients
``(n + 2, m + 2)``: cell (h, k) uses the rows h .. h + 3 and the columns k .. k + 3. It equals eq. (1) of Myles and
Peters, *Fast Safe Spline Surrogates for Large Point Clouds*. At the far end the last cell is used: h = min(floor(u),
n - 2). Outside the domain the value is NaN.
"""

from __future__ import annotations

import numpy as np

from surfel._numba import inlined, rows, threads_for
from surfel.bounding.lanes import cell_value
from surfel.core.cast import Floats


def values(coefficients: Floats, uv: Floats) -> Floats:
    """Return the values of a spline.

    Parameters
    ----------
    coefficients : Floats, shape (n + 2, m + 2)
        B-spline coefficients, C-contiguous.
    uv : Floats, shape (k, 2)
        Domain coordinates in cells, C-contiguous.

    Returns
    -------
    Floats, shape (k,)
        NaN outside the domain.

    Examples
    --------
    >>> import numpy as np
    >>> values(np.ones((6, 6)), np.array([[0.0, 1.5], [3.1, 0.0]]))
    array([ 1., nan])
    """
    out = np.empty(len(uv))
    with threads_for(len(uv)):
        _values(len(uv), _plain(coefficients), _plain(uv), out)
    return out


def derivatives(coefficients: Floats, uv: Floats) -> Floats:
    """Return value, first and second derivatives with respect to u and v (in cells).

    Returns
    -------
    Floats, shape (k, 6)
        F, F_u, F_v, F_uu, F_uv, F_vv; NaN outside the domain. F is the very number that :func:`values` gives.
    """
    out = np.empty((len(uv), 6))
    with threads_for(4 * len(uv)):
        _derivatives(len(uv), _plain(coefficients), _plain(uv), out)
    return out


def _plain(array: Floats) -> Floats:
    """Return an array that may be written: kernels are compiled anew for one that may not."""
    return array if array.flags.writeable and array.flags.c_contiguous else np.array(array, order="C")


@inlined
def cell_of(t, cells):
    """Return the cell of a domain coordinate: h = min(floor(t), cells - 1)."""
    return min(np.int64(t), cells - 1)


@inlined
def weights(t):
    """Return six times the four B-spline weights at the local coordinate t in [0, 1]; none is negative."""
    q = 1.0 - t
    return q * q * q, 4.0 + t * t * (3.0 * t - 6.0), 4.0 + q * q * (3.0 * q - 6.0), t * t * t


@inlined
def value_in(b, h, k, s, t):
    """Return the spline's value in cell (h, k) at the local coordinates (s, t).

    It is rounded as :func:`surfel.bounding.lanes.cell_value` says, wherever a value is computed.
    """
    return cell_value(b, h, k, s, t) * (1.0 / 36.0)


@inlined
def value_at(b, u, v):
    """Return the spline's value at (u, v), NaN outside the domain. The one way to a value."""
    n, m = b.shape[0] - 3, b.shape[1] - 3
    if not (u >= 0.0 and u <= n and v >= 0.0 and v <= m):
        return np.nan
    h, k = cell_of(u, n), cell_of(v, m)
    return value_in(b, h, k, u - h, v - k)


@inlined
def slopes(t):
    """Return six times the first derivatives of the four weights."""
    q = 1.0 - t
    return -3.0 * q * q, t * (9.0 * t - 12.0), q * (12.0 - 9.0 * q), 3.0 * t * t


@inlined
def bends(t):
    """Return six times the second derivatives of the four weights."""
    return 6.0 - 6.0 * t, 18.0 * t - 12.0, 6.0 - 18.0 * t, 6.0 * t


@rows
def _values(first, last, b, uv, out):
    for i in range(first, last):
        out[i] = value_at(b, uv[i, 0], uv[i, 1])


@rows
def _derivatives(first, last, b, uv, out):
    n, m = b.shape[0] - 3, b.shape[1] - 3
    for i in range(first, last):
        u, v = uv[i, 0], uv[i, 1]
        out[i, 0] = value_at(b, u, v)
        if out[i, 0] != out[i, 0]:
            out[i, :] = np.nan
            continue
        h, k = cell_of(u, n), cell_of(v, m)
        wu, du, cu = weights(u - h), slopes(u - h), bends(u - h)
        wv, dv, cv = weights(v - k), slopes(v - k), bends(v - k)
        f_u = f_v = f_uu = f_uv = f_vv = 0.0
        for a in range(4):
            row = slope = bend = 0.0
            for c in range(4):
                b_ac = b[h + a, k + c]
                row += wv[c] * b_ac
                slope += dv[c] * b_ac
                bend += cv[c] * b_ac
            f_u += du[a] * row
            f_uu += cu[a] * row
            f_v += wu[a] * slope
            f_uv += du[a] * slope
            f_vv += wu[a] * bend
        out[i, 1], out[i, 2] = f_u / 36.0, f_v / 36.0
        out[i, 3], out[i, 4], out[i, 5] = f_uu / 36.0, f_uv / 36.0, f_vv / 36.0
