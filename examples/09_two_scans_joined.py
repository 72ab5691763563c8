"""Two scans of a part joined into one solid, and what the part lost or gained between two scans."""

import numpy as np

import surfel

N = 40_000


def scan_of(center: tuple[float, float, float], radius: float, seed: int) -> surfel.Surfels:
    """Return a scan of a ball, in a gray that tells the two apart."""
    normals = np.random.default_rng(seed).standard_normal((N, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    gray = np.full((N, 3), 90 + 100 * seed, np.uint8)
    return surfel.Surfels(radius * normals + center, normals=normals, colors=gray)


one, two = scan_of((0, 0, 0), 1.0, 0), scan_of((0.8, 0, 0), 0.8, 1)

# Where the spheres meet, and the caps that each has in the other.
at = (0.8**2 + 1.0**2 - 0.8**2) / (2 * 0.8)
cap_1, cap_2 = 1.0 - at, 0.8 - (0.8 - at)
lens = np.pi * (cap_1**2 * (3.0 - cap_1) + cap_2**2 * (2.4 - cap_2)) / 3.0
first, second = 4 / 3 * np.pi, 4 / 3 * np.pi * 0.8**3

joined = surfel.combine(one | two)
m = surfel.measure(joined.surfels)
print(f"volume       {m.volume}, truth {first + second - lens:.4f}")
outside = 4 * np.pi - 2 * np.pi * cap_1 + 4 * np.pi * 0.64 - 2 * np.pi * 0.8 * cap_2
print(f"area         {m.area}, truth {outside:.4f}")
surfel.write("joined.ply", joined.surfels)

# The difference of two scans, both ways, straight from the tree.
parts = {
    "only in one": (one - two, first - lens),
    "only in two": (two - one, second - lens),
    "in both": (one & two, lens),
}
for name, (tree, truth) in parts.items():
    print(f"{name:12s} {surfel.measure(tree, seed=1).volume}, truth {truth:.4f}")
surfel.render(one - two, size=(640, 480)).save("bite.png")
