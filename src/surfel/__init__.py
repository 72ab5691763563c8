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
    from surfel.booleans.classifier import Classifier
    from surfel.booleans.combine import combine
    from surfel.booleans.result import Combination
    from surfel.bounding.curve import bound_curve
    from surfel.bounding.doors import bound
    from surfel.bounding.pairs import sandwich
    from surfel.bounding.spline import SafeSpline
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
    from surfel.io import convert, info, open, read, write
    from surfel.measuring.cut_and_fill import CutAndFill, cut_and_fill
    from surfel.measuring.measure import measure
    from surfel.measuring.measurement import Measurement
    from surfel.rendering.camera import Camera
    from surfel.rendering.image import Image
    from surfel.rendering.render import render
    from surfel.shapes.mesh import Mesh
    from surfel.shapes.primitives.box import Box
    from surfel.shapes.primitives.cyclide import Cyclide, Torus
    from surfel.shapes.primitives.cylinder import Cone, Cylinder
    from surfel.shapes.primitives.ellipsoid import Ellipsoid, Sphere
    from surfel.shapes.primitives.half_space import HalfSpace
    from surfel.shapes.primitives.polynomial import Polynomial
    from surfel.shapes.primitives.quadric import Quadric
    from surfel.shapes.sample import sample
    from surfel.shapes.surfels import Surfels
    from surfel.shapes.tree import Difference, Intersection, Union
    from surfel.viewer.view import view
    from surfel.viewer.viewer import Viewer

__version__ = "0.1.0"

__all__ = [
    "Box",
    "Camera",
    "Classifier",
    "Combination",
    "Cone",
    "ConvergenceError",
    "Crossings",
    "CutAndFill",
    "Cyclide",
    "Cylinder",
    "Difference",
    "Ellipsoid",
    "Estimate",
    "FileFormatError",
    "HalfSpace",
    "Image",
    "InputError",
    "Intersection",
    "Lines",
    "Measurement",
    "Mesh",
    "MissingExtraError",
    "Patches",
    "Polynomial",
    "Quadric",
    "SafeSpline",
    "Sphere",
    "SurfelError",
    "SurfelWarning",
    "Surfels",
    "Torus",
    "Union",
    "Viewer",
    "__version__",
    "bound",
    "bound_curve",
    "combine",
    "convert",
    "cut_and_fill",
    "info",
    "measure",
    "open",
    "read",
    "render",
    "sample",
    "sandwich",
    "view",
    "write",
]

_HOME = {
    "Camera": "surfel.rendering.camera",
    "Box": "surfel.shapes.primitives.box",
    "Classifier": "surfel.booleans.classifier",
    "Combination": "surfel.booleans.result",
    "Cone": "surfel.shapes.primitives.cylinder",
    "ConvergenceError": "surfel.core.errors",
    "Crossings": "surfel.core.crossings",
    "CutAndFill": "surfel.measuring.cut_and_fill",
    "Cyclide": "surfel.shapes.primitives.cyclide",
    "Cylinder": "surfel.shapes.primitives.cylinder",
    "Difference": "surfel.shapes.tree",
    "Ellipsoid": "surfel.shapes.primitives.ellipsoid",
    "Estimate": "surfel.core.estimate",
    "FileFormatError": "surfel.core.errors",
    "Image": "surfel.rendering.image",
    "HalfSpace": "surfel.shapes.primitives.half_space",
    "InputError": "surfel.core.errors",
    "Intersection": "surfel.shapes.tree",
    "Lines": "surfel.core.lines",
    "Measurement": "surfel.measuring.measurement",
    "Mesh": "surfel.shapes.mesh",
    "MissingExtraError": "surfel.core.errors",
    "Patches": "surfel.core.patches",
    "Polynomial": "surfel.shapes.primitives.polynomial",
    "Quadric": "surfel.shapes.primitives.quadric",
    "SafeSpline": "surfel.bounding.spline",
    "Sphere": "surfel.shapes.primitives.ellipsoid",
    "SurfelError": "surfel.core.errors",
    "SurfelWarning": "surfel.core.errors",
    "Surfels": "surfel.shapes.surfels",
    "Torus": "surfel.shapes.primitives.cyclide",
    "Union": "surfel.shapes.tree",
    "Viewer": "surfel.viewer.viewer",
    "bound": "surfel.bounding.doors",
    "bound_curve": "surfel.bounding.curve",
    "combine": "surfel.booleans.combine",
    "convert": "surfel.io",
    "cut_and_fill": "surfel.measuring.cut_and_fill",
    "info": "surfel.io",
    "measure": "surfel.measuring.measure",
    "open": "surfel.io",
    "read": "surfel.io",
    "render": "surfel.rendering.render",
    "sample": "surfel.shapes.sample",
    "sandwich": "surfel.bounding.pairs",
    "view": "surfel.viewer.view",
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
