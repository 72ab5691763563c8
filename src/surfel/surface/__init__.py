"""What is learnt from bare points: spacing, normals, noise, projection, patches. Arrays in, arrays out."""
