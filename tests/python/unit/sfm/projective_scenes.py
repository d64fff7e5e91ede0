"""Scenes of unknown calibration and known truth: how cameras move, and a world that nobody can measure in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sfmcpp import Problem, as_projective, projection_matrices, projective_problem, solve
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, UP, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import observe

Array = NDArray[np.float64]

SIZE = (640, 480)
FOCAL = 1000.0


def poses_of(motion: str, count: int, rng: np.random.Generator) -> Array:
    """(count, 3, 4) poses that look at a cube at the origin from about 20 m."""
    angle = np.radians(10) * np.arange(count)
    circle = 20 * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    if motion == "turntable":  # from above, and beside the axis
        return looking_at(0.96 * circle + [0, 0, 5.6], np.array([0.3, 0.0, 0.2]), UP)
    if motion == "fixating":  # all axes meet in one point, at one distance
        return looking_at(circle, np.zeros(3), UP)
    if motion == "general":
        centres = rng.standard_normal((count, 3))
        centres *= rng.uniform(15, 25, (count, 1)) / np.linalg.norm(centres, axis=1, keepdims=True)
        poses = looking_at(centres, np.zeros(3), UP)
        poses[:, :, :3] = poses[:, :, :3] @ Rotation.from_rotvec(rng.normal(0, 0.1, (count, 3))).as_matrix()
        return poses
    if motion == "line":  # no rotation
        rotations = np.tile(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), (count, 1, 1))
        centres = np.stack(
            [np.linspace(-4, 4, count), np.full(count, -20.0), rng.normal(0, 0.5, count)], axis=1
        )
    else:  # straight down, turned about the vertical alone
        turns = Rotation.from_rotvec(rng.uniform(0, 6, (count, 1)) * [0, 0, 1]).as_matrix()
        rotations = np.diag([1.0, -1.0, -1.0]) @ turns
        centres = np.column_stack([rng.uniform(-2, 2, (count, 2)), np.full(count, 20.0)])
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def metric_scene(
    motion: str, seed: int, *, sigma_px: float = 0.0, num_cameras: int = 12, num_points: int = 150
) -> Problem:
    """The truth; its pixels have noise."""
    rng = np.random.default_rng(seed)
    geometry = ImageGeometry("perspective", FOCAL, SIZE, NO_DISTORTION)
    poses = poses_of(motion, num_cameras, rng)
    points = rng.uniform(-2.5, 2.5, (num_points, 3))
    return observe(geometry, poses, points, sigma_px, rng)


def projective_scene(truth: Problem, seed: int, *, adjusted: bool = True) -> Problem:
    """The same observations, adjusted without any calibration, in a world turned by a random homography."""
    problem = as_projective(truth)
    if adjusted:
        solve(problem, max_iterations=20, threads=1)
    homography = np.random.default_rng([seed, 1]).standard_normal((4, 4))
    return projective_problem(
        projection_matrices(problem) @ homography,
        np.linalg.solve(homography, problem.points.T).T,
        problem.camera_index,
        problem.point_index,
        problem.pixels,
        metadata=problem.metadata,
    )


def turns_deg(rotations: Array) -> Array:
    """(C − 1,) angles between one rotation and the next [deg]."""
    steps = np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:]
    return np.degrees(Rotation.from_matrix(steps).magnitude())
