"""A drill through a scan, as a new cloud: sharp at the cut, ready to be measured, written and cut again."""

import numpy as np

import surfel

R, D, N = 10.0, 3.0, 40_000  # a ball of 10 mm, a drill of 3 mm radius, points of the scan

rng = np.random.default_rng(0)
normals = rng.standard_normal((N, 3))
normals /= np.linalg.norm(normals, axis=1, keepdims=True)
scan = surfel.Surfels(R * normals, normals=normals)

drill = surfel.Cylinder(radius=D, height=40.0)
half = np.sqrt(R**2 - D**2)
drilled = surfel.combine(scan - drill)  # no mesh, and no points of the drill needed: its surface is known
print(f"{drilled.kept[0]:,} surfels of the scan stay, {drilled.kept[1]:,} line the bore, {drilled.cut:,} are cut")

m = surfel.measure(drilled.surfels)
print(f"area    {m.area}, truth {4 * np.pi * R * half + 4 * np.pi * D * half:.2f}")
print(f"volume  {m.volume}, truth {4 / 3 * np.pi * half**3:.2f}")

# The result is a cloud like any other: clip planes go into the file, and out of it again.
surfel.write("drilled.ply", drilled.surfels)
part = surfel.read("drilled.ply")
half_part = surfel.combine(part & surfel.HalfSpace((0, 0, 1), 0.0))
m = surfel.measure(half_part.surfels)
print(f"half of its volume  {m.volume}, truth {2 / 3 * np.pi * half**3:.2f}")

# A cutter that moves: what is learnt of the scan is learnt once, and a pose costs a few milliseconds.
space = surfel.Classifier(scan)
tool = surfel.Surfels(*surfel.sample(drill, 5000, seed=0)[:2])
for step in range(4):
    pose = np.eye(4)
    pose[0, 3] = 4.0 * step
    print(f"drill at {pose[0, 3]:4.1f} mm: {space.classify(tool, pose=pose).inside.mean():.0%} of it in the ball")
surfel.render((scan - drill) & surfel.HalfSpace((0, 0, 1), 0.0), size=(640, 480)).save("half.png")
