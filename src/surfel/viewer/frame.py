"""Frame: world coordinates as the browser shows them, about the origin and of a size that its controls are made for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surfel.core.cast import Floats

SIZE = 4.0
"""How long the diagonal of the scene is in the browser."""


@dataclass(frozen=True)
class Frame:
    """A shift and a scale; single precision is enough beyond it.

    Parameters
    ----------
    middle : Floats, shape (3,)
        The place of the world that the browser's origin is.
    unit : float
        The browser's length of a unit of the world.
    """

    middle: Floats
    unit: float

    @classmethod
    def of(cls, box: Floats) -> Frame:
        """Return the frame of a scene with that box, shape (2, 3)."""
        diagonal = float(np.linalg.norm(box[1] - box[0]))
        return cls(box.mean(axis=0), SIZE / diagonal if diagonal > 0.0 else 1.0)

    def shown(self, points: Floats) -> NDArray[np.float32]:
        """Return where places of the world are in the browser."""
        return ((points - self.middle) * self.unit).astype(np.float32)

    def pose(self, position: Floats, wxyz: Floats, pivot: Floats) -> Floats:
        """Return the motion of the world that takes a control from ``pivot`` to where it is in the browser."""
        turn = turned(wxyz)
        motion = np.eye(4)
        motion[:3, :3] = turn
        motion[:3, 3] = np.asarray(position) / self.unit + self.middle - turn @ pivot
        return motion

    def control(self, pose: Floats, pivot: Floats) -> tuple[Floats, Floats]:
        """Return the position and the quaternion of a control for a motion of the world; the way back."""
        place = pose[:3, :3] @ pivot + pose[:3, 3]
        return (place - self.middle) * self.unit, quaternion(pose[:3, :3])


def turned(wxyz: Floats) -> Floats:
    """Return the rotation of a quaternion of any length, shape (3, 3)."""
    w, x, y, z = np.asarray(wxyz, np.float64) / np.linalg.norm(wxyz)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion(turn: Floats) -> Floats:
    """Return the unit quaternion of a rotation, shape (4,), its real part not negative."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(turn).as_quat(canonical=True)
    return np.array([w, x, y, z])


def upright(normals: Floats) -> NDArray[np.float32]:
    """Return the quaternions that turn the z axis to unit normals, shape (n, 4)."""
    x, y, z = normals.T
    down = z < -0.999999
    half = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=1)
    half[down] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(half / np.linalg.norm(half, axis=1, keepdims=True), np.float32)
