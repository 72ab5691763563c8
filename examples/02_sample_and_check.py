"""Sample a mesh and measure the samples: what the points tell, beside what the mesh knows exactly."""

import numpy as np

import surfel

# A wedge: five faces, sharp edges of 90 and 45 degrees.
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 1], [2, 0, 1], [0, 2, 1]], float)
TRIANGLES = [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]

wedge = surfel.Mesh(CORNERS, TRIANGLES)
surfel.write("wedge.stl", wedge)
exact = surfel.measure(surfel.read("wedge.stl"))

for kind in ("random", "blue"):
    points, normals, _ = surfel.sample(wedge, 10_000, kind=kind, seed=0)
    for given in (normals, None):
        m = surfel.measure(surfel.Surfels(points, normals=given))
        print(f"{kind} points, {'no normals' if given is None else 'normals given'}:")
        print(f"  area   {m.area}, truth {exact.area.value:.4f}")
        print(f"  volume {m.volume}, truth {exact.volume.value:.4f}")
surfel.render([wedge, surfel.Surfels(points, normals=normals).translated((2.5, 0, 0))], size=(640, 480)).save(
    "wedge.png"
)
