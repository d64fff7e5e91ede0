"""COLMAP's fisheye lenses as a camera function.

The distance from the principal point is ``f θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`` with the angle θ from the
axis (Kannala & Brandt 2006, as OpenCV has it): OPENCV_FISHEYE, and with some or none of its parameters
RADIAL_FISHEYE, SIMPLE_RADIAL_FISHEYE, FISHEYE and SIMPLE_FISHEYE.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model import CameraFunction, Problem
from sfmcpp.model.arrays import FloatArray

# Nearer to the axis than this fraction of the depth, a series takes the place of differences that cancel.
_NEAR = 1e-4
_POWERS = np.array([2, 4, 6, 8])


def project(points: FloatArray, intrinsics: FloatArray) -> FloatArray:
    """Pixels (M, 2) of points (M, 3) in the frame of the camera; NaN on the axis behind it."""
    stretch, _, _ = _stretch(points, intrinsics)
    f, aspect, cx, cy = intrinsics.T[:4]
    x, y, _ = points.T
    return np.stack([f * stretch * x + cx, f * aspect * stretch * y + cy], axis=1)


def jacobians(points: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of :func:`project` by points (M, 2, 3) and intrinsics (M, 2, 8)."""
    stretch, by_radius, by_depth = _stretch(points, intrinsics)
    f, aspect, _, _ = intrinsics.T[:4]
    x, y, _ = points.T
    side = np.stack([x, y], axis=1)
    focal = np.stack([f, f * aspect], axis=1)
    by_point = np.empty((len(points), 2, 3))
    by_point[:, :, :2] = side[:, :, None] * side[:, None, :] * by_radius[:, None, None]
    by_point[:, 0, 0] += stretch
    by_point[:, 1, 1] += stretch
    by_point[:, :, 2] = side * by_depth[:, None]
    by_point *= focal[:, :, None]

    by_intrinsics = np.zeros((len(points), 2, 8))
    by_intrinsics[:, :, 0] = side * stretch[:, None] * np.stack([np.ones_like(f), aspect], axis=1)
    by_intrinsics[:, 1, 1] = f * stretch * y
    by_intrinsics[:, 0, 2] = by_intrinsics[:, 1, 3] = 1.0
    angle, angle_over_radius = _angle(points)
    powers = angle[:, None] ** _POWERS * angle_over_radius[:, None]
    by_intrinsics[:, :, 4:] = (focal * side)[:, :, None] * powers[:, None, :]
    return by_point, by_intrinsics


def _angle(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The angle θ from the axis (M,), and θ over the distance from it (M,)."""
    x, y, z = points.T
    radius = np.hypot(x, y)
    angle = np.arctan2(radius, z)
    with np.errstate(divide="ignore", invalid="ignore"):
        on_axis = np.where(z > 0, 1.0 / z, np.nan)
        return angle, np.where(radius > 0, angle / radius, on_axis)


def _stretch(points: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What x and y are multiplied by before f, its derivative by the radius over the radius, and by z."""
    x, y, z = points.T
    angle, angle_over_radius = _angle(points)
    terms = intrinsics[:, 4:] * angle[:, None] ** _POWERS
    stretch = angle_over_radius * (1.0 + terms.sum(axis=1))
    slope = 1.0 + terms @ (_POWERS + 1.0)  # of the distorted angle by the angle
    radius2 = x**2 + y**2
    distance2 = radius2 + z**2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        near = (z > 0) & (radius2 < (_NEAR * z) ** 2)
        series = (2.0 * intrinsics[:, 4] - 2.0 / 3.0) / z**3
        by_radius = np.where(near, series, (slope * z / distance2 - stretch) / radius2)
        return stretch, by_radius, -slope / distance2


FISHEYE = CameraFunction(
    project,
    ("f", "aspect", "cx", "cy", "k1", "k2", "k3", "k4"),
    jacobians,
    "fisheye",
    ("f", "aspect", "k1", "k2", "k3", "k4"),
)


def is_fisheye(problem: Problem) -> bool:
    """Whether the cameras of a problem have such lenses."""
    return problem.camera_model is FISHEYE


def errors_px(problem: Problem) -> FloatArray:
    """Distance (M,) of each observation from the image of its point; NaN where there is none [px]."""
    poses = problem.cameras[problem.camera_index]
    points = np.einsum("nji,nj->ni", poses[:, :, :3], problem.points[problem.point_index] - poses[:, :, 3])
    rows = problem.intrinsics[problem.intrinsics_index[problem.camera_index]]
    errors: FloatArray = np.linalg.norm(project(points, rows) - problem.pixels, axis=1)
    return errors
