"""A sandwich round LiDAR: the canopy below one surface, the ground above another, from a file that is streamed."""

import numpy as np

import surfel

SIDE, TREES = 200.0, 150  # metres, and how many


def flight_over_a_wood(n: int, seed: int = 0) -> np.ndarray:
    """Return echoes from a hillside and from trees of 8 to 25 m: half reach the ground, the rest stop in crowns."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, SIDE, (n, 2))
    ground = 300.0 + 0.08 * places[:, 0] + 4.0 * np.sin(places[:, 1] / 30.0)
    stems, heights = rng.uniform(0.0, SIDE, (TREES, 2)), rng.uniform(8.0, 25.0, TREES)
    crown = np.zeros(n)
    for stem, height in zip(stems, heights, strict=True):
        away = np.linalg.norm(places - stem, axis=1) / (0.3 * height)
        crown = np.maximum(crown, height * np.sqrt(np.maximum(0.0, 1.0 - away**2)))
    echo = np.where(rng.random(n) < 0.5, 0.0, crown * rng.uniform(0.6, 1.0, n))
    return np.column_stack([places, ground + echo])


surfel.write("flight.ply", flight_over_a_wood(200_000))  # a LAS or LAZ file is read in the same way

with surfel.open("flight.ply", chunk=50_000) as echoes:  # never all in memory
    canopy, ground = surfel.sandwich(echoes, shape=(40, 40))
    for name, surface in (("canopy", canopy), ("ground", ground)):
        violations, _ = surface.verify(echoes)
        print(f"{name}: {violations} echoes on the wrong side, mean gap {surface.report.gap_mean:.2f} m")

u, v = np.meshgrid(np.linspace(0.0, 39.0, 200), np.linspace(0.0, 39.0, 200))
grid = np.column_stack([u.ravel(), v.ravel()])
thick = canopy(grid) - ground(grid)
print(f"canopy over ground: {np.nanmean(thick):.1f} m in the mean, {np.nanmax(thick):.1f} m at most, never below 0:")
print(f"  {np.nanmin(thick):.2f} m at the least, {np.isnan(thick).mean():.1%} of the grid trimmed")
print(f"{canopy.report.compression:.0f} numbers of the file for each one of the surface")
canopy.plot(surfel.read("flight.ply").points).savefig("canopy.png", dpi=60)  # extra plot
