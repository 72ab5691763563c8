"""surfel measures, combines and bounds solids straight from their points.

Everything public is a name of this module. What is behind a name is imported when the name is first used, so that
``import surfel`` costs next to nothing.

Examples
--------
>>> import numpy as np, surfel
>>> rng = np.random.default_rng(0)
>>> points = rng.standard_normal((5000, 3))
>>> points /= np.linalg.norm(points, axis=1, keepdims=True)
>>> m = surfel.measure(surfel.Surfels(points))
>>> abs(m.area.value - 4 * np.pi) < 0.1
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surfel.core.crossings import Crossings
    from surfel.core.errors import (
        ConvergenceError,
        FileFormatError,
        InputError,
        MissingExtraError,
        SurfelError,
        SurfelWarning,
    )
    from surfel.core.estimate import Estimate
    from surfel.core.lines import Lines
    from surfel.core.patches import Patches
    from surfel.io import convert, info, read, write
    from surfel.measuring.measure import measure
    from surfel.measuring.measurement import Measurement
    from surfel.shapes.mesh import Mesh
    from surfel.shapes.sample import sample
    from surfel.shapes.surfels import Surfels

__version__ = "0.1.0"

__all__ = [
    "ConvergenceError",
    "Crossings",
    "Estimate",
    "FileFormatError",
    "InputError",
    "Lines",
    "Measurement",
    "Mesh",
    "MissingExtraError",
    "Patches",
    "SurfelError",
    "SurfelWarning",
    "Surfels",
    "__version__",
    "convert",
    "info",
    "measure",
    "read",
    "sample",
    "write",
]

_HOME = {
    "ConvergenceError": "surfel.core.errors",
    "Crossings": "surfel.core.crossings",
    "Estimate": "surfel.core.estimate",
    "FileFormatError": "surfel.core.errors",
    "InputError": "surfel.core.errors",
    "Lines": "surfel.core.lines",
    "Measurement": "surfel.measuring.measurement",
    "Mesh": "surfel.shapes.mesh",
    "MissingExtraError": "surfel.core.errors",
    "Patches": "surfel.core.patches",
    "SurfelError": "surfel.core.errors",
    "SurfelWarning": "surfel.core.errors",
    "Surfels": "surfel.shapes.surfels",
    "convert": "surfel.io",
    "info": "surfel.io",
    "measure": "surfel.measuring.measure",
    "read": "surfel.io",
    "sample": "surfel.shapes.sample",
    "write": "surfel.io",
}


def __getattr__(name: str) -> object:
    """Import what is behind a public name when it is first asked for (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'surfel' has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
