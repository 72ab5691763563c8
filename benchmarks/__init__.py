"""Benchmarks of surfel: ``python -m benchmarks accuracy|speed|peers|papers`` from the root of the repository."""
