"""A picture of a bore through a scan, and what its pixels know: which leaf they show, and how far off it is."""

import numpy as np

import surfel

rng = np.random.default_rng(0)
normals = rng.standard_normal((20_000, 3))
normals /= np.linalg.norm(normals, axis=1, keepdims=True)
scan = surfel.Surfels(10.0 * normals, normals=normals)
part = scan - surfel.Cylinder(radius=4.0, height=30.0).rotated((1, 0, 0), 90)

camera = surfel.Camera(eye=(0.0, -60.0, 0.0), target=(0.0, 0.0, 0.0))
image = surfel.render(part, camera, (400, 300))
image.save("bore.png")
middle = image.ids[150, 200]
print(f"the part fills {image.covered:.0%} of the picture; in the middle is {'nothing' if middle < 0 else 'the part'}")

# The bore is seen from end to end: what is open in the picture is its mouth, of radius 4 mm at the far end.
height = 2.0 * 60.0 * np.tan(np.radians(camera.field) / 2.0)  # what the picture spans at the middle of the part
rows, columns = np.indices(image.ids.shape)
hole = (image.ids < 0) & (np.hypot(rows - 149.5, columns - 199.5) < 60.0)
far = 60.0 + np.sqrt(10.0**2 - 4.0**2)
radius = np.sqrt(hole.sum() / np.pi) * height / 300.0 * far / 60.0
print(f"radius of the mouth {radius:.2f} mm, as made 4.00 mm")
for angle in range(0, 360, 120):
    view = surfel.render(part, camera.orbited(angle), (200, 150))
    print(f"from {angle:3d} degrees {(view.ids == 1).sum():5,} pixels show the bore")
