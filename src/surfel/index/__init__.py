"""Space-partitioning indices over plain arrays: Hilbert order, neighbours, bounding volumes."""
