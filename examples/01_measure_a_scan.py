"""Measure a scan: a file of points with noise and without normals, its results beside the truth."""

import numpy as np

import surfel

RING, TUBE, NOISE = 2.0, 0.6, 0.003  # the radii of a torus, and how far its points stray


def scan_of_a_torus(n: int, seed: int = 0) -> np.ndarray:
    """Return uniform random points of the torus, moved along the normal by Gaussian noise."""
    rng = np.random.default_rng(seed)
    around = rng.uniform(0.0, 2.0 * np.pi, 3 * n)
    outer = RING + TUBE * np.cos(around)
    around = around[rng.uniform(0.0, RING + TUBE, 3 * n) < outer][:n]  # more points where the surface is wider
    along = rng.uniform(0.0, 2.0 * np.pi, n)
    radius = TUBE + NOISE * rng.standard_normal(n)
    outer = RING + radius * np.cos(around)
    return np.stack([outer * np.cos(along), outer * np.sin(along), radius * np.sin(around)], axis=1)


surfel.write("torus.ply", scan_of_a_torus(30_000))

scan = surfel.read("torus.ply")
m = surfel.measure(scan)

low, high = m.area.interval(0.95)
print(f"area     {m.area}, truth {4.0 * np.pi**2 * RING * TUBE:.4f}, at 95 % between {low:.2f} and {high:.2f}")
print(f"volume   {m.volume}, truth {2.0 * np.pi**2 * RING * TUBE**2:.4f}")
print(f"centroid {m.centroid}")
print(f"closed   {m.closed}: {m.leak:.2%} of the lines that hit leak")
print(f"noise    {m.noise * m.spacing:.4f}, truth {NOISE}")
for warning in m.warnings:
    print(f"warning: {warning}")
surfel.render(scan, size=(640, 480)).save("torus.png")
