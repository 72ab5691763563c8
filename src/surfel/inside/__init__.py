"""Is a point inside a cloud? Judges, coloured space, and the classifier that joins them: arrays in, arrays out."""
