"""Exact primitives, one family a file; all are exported from ``surfel``."""
