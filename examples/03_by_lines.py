"""Count by lines: the area of an open surface, from its patches, from lines, and from lines drawn by hand."""

import numpy as np

import surfel

TRUTH = 2.0 * np.pi  # a half-sphere of radius 1, without its base

rng = np.random.default_rng(0)
points = rng.standard_normal((20_000, 3))
points /= np.linalg.norm(points, axis=1, keepdims=True)
points[:, 2] = np.abs(points[:, 2])
bowl = surfel.Surfels(points)

patches = surfel.measure(bowl)
print(f"patches      {patches.area}, truth {TRUTH:.4f}")
for model in ("tangent", "chord", "offset"):
    counted = surfel.measure(bowl, method="lines", model=model)
    print(f"{model:12} {counted.area}, truth {TRUTH:.4f}")
print(f"no volume:   {patches.leak:.0%} of the lines that hit leak")

# By hand: uniform directions, uniform offsets in a disk of radius 1.1; N such lines stand for 2 pi^2 R^2 / N each.
N, R = 100_000, 1.1
directions = rng.standard_normal((N, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
across = np.cross(directions, rng.standard_normal((N, 3)))
across /= np.linalg.norm(across, axis=1, keepdims=True)
origins = R * np.sqrt(rng.random((N, 1))) * across
lines = surfel.Lines(origins, directions, np.full(N, 2.0 * np.pi**2 * R**2 / N))

hits = bowl.cross(lines)
sums = hits.weight_per_line() * lines.weights / np.pi
print(f"by hand      {surfel.Estimate(sums.sum(), sums.std() * np.sqrt(N))}, truth {TRUTH:.4f}")
surfel.render(bowl, size=(640, 480)).save("bowl.png")
