"""Area and volume as descriptors of shape: scans at any pose, size, density and noise are found in a catalogue."""

import numpy as np

import surfel

CATALOGUE = {
    "ball": surfel.Sphere(1),
    "egg": surfel.Ellipsoid((1, 1, 1.5)),
    "ring": surfel.Torus(2, 0.6),
    "brick": surfel.Box((1, 2, 3)),
    "can": surfel.Cylinder(radius=1, height=3),
    "hat": surfel.Cone(1.5, 0, 2),
    "dice": surfel.Box(2) - surfel.Sphere(0.8).translated((0, 0, 1)),
}


def descriptor(shape: surfel.Surfels, seed: int) -> np.ndarray:
    """Return four numbers that motions and scales leave as they are: of area, volume, inertia and spans of lines."""
    m = surfel.measure(shape, seed=seed)
    moments = np.linalg.eigvalsh(m.inertia.value)
    rng, n = np.random.default_rng(seed), 4000
    directions, across = rng.standard_normal((2, n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.cross(directions, across)
    middle, reach = shape.bounds.mean(axis=0), 0.5 * np.linalg.norm(np.diff(shape.bounds, axis=0))
    origins = middle + reach * np.sqrt(rng.random((n, 1))) * across / np.linalg.norm(across, axis=1, keepdims=True)
    hits = shape.cross(surfel.Lines(origins, directions, np.ones(n)))
    met = np.flatnonzero(hits.counts > 0)
    spans = hits.t[hits.offsets[met + 1] - 1] - hits.t[hits.offsets[met]]
    round_ = m.area.value**3 / (36 * np.pi * m.volume.value**2)  # 1 for a ball, more for all others
    return np.array([np.log(round_), *np.log(moments[1:] / moments[0]), spans.std() / spans.mean()])


def scan(solid: surfel.Box, n: int, noise: float, seed: int) -> surfel.Surfels:
    """Return a scan of a solid without normals: turned, moved, of another size, and with noise (of its spacing)."""
    rng = np.random.default_rng(seed)
    points, normals = surfel.sample(solid, n, seed=seed)[:2]
    spacing = np.sqrt(surfel.measure(solid).area.value / n)
    points = points + noise * spacing * rng.standard_normal((n, 1)) * normals
    cloud = surfel.Surfels(points, solid=True).rotated(rng.standard_normal(3), rng.uniform(0, 180))
    return cloud.scaled(rng.uniform(0.2, 5.0)).translated(rng.uniform(-9, 9, 3))


known = {name: descriptor(scan(solid, 20_000, 0.0, 1), 1) for name, solid in CATALOGUE.items()}
for name, numbers in known.items():
    print(
        f"{name:6s} roundness {np.exp(numbers[0]):.3f}, moments 1 : {np.exp(numbers[1]):.2f} : {np.exp(numbers[2]):.2f}"
    )
right = 0
cases = [(n, noise) for n in (2_000, 8_000) for noise in (0.0, 0.3)]
for k, (n, noise) in enumerate(cases):
    for name, solid in CATALOGUE.items():
        found = descriptor(scan(solid, n, noise, 10 + k), k)
        nearest = min(known, key=lambda other: np.abs(known[other] - found).sum())
        right += nearest == name
        if nearest != name:
            print(f"{name}, {n:,} points, noise of {noise:g} spacings: taken for {nearest}")
print(f"{right} of {len(cases) * len(CATALOGUE)} scans are found")
surfel.render([solid.translated((4 * k, 0, 0)) for k, solid in enumerate(CATALOGUE.values())]).save("descriptors.png")
