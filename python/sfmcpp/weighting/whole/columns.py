"""Which column of the normal equations belongs to which parameter of the cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry.so3 import exp, hat
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray

POSE_SIZE = 6


@dataclass(frozen=True)
class CameraColumns:
    """Columns of poses and intrinsics; what is fixed has the column `count`, which is dropped in the end.

    Attributes
    ----------
    count : int
        Number of columns.
    pose : (C, 6) int32
        Columns of rotation (R ← R exp(δ)) and centre.
    intrinsics : (G, K) int32
        Columns of the intrinsic parameters.
    """

    count: int
    pose: IndexArray
    intrinsics: IndexArray

    @property
    def free_intrinsics(self) -> IndexArray:
        """Numbers of the intrinsic parameters that are free in any row."""
        return np.flatnonzero((self.intrinsics < self.count).any(axis=0)).astype(np.int32)


def camera_columns(problem: Problem) -> CameraColumns:
    """Number the free parameters of cameras that have observations.

    Parameters
    ----------
    problem : Problem
        Of a metric camera model.

    Returns
    -------
    CameraColumns
        Poses first, camera by camera, then the rows of intrinsics.
    """
    seen = np.bincount(problem.camera_index, minlength=problem.num_cameras) > 0
    used = np.bincount(problem.intrinsics_index[seen], minlength=len(problem.intrinsics)) > 0
    free_pose = np.repeat(seen & ~problem.fixed_cameras, POSE_SIZE)
    free = np.concatenate([free_pose, (used[:, None] & ~problem.fixed_intrinsics).ravel()])
    count = int(free.sum())
    numbers = np.where(free, np.cumsum(free) - 1, count).astype(np.int32)
    split = len(free_pose)
    return CameraColumns(
        count, numbers[:split].reshape(-1, POSE_SIZE), numbers[split:].reshape(problem.intrinsics.shape)
    )


def similarity_motions(problem: Problem, columns: CameraColumns) -> FloatArray:
    """How the free parameters of cameras answer to a small turn, shift and growth of the world.

    Parameters
    ----------
    problem : Problem
        The cameras.
    columns : CameraColumns
        Their columns.

    Returns
    -------
    (n, 7) float64
        Three turns about the middle of the cameras, three shifts and the growth.
    """
    count = problem.num_cameras
    centres = problem.centres - problem.centres.mean(axis=0)
    motions = np.zeros((count, POSE_SIZE, 7))
    motions[:, :3, :3] = np.swapaxes(problem.rotations, 1, 2)
    motions[:, 3:, :3] = -hat(centres)
    motions[:, 3:, 3:6] = np.eye(3)
    motions[:, 3:, 6] = centres
    found = np.zeros((columns.count + 1, 7))
    found[columns.pose] = motions
    return found[: columns.count]


def moved_poses(cameras: FloatArray, parameter: int, steps: FloatArray) -> FloatArray:
    """Poses with one of their six parameters changed.

    Parameters
    ----------
    cameras : (n, 3, 4) float64
        Poses, world_from_camera.
    parameter : int
        0 to 2: rotation [rad], in the frame of the camera; 3 to 5: centre.
    steps : (n,) float64
        Changes.

    Returns
    -------
    (n, 3, 4) float64
        The changed poses.
    """
    moved: FloatArray = cameras.copy()
    if parameter >= 3:
        moved[:, parameter - 3, 3] += steps
        return moved
    turn = np.zeros((len(cameras), 3))
    turn[:, parameter] = steps
    moved[:, :, :3] = cameras[:, :, :3] @ exp(turn)
    return moved
