"""Whatever has an operand: judges take it as well as the operand itself."""

from __future__ import annotations

from typing import Protocol

from surfel.core.errors import InputError
from surfel.inside.operand import Operand


class HasOperand(Protocol):
    """A cloud that can be asked for how the judges see it, as :class:`surfel.Surfels` can."""

    @property
    def operand(self) -> Operand:
        """The cloud as the judges see it."""
        ...


def as_operand(cloud: Operand | HasOperand) -> Operand:
    """Return an operand as it is, and that of a cloud.

    Raises
    ------
    InputError
        If it is neither.
    """
    found = cloud if isinstance(cloud, Operand) else getattr(cloud, "operand", None)
    if not isinstance(found, Operand):
        raise InputError(
            f"a cloud must be a surfel.Surfels or an Operand; got {type(cloud).__name__}; "
            "wrap points and normals as surfel.Surfels(points, normals)"
        )
    return found
