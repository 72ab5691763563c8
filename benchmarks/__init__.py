"""Benchmarks of surfel: ``python -m benchmarks accuracy|speed|peers`` from the root of the repository."""
