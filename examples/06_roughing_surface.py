"""A roughing surface over a scan: a cutter that stays above it never touches the part."""

import numpy as np

import surfel

STOCK, ALLOWANCE = 12.0, 0.3  # the top of the raw block, and what the finishing cut shall find, in mm


def scan_of_a_part(n: int, seed: int = 0) -> np.ndarray:
    """Return points of a boss with a rounded rim on a wavy base, with noise, as a scanner above sees them."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-40.0, 40.0, (2, n))
    radius = np.hypot(x, y)
    boss = 8.0 / (1.0 + np.exp((radius - 20.0) / 1.5))
    base = 0.8 * np.sin(x / 9.0) * np.cos(y / 11.0)
    return np.column_stack([x, y, boss + base + 0.01 * rng.standard_normal(n)])


surfel.write("scan.ply", scan_of_a_part(60_000))
scan = surfel.read("scan.ply")

for mode in ("fast", "tight"):
    lid = surfel.bound(scan, direction=(0, 0, 1), shape=(40, 40), mode=mode)
    violations, _ = lid.verify(scan)
    print(f"{mode}: {violations} points above, mean gap {lid.report.gap_mean:.3f} mm, at most {lid.report.gap_max:.2f}")

# What the roughing cut takes away, from the surface's patches: height times the area that each covers in the plane.
patches = lid.sheet().patches(100_000)
depth = STOCK - patches.points[:, 2] - ALLOWANCE
print(f"to cut: {np.sum(depth * patches.areas * patches.normals[:, 2]) / 1000.0:.1f} cubic centimetres")

# Down to where may a cutter go over a place, and does a probe coming in aslant meet the part?
places = np.array([[0.0, 0.0, 0.0], [30.0, 10.0, 0.0]])
print("depth limits:", np.round(lid(places) + ALLOWANCE, 2))
probe = ([[-60.0, 0.0, 7.0]], [[1.0, 0.0, -0.05]])
print("the probe is stopped after", np.round(lid.intersect(probe).t, 2), "mm:", lid.occludes(probe))

lid.save("roughing.npz")  # lid.to_3dm("roughing.3dm") writes the same surface for CAD (extra cad)
print(surfel.SafeSpline.load("roughing.npz"))
lid.plot(scan.points).savefig("roughing.png", dpi=60)  # extra plot
