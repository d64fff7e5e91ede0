"""Camera models as Python functions: a fisheye, and the built-in BAL camera with its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import CameraFunction, Problem

Array = NDArray[np.float64]
FISHEYE = ("f", "cx", "cy", "k1", "k2")


def fisheye(points: Array, intrinsics: Array) -> Array:
    """Kannala & Brandt 2006: radius f θ (1 + k1 θ² + k2 θ⁴), θ the angle to the axis; behind it, too."""
    f, cx, cy, k1, k2 = intrinsics.T
    radius = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(radius, points[:, 2])
    scale = f * angle * (1 + k1 * angle**2 + k2 * angle**4) / radius
    return np.stack([scale * points[:, 0] + cx, scale * points[:, 1] + cy], axis=1)


def bal(points: Array, intrinsics: Array) -> Array:
    f, k1, k2 = intrinsics.T
    x = points[:, :2] / points[:, 2:]
    r2 = np.sum(x**2, axis=1)
    return np.asarray((f * (1 + k1 * r2 + k2 * r2**2))[:, None] * x)


def bal_jacobians(points: Array, intrinsics: Array) -> tuple[Array, Array]:
    f, k1, k2 = intrinsics.T
    depth = points[:, 2]
    x = points[:, :2] / depth[:, None]
    r2 = np.sum(x**2, axis=1)
    scale, slope = 1 + k1 * r2 + k2 * r2**2, 2 * (k1 + 2 * k2 * r2)
    by_plane = f[:, None, None] * (
        scale[:, None, None] * np.eye(2) + slope[:, None, None] * x[:, :, None] * x[:, None]
    )
    by_point = np.concatenate([by_plane, -by_plane @ x[:, :, None]], axis=2) / depth[:, None, None]
    by_intrinsics = np.stack([scale[:, None] * x, (f * r2)[:, None] * x, (f * r2**2)[:, None] * x], axis=2)
    return by_point, by_intrinsics


def own_bal(with_jacobians: bool = True) -> CameraFunction:
    jacobians = bal_jacobians if with_jacobians else None
    return CameraFunction(bal, ("f", "k1", "k2"), jacobians, name="own", free_by_default=("f", "k1", "k2"))


def copied(problem: Problem, model: CameraFunction) -> Problem:
    """The problem with a function in place of the model that it copies."""
    return replace(problem.copy(), camera_model=model)


def fisheye_scene(seed: int = 1) -> tuple[Problem, Problem]:
    """A truth with points all around six cameras, some behind each of them, and a start aside of it."""
    rng = np.random.default_rng(seed)
    model = CameraFunction(fisheye, FISHEYE, free_by_default=FISHEYE)
    turns = sfmcpp.circle_scene(6, 10, seed=seed).rotations
    cameras = np.concatenate([turns, rng.normal(0, 1, (6, 3, 1))], axis=2)
    points = rng.normal(0, 1, (60, 3))
    points *= rng.uniform(4, 8, (60, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    camera, point = (index.ravel() for index in np.indices((6, 60)))
    in_camera = np.einsum("nji,nj->ni", cameras[camera, :, :3], points[point] - cameras[camera, :, 3])
    row = np.array([[300.0, 500.0, 480.0, 0.02, -0.004]])
    seen = np.arctan2(np.hypot(in_camera[:, 0], in_camera[:, 1]), in_camera[:, 2]) < 2.0
    camera, point, in_camera = camera[seen], point[seen], in_camera[seen]
    pixels = fisheye(in_camera, np.repeat(row, len(camera), axis=0)) + rng.normal(0, 0.5, (len(camera), 2))
    truth = Problem(
        model, cameras, row, points, camera, point, pixels, intrinsics_index=np.zeros(6, dtype=np.int32)
    )
    start = sfmcpp.perturb(
        truth, point_sigma_m=0.05, position_sigma_m=0.05, rotation_sigma_deg=0.5, seed=seed
    )
    start.intrinsics += [[5.0, 3.0, -3.0, 0.01, 0.001]]
    return truth, start
