"""How the camera is mounted on the body that carries the sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation

# Rounding errors of a rotation matrix.
_ROUNDING = 1e-14
# No vehicle carries a camera so far from its sensors [m].
_LONGEST_M = 1000.0
# Steps that tell how a camera is turned, at least.
_FEWEST_STEPS = 6
# It is turned from so much on, and from so many standard deviations on. On parts of 0001, 0027, 0036 and 0039
# the velocities of KITTI's unit are 0.2 to 1.5 degrees off what pairs of images see; a mounting off by five
# degrees is off by 3.7 to 6.4.
_LEAST_RAD, _SIGMAS = float(np.radians(2.5)), 4.0
# Standard deviation of a median over the median of the length of two standard normal numbers, times the root
# of their number.
_MEDIAN_ERROR = 1.06
# Where the cosine of this share of the steps is lower, they point back. No rotation between opposite
# directions is the shortest: that about the camera's vertical keeps the vertical part of each.
_SHARE_OPPOSED, _OPPOSED, _HALF_TURN = 0.7, -0.7, np.diag([-1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Mounting:
    """Sensor–camera calibration: C of thesis eqs 5.21 and 5.22.

    A point x in the body frame is at ``camera_from_body (x − lever_arm_m)`` in the camera.

    Parameters
    ----------
    camera_from_body : (3, 3) float64
        Rotation; one that is printed with a few decimals is replaced by the nearest rotation.
    lever_arm_m : (3,) float64
        The camera's centre in the body frame [m].

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, the rotation is none to 0.001, or the lever arm is longer
        than a kilometre.
    """

    camera_from_body: FloatArray
    lever_arm_m: FloatArray

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(self, camera_from_body: ArrayLike, lever_arm_m: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        rotation = finite_array("camera_from_body", self.camera_from_body, (3, 3))
        object.__setattr__(self, "lever_arm_m", finite_array("lever_arm_m", self.lever_arm_m, (3,)))
        if np.abs(self.lever_arm_m).max() > _LONGEST_M:
            found = self.lever_arm_m.tolist()
            rule = f"must be at most {_LONGEST_M:g} m; is it in millimetres?"
            raise InvalidArgument(f"lever_arm_m = {found}: {rule}")
        if not is_rotation(rotation, PRINTED_ROTATION_TOLERANCE):
            with np.errstate(all="ignore"):
                off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
                determinant = np.linalg.det(rotation)
            rule = f"must be orthonormal to {PRINTED_ROTATION_TOLERANCE:g} and right-handed"
            found = f"is off by {off:.2g}, with determinant {determinant:.3g}"
            raise InvalidArgument(f"camera_from_body: {found}: {rule}")
        # What is left of its decimals would add up along a drive.
        if not is_rotation(rotation, _ROUNDING):
            rotation = so3.nearest_rotation(rotation)
        object.__setattr__(self, "camera_from_body", rotation)

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


@checked(steps=(ANY, 3), directions=(ANY, 3))
def find_misalignment(steps: FloatArray, directions: FloatArray) -> FloatArray | None:
    """Rotation of a camera against its stated mounting, from its steps and their directions in images.

    Parameters
    ----------
    steps : (n, 3) float64
        Steps of the camera that a sensor tells, by the mounting, in its axes [m].
    directions : (n, 3) float64
        Unit vectors along the same steps that images tell; some may be wrong.

    Returns
    -------
    (3, 3) float64 or None
        Rotation true_from_declared of the camera's axes, as far as the steps tell it: not about the way.
        Where they point back it contains a half-turn about the camera's y axis.
        None where they are fewer than six, or the camera is turned by no more than they may be off.
    """
    lengths = np.linalg.norm(steps, axis=1)
    moves = lengths > 0
    if np.count_nonzero(moves) < _FEWEST_STEPS:
        return None
    ways, seen = steps[moves] / lengths[moves, None], directions[moves]
    if np.quantile(np.sum(ways * seen, axis=1), _SHARE_OPPOSED) < _OPPOSED:
        turn = _turn_between(ways @ _HALF_TURN.T, seen)
        return _HALF_TURN if turn is None else turn @ _HALF_TURN
    return _turn_between(ways, seen)


def _turn_between(ways: FloatArray, seen: FloatArray) -> FloatArray | None:
    """The rotation (3, 3) that brings some unit vectors (n, 3) to others; None if it is insignificant."""
    turns = np.cross(ways, seen)  # as long as the sines of their angles
    turn = np.median(turns, axis=0)
    scatter = float(np.median(np.linalg.norm(turns - turn, axis=1)))
    least = max(_LEAST_RAD, _SIGMAS * _MEDIAN_ERROR * scatter / np.sqrt(len(turns)))
    sine, cosine = np.linalg.norm(turn), np.median(np.sum(ways * seen, axis=1))
    return so3.exp(turn * (np.arctan2(sine, cosine) / sine)) if sine > least else None
