"""A machined part as a tree of exact solids: its measures, against closed forms, and its file for OpenSCAD."""

import numpy as np

import surfel

PLATE, BOSS, BORE, BOLTS = (80.0, 50.0, 10.0), (16.0, 24.0), 9.0, 4.0  # mm

plate = surfel.Box(PLATE)
boss = surfel.Cylinder(radius=BOSS[0], height=BOSS[1]).translated((0, 0, 5 + BOSS[1] / 2))
bore = surfel.Cylinder(radius=BORE, height=100)
bolts = [surfel.Cylinder(radius=BOLTS, height=20).translated((x, y, 0)) for x in (-30.0, 30.0) for y in (-16.0, 16.0)]
part = (plate | boss) - bore - surfel.Union(*bolts)

top = 2 * PLATE[0] * PLATE[1] - 2 * np.pi * (BORE**2 + 4 * BOLTS**2)
sides = 2 * (PLATE[0] + PLATE[1]) * PLATE[2] + 2 * np.pi * (BOSS[0] * BOSS[1] + 4 * BOLTS * PLATE[2])
area = top + sides + 2 * np.pi * BORE * (PLATE[2] + BOSS[1])
volume = np.prod(PLATE) + np.pi * (BOSS[0] ** 2 * BOSS[1] - BORE**2 * (PLATE[2] + BOSS[1]) - 4 * BOLTS**2 * PLATE[2])

m = surfel.measure(part)
print(f"area         {m.area}, truth {area:.1f}")
print(f"by lines     {surfel.measure(part, method='lines').area}, truth {area:.1f}")
print(f"volume       {m.volume}, truth {volume:.1f}")
print(f"bore         {m.areas[2]}, truth {2 * np.pi * BORE * (PLATE[2] + BOSS[1]):.1f}")
print("centroid    ", m.centroid)

surfel.write("part.csg", part)
print("read again:  area", surfel.measure(surfel.read("part.csg")).area)
surfel.render(part, size=(640, 480)).save("part.png")
