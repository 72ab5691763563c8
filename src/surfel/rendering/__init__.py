"""Pictures of shapes: cameras, splats, cast lines, CSG decided once a pixel, light."""
