"""What ``view`` and ``render`` share: files to be seen, safe surfaces among them, and which way is up."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from surfel.shapes.base import Shape

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}

Up = Annotated[str, typer.Option(metavar="x|y|z", help="Which axis points up.")]


def read_to_see(file: str, form: str | None) -> Shape:
    """Read a cloud, a mesh, a tree, or a safe surface that ``surfel bound`` wrote."""
    import surfel

    return surfel.SafeSpline.load(file).sheet() if _is_safe_surface(file) else surfel.read(file, as_=form)


def as_axis(up: str) -> str:
    """Return the name of an axis, or refuse it."""
    from surfel.core.cast import as_choice

    return as_choice(up, "--up", tuple(AXES))


def _is_safe_surface(file: str) -> bool:
    if Path(file).suffix.lower() != ".npz":
        return False
    try:
        with zipfile.ZipFile(file) as arrays:
            return {"words.npy", "coefficients.npy"} <= set(arrays.namelist())
    except (OSError, zipfile.BadZipFile):  # whoever reads it says what is wrong
        return False
