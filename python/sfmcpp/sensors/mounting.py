"""How the camera is mounted on the body that carries the sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.checks import is_rotation


@dataclass(frozen=True, eq=False)
class Mounting:
    """Sensor–camera calibration: C of thesis eqs 5.21 and 5.22.

    A point x in the body frame is at ``camera_from_body (x − lever_arm_m)`` in the camera.

    Parameters
    ----------
    camera_from_body : (3, 3) float64
        Rotation.
    lever_arm_m : (3,) float64
        The camera's centre in the body frame [m].

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the rotation is none.
    """

    camera_from_body: FloatArray
    lever_arm_m: FloatArray

    def __post_init__(self) -> None:
        rotation = finite_array("camera_from_body", self.camera_from_body, (3, 3))
        object.__setattr__(self, "camera_from_body", rotation)
        object.__setattr__(self, "lever_arm_m", finite_array("lever_arm_m", self.lever_arm_m, (3,)))
        if not is_rotation(rotation):
            raise InvalidArgument("camera_from_body: must be orthonormal and right-handed")

    @classmethod
    def forward_looking(cls) -> Mounting:
        """A camera at the body's origin: body x forward, y left, z up; camera z forward, x right, y down."""
        return cls(np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]), np.zeros(3))

    def camera_poses(self, body_poses: FloatArray) -> FloatArray:
        """Poses world_from_camera (…, 3, 4) of poses world_from_body (…, 3, 4)."""
        rotations = body_poses[..., :3]
        centres = body_poses[..., 3] + rotations @ self.lever_arm_m
        return np.concatenate([rotations @ self.camera_from_body.T, centres[..., None]], axis=-1)

    def body_poses(self, camera_poses: FloatArray) -> FloatArray:
        """Poses world_from_body (…, 3, 4) of poses world_from_camera (…, 3, 4)."""
        rotations = camera_poses[..., :3] @ self.camera_from_body
        centres = camera_poses[..., 3] - rotations @ self.lever_arm_m
        return np.concatenate([rotations, centres[..., None]], axis=-1)

    def camera_rotation(self, body_rotation: FloatArray) -> FloatArray:
        """Rotation start_from_end of the camera (…, 3, 3) for one of the body (…, 3, 3)."""
        return np.asarray(self.camera_from_body @ body_rotation @ self.camera_from_body.T)
