"""A stockpile surveyed twice by LiDAR: what was taken away, what was added, and how sure that is."""

import numpy as np

import surfel

SIDE = 60.0  # metres
REGION = [(5, 5), (55, 5), (55, 55), (30, 50), (5, 55)]  # the yard, a concave polygon
PI = np.pi


def survey(seed: int, pile: tuple[float, float, float, float], n: int = 60_000) -> surfel.Surfels:
    """Return echoes of a sloping yard with a conical pile at x, y of a radius and height, with 3 cm of noise."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.0, SIDE, (2, n))
    x0, y0, radius, height = pile
    ground = 100.0 + 0.02 * x + 0.3 * np.sin(y / 12.0)
    z = ground + height * np.maximum(0.0, 1.0 - np.hypot(x - x0, y - y0) / radius)
    hits = rng.random(n) < 0.05  # on trucks and shrubs
    z = z + 0.03 * rng.standard_normal(n) + np.where(hits, rng.uniform(0.5, 3.0, n), 0.0)
    return surfel.Surfels(np.column_stack([x, y, z]), attributes={"classification": np.where(hits, 4, 2)})


def ground_of(cloud: surfel.Surfels) -> surfel.Surfels:
    """Return the points on the ground, class 2 of a LAS file."""
    return cloud[cloud.attributes["classification"] == 2]


before, after = survey(0, (20.0, 20.0, 10.0, 4.0)), survey(1, (40.0, 35.0, 8.0, 5.0))
change = surfel.cut_and_fill(ground_of(before), ground_of(after), REGION)
print(f"taken away  {change.cut}, truth {PI * 10**2 * 4 / 3:.2f}")  # cubic metres
print(f"added       {change.fill}, truth {PI * 8**2 * 5 / 3:.2f}")
print(f"in all      {change.net.value:+.1f} of {change.area:.0f} square metres, {change.unseen:.1%} not seen")

# Above a base plane instead of an earlier survey: 100 m, as the yard's floor was built.
stock = surfel.cut_and_fill(100.0, ground_of(after), REGION)
print(f"above 100 m: {stock.fill}")

raw = surfel.cut_and_fill(before, after, REGION)
print("with trucks and shrubs:", *raw.warnings)
surfel.render(ground_of(after), size=(640, 480)).save("yard.png")
