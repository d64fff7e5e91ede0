"""Derivatives of functions of poses and points by central differences."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from sfmcpp.model.arrays import FloatArray

_TANGENT = 6
# Central differences of a double are best at its third root.
_STEP = float(np.cbrt(np.finfo(float).eps))


def by_pose(residuals: Callable[[FloatArray], FloatArray], poses: FloatArray) -> FloatArray:
    """Derivatives of residuals by poses, twelve calls for each pose of a member.

    Parameters
    ----------
    residuals : callable
        From poses (n, p, 3, 4), rotation world_from_camera and centre, to residuals (n, k).
    poses : (n, p, 3, 4) float64
        Where.

    Returns
    -------
    (n, k, p, 6) float64
        By δR of ``R exp([δR]×)`` [rad], then by the centre.
    """
    steps = np.array([_STEP] * 3 + [_difference_step(poses[..., 3])] * 3)
    columns = [
        [_difference(residuals, partial(_turned_or_shifted, poses, p, k), steps[k]) for k in range(_TANGENT)]
        for p in range(poses.shape[1])
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(columns), (0, 1), (2, 3)))


def by_point(residuals: Callable[[FloatArray], FloatArray], points: FloatArray) -> FloatArray:
    """Derivatives of residuals by points, in six calls.

    Parameters
    ----------
    residuals : callable
        From points (n, 3) to residuals (n, k).
    points : (n, 3) float64
        Where.

    Returns
    -------
    (n, k, 3) float64
        By their coordinates.
    """
    step, axes = _difference_step(points), np.eye(3)
    columns = [_difference(residuals, partial(_shifted_points, points, axis), step) for axis in axes]
    return np.stack(columns, axis=-1)


def _difference_step(places: FloatArray) -> float:
    """Places far away move by as much of their distance; rotations are of the size one."""
    return _STEP * max(1.0, float(np.abs(places).max(initial=0.0)))


def _difference(
    residuals: Callable[[FloatArray], FloatArray], moved: Callable[[float], FloatArray], step: float
) -> FloatArray:
    return np.asarray((residuals(moved(step)) - residuals(moved(-step))) / (2 * step))


def _shifted_points(points: FloatArray, axis: FloatArray, step: float) -> FloatArray:
    return points + step * axis


def _turned_or_shifted(poses: FloatArray, pose: int, k: int, step: float) -> FloatArray:
    """Poses (n, p, 3, 4), one of each member moved along one of its six directions."""
    moved: FloatArray = poses.copy()
    if k >= 3:
        moved[:, pose, k - 3, 3] += step
        return moved
    a, b = (k + 1) % 3, (k + 2) % 3
    turn = np.eye(3)
    turn[[a, b], [a, b]] = np.cos(step)
    turn[a, b], turn[b, a] = -np.sin(step), np.sin(step)
    moved[:, pose, :, :3] = poses[:, pose, :, :3] @ turn
    return moved
