"""KITTI drives as MATLAB files: stereo tracks, the vehicle's speed and turn rate, and the true trajectory.

The layout of ``2011_…_sync_KLT.mat``: ``y_k_j`` (4, frames, tracks) holds u and v of the left, then of the
right image, −1 where a track is not seen. A world point p is at ``C_c_v (exp(−[θ_k]×)(p − r_k) − ρ_v_c_v)``
in the left camera of frame k. Speed, rate and truth can go on after the last stamp of ``t``; that part has no
times and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.so3 import nearest_rotation, rotation_from_angle_axis
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.sources.io.mat_files import mat_variables, number_array, require_finite

NOT_SEEN = -1.0

# Shape of each variable; a name stands for a length that is the same wherever it is named.
_SHAPES: dict[str, tuple[int | str, ...]] = {
    "y_k_j": (4, "frames", "tracks"),
    "t": (1, "frames"),
    "v_vk_vk_i": (3, "samples"),
    "w_vk_vk_i": (3, "samples"),
    "r_i_vk_i": (3, "samples"),
    "theta_vk_i": (3, "samples"),
    "C_c_v": (3, 3),
    "rho_v_c_v": (3, 1),
    "fu": (1, 1),
    "fv": (1, 1),
    "cu": (1, 1),
    "cv": (1, 1),
    "b": (1, 1),
}


@dataclass(frozen=True, eq=False)
class KittiDrive:
    """A drive: n frames, M observations of tracks, and what the vehicle measured.

    Attributes
    ----------
    t_s : (n,) float64
        Time of each frame [s].
    frame_index, track_index : (M,) int32
        Frame and track of each observation, by frame and then by track.
    left_px, right_px : (M, 2) float64
        Where the left and the right camera see it [px].
    num_tracks : int
        Number of tracks.
    focal_px, principal_point_px : (2,) float64
        ``fu, fv`` and ``cu, cv`` of both cameras [px].
    baseline_m : float
        Distance of the right camera from the left one [m].
    camera_from_body : (3, 3) float64
        Rotation ``C_c_v``.
    lever_arm_m : (3,) float64
        Centre of the left camera in the body frame, ``ρ_v_c_v`` [m].
    velocity : SensorStream
        Velocity of the body in its own frame, kind ``"velocity"``.
    angular_rate : SensorStream
        Angular rate of the body in its own frame, kind ``"angular_rate"``.
    truth : Trajectory
        True poses of the left camera.
    """

    t_s: FloatArray
    frame_index: IndexArray
    track_index: IndexArray
    left_px: FloatArray
    right_px: FloatArray
    num_tracks: int
    focal_px: FloatArray
    principal_point_px: FloatArray
    baseline_m: float
    camera_from_body: FloatArray
    lever_arm_m: FloatArray
    velocity: SensorStream
    angular_rate: SensorStream
    truth: Trajectory

    @property
    def intrinsics(self) -> FloatArray:
        """``(f, aspect, cx, cy, skew)`` of both cameras."""
        (fu, fv), (cu, cv) = self.focal_px, self.principal_point_px
        return np.array([fu, fv / fu, cu, cv, 0.0])


def read_kitti_mat(path: Path) -> KittiDrive:
    """Read a drive.

    Parameters
    ----------
    path : Path
        A ``…_KLT.mat`` file.

    Returns
    -------
    KittiDrive

    Raises
    ------
    DatasetError
        If the file cannot be read, or a variable is missing or has a wrong shape or an impossible value.
    """
    variables = _variables(path)
    _require_positive(path, variables, "fu", "fv")
    stamps = variables["t"][0]
    frame, track = np.nonzero((variables["y_k_j"] != NOT_SEEN).all(axis=0))
    pixels = variables["y_k_j"][:, frame, track].T
    rotation = _rotation(path, variables["C_c_v"])
    lever_arm = variables["rho_v_c_v"][:, 0]
    try:
        return KittiDrive(
            stamps,
            frame.astype(np.int32),
            track.astype(np.int32),
            np.ascontiguousarray(pixels[:, :2]),
            np.ascontiguousarray(pixels[:, 2:]),
            variables["y_k_j"].shape[2],
            _numbers(variables, "fu", "fv"),
            _numbers(variables, "cu", "cv"),
            float(variables["b"][0, 0]),
            rotation,
            lever_arm,
            SensorStream(stamps, _velocities(variables), "velocity", "velocity"),
            SensorStream(stamps, _rows_with_times(variables, "w_vk_vk_i"), "angular_rate", "gyro"),
            Trajectory(stamps, _camera_poses(variables, rotation, lever_arm)),
        )
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error


def _variables(path: Path) -> dict[str, FloatArray]:
    content = mat_variables(path, list(_SHAPES))
    lengths: dict[str, int] = {}
    variables = {name: _variable(path, name, content[name], lengths) for name in _SHAPES}
    if not 1 <= lengths["frames"] <= lengths["samples"]:
        reason = (
            f"{lengths['samples']} samples of v_vk_vk_i for {lengths['frames']} stamps in t: must be as many"
        )
        raise DatasetError(path, f"{reason}, or more, and one at least")
    return variables


def _variable(path: Path, name: str, value: NDArray[Any], lengths: dict[str, int]) -> FloatArray:
    shape = _SHAPES[name]
    array = number_array(path, name, value, len(shape), _shape_text(shape))
    for wanted, found in zip(shape, value.shape, strict=True):
        known = wanted if isinstance(wanted, int) else lengths.setdefault(wanted, found)
        if found != known:
            raise DatasetError(
                path, f"{name} has shape {value.shape}: must be {_shape_text(shape)}, {lengths}"
            )
    require_finite(path, name, array)
    return array


def _shape_text(shape: tuple[int | str, ...]) -> str:
    return f"({', '.join(map(str, shape))})"


def _require_positive(path: Path, variables: dict[str, FloatArray], *names: str) -> None:
    for name in names:
        if not variables[name][0, 0] > 0:
            raise DatasetError(path, f"{name} is {variables[name][0, 0]:g}: must be positive")


def _numbers(variables: dict[str, FloatArray], *names: str) -> FloatArray:
    return np.array([variables[name][0, 0] for name in names])


def _rows_with_times(variables: dict[str, FloatArray], name: str) -> FloatArray:
    return np.ascontiguousarray(variables[name].T[: variables["t"].shape[1]])


def _velocities(variables: dict[str, FloatArray]) -> FloatArray:
    """Velocities (n, 3) in the body's frame, whose y axis points left.

    That of ``v_vk_vk_i`` points right: turned, its directions are 0.20, 0.36, 0.29 and 0.54 degrees off
    those of the poses of 0001, 0027, 0036 and 0039 (root mean square, about the vertical), else 0.89, 0.68,
    0.67 and 0.70.
    """
    return np.asarray(_rows_with_times(variables, "v_vk_vk_i") * np.array([1.0, -1.0, 1.0]))


def _rotation(path: Path, matrix: FloatArray) -> FloatArray:
    if not is_rotation(matrix[None], PRINTED_ROTATION_TOLERANCE)[0]:
        raise DatasetError(path, f"C_c_v is no rotation: must be orthonormal to {PRINTED_ROTATION_TOLERANCE}")
    return np.asarray(nearest_rotation(matrix[None])[0])


def _camera_poses(
    variables: dict[str, FloatArray], camera_from_body: FloatArray, lever_arm: FloatArray
) -> FloatArray:
    world_from_body = rotation_from_angle_axis(_rows_with_times(variables, "theta_vk_i"))
    centres = _rows_with_times(variables, "r_i_vk_i") + world_from_body @ lever_arm
    return np.concatenate([world_from_body @ camera_from_body.T, centres[:, :, None]], axis=2)
