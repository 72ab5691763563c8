"""Polynomials in three variables, made by multiplication, and true areas of some of their surfaces."""

from __future__ import annotations

import math

import numpy as np

GOLDEN = 0.5 * (1.0 + math.sqrt(5.0))


class Poly(dict):
    """A polynomial as {(i, j, k): coefficient} that knows + - * and powers."""

    def __add__(self, other):
        total = Poly(self)
        for key, c in as_poly(other).items():
            total[key] = total.get(key, 0.0) + c
        return total

    def __mul__(self, other):
        total = Poly()
        for a, c in self.items():
            for b, d in as_poly(other).items():
                key = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
                total[key] = total.get(key, 0.0) + c * d
        return total

    def __neg__(self):
        return self * -1.0

    def __sub__(self, other):
        return self + -as_poly(other)

    def __pow__(self, n):
        total = Poly({(0, 0, 0): 1.0})
        for _ in range(n):
            total = total * self
        return total

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other):
        return -self + other

    def at(self, points):
        x, y, z = np.moveaxis(np.asarray(points), -1, 0)
        return sum(c * x**i * y**j * z**k for (i, j, k), c in self.items())

    def size(self, points):
        """The sum of the terms' sizes: what rounding is relative to."""
        return Poly({key: abs(c) for key, c in self.items()}).at(np.abs(points))

    def gradient(self, points):
        return np.stack([self.derivative(axis).at(points) for axis in range(3)], axis=-1)

    def derivative(self, axis):
        total = Poly({(0, 0, 0): 0.0})
        for key, c in self.items():
            if key[axis]:
                lower = list(key)
                lower[axis] -= 1
                total[tuple(lower)] = c * key[axis]
        return total


def as_poly(value):
    return value if isinstance(value, Poly) else Poly({(0, 0, 0): float(value)})


X, Y, Z = Poly({(1, 0, 0): 1.0}), Poly({(0, 1, 0): 1.0}), Poly({(0, 0, 1): 1.0})


def sphere(radius=1.0, centre=(0.0, 0.0, 0.0)):
    return (X - centre[0]) ** 2 + (Y - centre[1]) ** 2 + (Z - centre[2]) ** 2 - radius**2


def torus(major, minor):
    return (X**2 + Y**2 + Z**2 + (major**2 - minor**2)) ** 2 - 4.0 * major**2 * (X**2 + Y**2)


def cyclide(a, b, d):
    c = math.sqrt(a * a - b * b)
    return (X**2 + Y**2 + Z**2 + (b * b - d * d)) ** 2 - 4.0 * (a * X - c * d) ** 2 - 4.0 * b * b * Y**2


def rounded_cube(n):
    return X**n + Y**n + Z**n - 1.0


def barth_sextic():
    """The surface with 65 double points (Barth 1996)."""
    g = GOLDEN**2
    planes = (g * X**2 - Y**2) * (g * Y**2 - Z**2) * (g * Z**2 - X**2)
    return 4.0 * planes - (1.0 + 2.0 * GOLDEN) * sphere() ** 2


def heart():
    return (X**2 + 2.25 * Y**2 + Z**2 - 1.0) ** 3 - X**2 * Z**3 - 0.1125 * Y**2 * Z**3


def chebyshev(n):
    """T_n(x) + T_n(y) + T_n(z): a grid of blobs."""
    powers = np.polynomial.chebyshev.cheb2poly([0.0] * n + [1.0])
    return sum((c * axis**k for k, c in enumerate(powers.tolist()) if c for axis in (X, Y, Z)), Poly())


def dense(degree, seed):
    rng = np.random.default_rng(seed)
    keys = [(i, j, k) for i in range(degree + 1) for j in range(degree + 1 - i) for k in range(degree + 1 - i - j)]
    return Poly(zip(keys, rng.standard_normal(len(keys)).tolist(), strict=True))


def torus_area(major, minor):
    return 4.0 * math.pi**2 * major * minor


def cyclide_area(a, b, d, n=400):
    """By the trapezoidal rule, which converges exponentially for a periodic surface, over its lines of curvature."""
    c = math.sqrt(a * a - b * b)
    u, v = np.meshgrid(*[np.arange(n) * (2.0 * np.pi / n)] * 2, indexing="ij")
    h = 2.0 * np.pi / n

    def place(u, v):  # the usual parametrisation
        below = a - c * np.cos(u) * np.cos(v)
        return np.stack(
            [
                (d * (c - a * np.cos(u) * np.cos(v)) + b * b * np.cos(u)) / below,
                b * np.sin(u) * (a - d * np.cos(v)) / below,
                b * np.sin(v) * (c * np.cos(u) - d) / below,
            ],
            axis=-1,
        )

    points = place(u, v)
    wave = 1j * np.fft.fftfreq(n, 1.0 / n)[:, None]
    along_u = np.fft.ifft(wave[:, None] * np.fft.fft(points, axis=0), axis=0).real
    along_v = np.fft.ifft(wave[None] * np.fft.fft(points, axis=1), axis=1).real
    return float(np.linalg.norm(np.cross(along_u, along_v), axis=-1).sum() * h * h)


def star_area(poly, radius_along, polar=400, around=800):
    """The area of a surface that each ray from the origin meets once: the integral of r^2 / |n . w| over directions."""
    cosine, weight = np.polynomial.legendre.leggauss(polar)
    phi = (np.arange(around) + 0.5) * (2.0 * np.pi / around)
    c, f = np.meshgrid(cosine, phi, indexing="ij")
    s = np.sqrt(1.0 - c * c)
    w = np.stack([s * np.cos(f), s * np.sin(f), c], axis=-1)
    r = radius_along(w)
    g = poly.gradient(r[..., None] * w)
    tilt = np.abs(np.einsum("...i,...i", g, w)) / np.linalg.norm(g, axis=-1)
    return float(((r * r / tilt).sum(axis=1) * weight).sum() * (2.0 * np.pi / around))


def rounded_cube_area(n):
    return star_area(rounded_cube(n), lambda w: (w**n).sum(axis=-1) ** (-1.0 / n), 200, 400)


def heart_area(polar=800, around=200):
    """Midpoints in the angle to the axis: the surface has a point there that is not smooth."""

    def radius(w):
        x2, y2, z = w[..., 0] ** 2, w[..., 1] ** 2, w[..., 2]
        a, b = x2 + 2.25 * y2 + z * z, np.cbrt(z**3 * (x2 + 0.1125 * y2))
        r = np.ones(a.shape)
        for _ in range(12):
            r = r - (a * r * r - b * np.cbrt(r) ** 5 - 1.0) / (2.0 * a * r - 5.0 / 3.0 * b * np.cbrt(r) ** 2)
        return r

    theta = (np.arange(polar) + 0.5) * (np.pi / polar)
    phi = (np.arange(around) + 0.5) * (2.0 * np.pi / around)
    t, f = np.meshgrid(theta, phi, indexing="ij")
    w = np.stack([np.sin(t) * np.cos(f), np.sin(t) * np.sin(f), np.cos(t)], axis=-1)
    r = radius(w)
    g = heart().gradient(r[..., None] * w)
    tilt = np.abs(np.einsum("...i,...i", g, w)) / np.linalg.norm(g, axis=-1)
    return float((r * r / tilt * np.sin(t)).sum() * (np.pi / polar) * (2.0 * np.pi / around))


def barth_area(radius, n=2000):
    """The area inside of a ball: three times the integral of |n_z| over the xy-plane; z^2 is the root of a quadratic.

    The squares of the normal's components sum to 1, |n_z| dS is the area of the shadow, and x, y, z change places.
    """
    g = GOLDEN**2
    steps = (np.arange(n) + 0.5) * (radius / n)
    poly, total = barth_sextic(), 0.0
    for x in np.array_split(steps, 30):
        x2, y2 = np.meshgrid(x * x, steps * steps, indexing="ij")
        first, k, m = g * x2 - y2, 1.0 + 2.0 * GOLDEN, x2 + y2 - 1.0
        a = -4.0 * first * g - k
        b = 4.0 * first * (g * g * y2 + x2) - 2.0 * k * m
        c = -4.0 * first * g * y2 * x2 - k * m * m
        root = np.sqrt(np.where(b * b >= 4.0 * a * c, b * b - 4.0 * a * c, np.nan))
        for sign in (-1.0, 1.0):
            z2 = (-b + sign * root) / (2.0 * a)
            hit = (z2 > 0.0) & (x2 + y2 + z2 <= radius**2)
            points = np.sqrt(np.stack([x2[hit], y2[hit], z2[hit]], axis=-1))
            normal = poly.gradient(points)
            total += float((np.abs(normal[:, 2]) / np.linalg.norm(normal, axis=1)).sum())
    return 3.0 * 8.0 * total * (radius / n) ** 2
