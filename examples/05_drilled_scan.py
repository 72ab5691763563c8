"""A scan cut by a drill: the cloud is a solid in the tree like any other, and nothing is meshed."""

import numpy as np

import surfel

R, D, N = 10.0, 3.0, 40_000  # a ball of 10 mm, a drill of 3 mm radius, points of the scan

rng = np.random.default_rng(0)
points = rng.standard_normal((N, 3))
scan = surfel.Surfels(R * points / np.linalg.norm(points, axis=1, keepdims=True))

drill = surfel.Cylinder(radius=D, height=40.0).rotated((1, 0, 0), 90)
drilled = scan - drill
half = np.sqrt(R**2 - D**2)

m = surfel.measure(drilled, seed=1)
print(f"area         {m.area}, truth {4 * np.pi * R * half + 4 * np.pi * D * half:.2f}")
print(f"of the scan  {m.areas[0]}, truth {4 * np.pi * R * half:.2f}")
print(f"of the bore  {m.areas[1]}, truth {4 * np.pi * D * half:.2f}")
print(f"volume       {m.volume}, truth {4 / 3 * np.pi * half**3:.2f}")

chips = surfel.measure(scan & drill)
print(f"cut away     {chips.volume}, truth {4 / 3 * np.pi * (R**3 - half**3):.2f}")

# Only the part of the scan below a plane, closed by that plane.
cap = surfel.measure(scan & surfel.HalfSpace((0, 0, 1), -5.0))
print(f"cap          {cap.volume}, truth {np.pi * 25.0 * (3 * R - 5.0) / 3:.2f}")
surfel.render(drilled, surfel.Camera(eye=(20, -35, 15), target=(0, 0, 0)), (640, 480)).save("drilled.png")
