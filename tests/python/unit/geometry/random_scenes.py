"""Random scenes of known truth, and projections and errors written another way than in the package."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sfmcpp import Problem

Array = NDArray[np.float64]
INTRINSICS = np.array([700.0, 1.1, 310.0, 250.0, 4.0])


@dataclass
class Pair:
    """Two cameras, the first at the origin, and the exact images of points that both see."""

    camera: Array
    points: Array
    pixels_1: Array
    pixels_2: Array


def calibration(row: Array) -> Array:
    f, aspect, cx, cy, skew = row
    return np.array([[f, skew, cx], [0, aspect * f, cy], [0, 0, 1]])


def projection_matrix(camera: Array, row: Array) -> Array:
    """``K`` times the inverse of the pose, 3×4."""
    return calibration(row) @ np.linalg.inv(np.vstack([camera, [0, 0, 0, 1]]))[:3]


def project(camera: Array, row: Array, points: Array) -> Array:
    image = np.column_stack([points, np.ones(len(points))]) @ projection_matrix(camera, row).T
    return image[:, :2] / image[:, 2:]


def random_camera(rng: np.random.Generator, baseline: float = 1.0, max_angle_rad: float = 0.3) -> Array:
    turn = Rotation.from_rotvec(max_angle_rad * rng.uniform(-1, 1, 3) / np.sqrt(3)).as_matrix()
    direction = rng.standard_normal(3)
    return np.column_stack([turn, baseline * direction / np.linalg.norm(direction)])


def random_pair(seed: int, count: int = 200, row: Array = INTRINSICS) -> Pair:
    rng = np.random.default_rng(seed)
    camera = random_camera(rng)
    points = rng.uniform([-4, -3, 4], [4, 3, 12], (count, 3))
    return Pair(camera, points, project(np.eye(3, 4), row, points), project(camera, row, points))


def spoil(pixels: Array, fraction: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Put that fraction of the pixels anywhere in a wide image, in place; where."""
    spoilt = rng.permutation(len(pixels)) < fraction * len(pixels)
    pixels[spoilt] = rng.uniform([-300, -300], [1000, 900], (np.count_nonzero(spoilt), 2))
    return spoilt


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two vectors, or of the rotation between two rotation matrices."""
    if a.ndim == 2:
        return float(np.degrees(Rotation.from_matrix(a.T @ b).magnitude()))
    return float(
        np.degrees(2 * np.arcsin(min(1.0, np.linalg.norm(a / np.linalg.norm(a) - b / np.linalg.norm(b)) / 2)))
    )


def ragged_problem(
    seed: int, num_points: int = 60, num_cameras: int = 7, sigma_px: float = 0.0, min_views: int = 2
) -> Problem:
    """Every point seen by its own random set of cameras, in random order; intrinsics of two groups."""
    rng = np.random.default_rng(seed)
    cameras = np.stack([random_camera(rng, rng.uniform(0.5, 2)) for _ in range(num_cameras)])
    points = rng.uniform([-4, -3, 6], [4, 3, 14], (num_points, 3))
    rows = np.stack([INTRINSICS, [900.0, 0.9, 400.0, 200.0, -2.0]])
    group = rng.integers(2, size=num_cameras)
    seen = rng.random((num_points, num_cameras)) < 0.4
    for row in seen:
        row[rng.permutation(num_cameras)[:min_views]] = True
    point_index, camera_index = rng.permutation(np.argwhere(seen)).T
    pixels = np.array(
        [
            project(cameras[c], rows[group[c]], points[p : p + 1])[0]
            for c, p in zip(camera_index, point_index, strict=True)
        ]
    )
    pixels += sigma_px * rng.standard_normal(pixels.shape)
    return Problem(
        "calibrated", cameras, rows, points, camera_index, point_index, pixels, intrinsics_index=group
    )


def views_of(problem: Problem, point: int) -> list[tuple[Array, Array]]:
    """Projection matrix and pixel of each observation of one point."""
    rows = problem.intrinsics[problem.intrinsics_index]
    return [
        (projection_matrix(problem.cameras[c], rows[c]), problem.pixels[m])
        for m, c in enumerate(problem.camera_index)
        if problem.point_index[m] == point
    ]


def residuals_of(views: list[tuple[Array, Array]], point: Array) -> Array:
    """Reprojection residuals [px] of one point, one after the other."""
    images = [matrix @ np.append(point, 1.0) for matrix, _ in views]
    return np.concatenate([h[:2] / h[2] - pixel for h, (_, pixel) in zip(images, views, strict=True)])


def angle_between(one: Array, other: Array) -> float:
    """Angle [rad] between two rotation matrices."""
    return float((Rotation.from_matrix(one).inv() * Rotation.from_matrix(other)).magnitude())


def random_poses(rng: np.random.Generator, count: int, spread_m: float = 5.0) -> Array:
    """Poses (count, 3, 4) anywhere within a few metres."""
    rotations = Rotation.random(count, rng=rng).as_matrix()
    return np.concatenate([rotations, rng.normal(0, spread_m, (count, 3, 1))], axis=2)
