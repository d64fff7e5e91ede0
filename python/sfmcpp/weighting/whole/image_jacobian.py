"""Residuals of all observations and their derivatives, as arrays.

The derivatives are central differences of the core's residuals. A residual depends on one camera, one row of
intrinsics and one point, so that one parameter of *all* cameras is moved at once: two evaluations for each of
the 6 + 3 parameters and of the free intrinsics, whatever the size of the problem, and for any camera model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.weighting.whole.columns import (
    POSE_SIZE,
    CameraColumns,
    camera_columns,
    moved_poses,
    similarity_motions,
)

# Steps of the differences: of an angle [rad], of a length over the distance it is seen from, of an intrinsic
# parameter over its size.
_STEP = 1e-5


@dataclass(frozen=True)
class ImageJacobian:
    """Residuals (observed − projected) / σ and their Jacobian by blocks.

    Attributes
    ----------
    residuals : (M, 2) float64
        In the order of the observations.
    by_camera : (M, 2, D) float64
        By the pose and the free intrinsics of the camera.
    columns : (M, D) int32
        The columns of these derivatives; the dropped one where a parameter is fixed.
    by_point : (M, 2, 3) float64
        By the point; zero for a fixed one.
    camera_index, point_index : (M,) int32
        Camera and point of each observation.
    cameras : CameraColumns
        Which columns there are.
    motions : (n, 7) float64
        How they answer to motions of the world.
    """

    residuals: FloatArray
    by_camera: FloatArray
    columns: IndexArray
    by_point: FloatArray
    camera_index: IndexArray
    point_index: IndexArray
    cameras: CameraColumns
    motions: FloatArray


def image_jacobian(problem: Problem) -> ImageJacobian:
    """Linearise the observations at the present state.

    Parameters
    ----------
    problem : Problem
        Of a metric camera model; left untouched.

    Returns
    -------
    ImageJacobian
        Residuals and derivatives.

    Raises
    ------
    InvalidArgument
        If the problem breaks a rule.
    """
    columns = camera_columns(problem)
    free = columns.free_intrinsics
    lengths_by_camera, lengths_by_point = _shortest_distances(problem)
    by_camera = [
        *(_by_pose(problem, k, lengths_by_camera) for k in range(POSE_SIZE)),
        *(_by_intrinsic(problem, int(k)) for k in free),
    ]
    by_point = np.stack([_by_point(problem, k, lengths_by_point) for k in range(3)], axis=-1)
    by_point[problem.fixed_points[problem.point_index]] = 0.0
    per_camera = np.concatenate([columns.pose, columns.intrinsics[problem.intrinsics_index][:, free]], axis=1)
    of_observation = per_camera[problem.camera_index]
    jacobian = np.stack(by_camera, axis=-1)
    jacobian *= (of_observation < columns.count)[:, None, :]
    return ImageJacobian(
        residuals=_core.residuals(core_arrays(problem)),
        by_camera=jacobian,
        columns=of_observation,
        by_point=by_point,
        camera_index=problem.camera_index,
        point_index=problem.point_index,
        cameras=columns,
        motions=similarity_motions(problem, columns),
    )


def _shortest_distances(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """From each camera to its nearest point, and from each point to its nearest camera."""
    cameras, points = problem.camera_index, problem.point_index
    apart = np.linalg.norm(problem.points[points] - problem.centres[cameras], axis=1)
    by_camera, by_point = np.full(problem.num_cameras, np.inf), np.full(problem.num_points, np.inf)
    np.minimum.at(by_camera, cameras, apart)
    np.minimum.at(by_point, points, apart)
    return tuple(np.where(np.isfinite(d) & (d > 0), d, 1.0) for d in (by_camera, by_point))  # type: ignore[return-value]


def _by_pose(problem: Problem, parameter: int, lengths: FloatArray) -> FloatArray:
    steps = _STEP * (lengths if parameter >= 3 else np.ones_like(lengths))
    ends = [_residuals(problem, cameras=moved_poses(problem.cameras, parameter, s)) for s in (steps, -steps)]
    return _slope(ends, steps[problem.camera_index])


def _by_intrinsic(problem: Problem, parameter: int) -> FloatArray:
    size = np.abs(problem.intrinsics[:, parameter])
    steps = _STEP * np.where(size > _STEP, size, 1.0)
    change = np.zeros_like(problem.intrinsics)
    change[:, parameter] = steps
    ends = [_residuals(problem, intrinsics=problem.intrinsics + s * change) for s in (1, -1)]
    return _slope(ends, steps[problem.intrinsics_index][problem.camera_index])


def _by_point(problem: Problem, axis: int, lengths: FloatArray) -> FloatArray:
    change = np.zeros_like(problem.points)
    change[:, axis] = steps = _STEP * lengths
    ends = [_residuals(problem, points=problem.points + s * change) for s in (1, -1)]
    return _slope(ends, steps[problem.point_index])


def _residuals(problem: Problem, **changed: FloatArray) -> FloatArray:
    return np.asarray(_core.residuals(core_arrays(replace(problem, **changed))))  # type: ignore[arg-type]


def _slope(ends: list[FloatArray], steps: FloatArray) -> FloatArray:
    return np.asarray((ends[0] - ends[1]) / (2 * steps[:, None]))
