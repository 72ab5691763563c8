"""Boolean operations on clouds and exact solids: the kept surfels, the cut, and its curve."""
