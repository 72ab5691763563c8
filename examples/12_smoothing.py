"""Smoothing watched by its area: plain smoothing is stopped once it shrinks, area-preserving smoothing may go on."""

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

import surfel

RING, TUBE, NOISE, N, STEPS = 2.0, 0.6, 0.015, 20_000, 8

exact = surfel.Torus(RING, TUBE)
points, normals = surfel.sample(exact, N, seed=0)[:2]
points = points + NOISE * np.random.default_rng(0).standard_normal((N, 1)) * normals


def smoothed(points: np.ndarray, area: float | None) -> np.ndarray:
    """Move every point along its normal to the middle of its neighbours; scale to an area, where one is given."""
    around = points[cKDTree(points).query(points, 30)[1]]
    middle = around.mean(axis=1)
    spread = around - middle[:, None]
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]
    points = points + np.einsum("ni,ni->n", middle - points, normals)[:, None] * normals
    if area is not None:
        centre = points.mean(axis=0)
        points = centre + np.sqrt(area / surfel.measure(surfel.Surfels(points)).area.value) * (points - centre)
    return points


first = surfel.measure(surfel.Surfels(points))
print(f"the scan: area {first.area}, truth {4 * np.pi**2 * RING * TUBE:.3f}; noise of {first.noise:.2f} spacings")
figure = Figure((8, 3.2), layout="constrained")
axes = figure.subplots(1, 2)
for name, target in (("plain", None), ("area-preserving", first.area.value)):
    now, found, stop = points, [first], None
    for step in range(1, STEPS + 1):
        now = smoothed(now, target)
        found.append(surfel.measure(surfel.Surfels(now)))
        if stop is None and found[-1].area.interval(0.95)[1] < first.area.value:
            stop = step
    print(f"{name}: {'never shrinks' if stop is None else f'has shrunk after step {stop}: stop before'}")
    for step in range(0, STEPS + 1, 4):
        m = found[step]
        print(f"  step {step}: area {m.area}, volume {m.volume}, noise {m.noise:.3f} spacings")
    for ax, what in zip(axes, ("area", "volume"), strict=True):
        told = [getattr(m, what) for m in found]
        ax.errorbar(range(STEPS + 1), [t.value for t in told], [2 * t.standard_error for t in told], label=name)
        ax.set(xlabel="step", ylabel=what)
axes[0].legend()
figure.savefig("smoothing.png", dpi=90)
