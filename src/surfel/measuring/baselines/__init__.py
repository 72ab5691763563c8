"""What surfel is compared with, behind one interface: ``method(shape, effort) -> area, elements, seconds``."""

from surfel.measuring.baselines.baseline import Baseline, Reading
from surfel.measuring.baselines.marching_cubes import marching_cubes
from surfel.measuring.baselines.random_lines import random_lines
from surfel.measuring.baselines.subdivision import subdivision

BASELINES: dict[str, Baseline] = {
    "random lines": random_lines,
    "marching cubes": marching_cubes,
    "subdivision": subdivision,
}

__all__ = ["BASELINES", "Baseline", "Reading", "marching_cubes", "random_lines", "subdivision"]
