"""What a line can cross: clouds, meshes, exact primitives, trees."""
