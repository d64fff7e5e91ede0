"""A camera that drives forward, sensors of known noise, and the cost of a pose in plain NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sfmcpp.weighting import PoseConstraint, PoseView

Array = NDArray[np.float64]
INTRINSICS = np.array([720.0, 1.0, 600.0, 180.0, 0.0])


def project(pose: Array, points: Array) -> Array:
    inside = (points - pose[:, 3]) @ pose[:, :3]
    return INTRINSICS[0] * inside[:, :2] / inside[:, 2:] + INTRINSICS[2:4]


@dataclass
class Drive:
    """One step of a metre, seen with noise; `truth` is the pose behind it, the earlier pose the identity."""

    view: PoseView
    truth: Array
    rng: np.random.Generator

    def odometer(self, sigma_m: float, factor: float = 1.0, declared: float | None = None) -> PoseConstraint:
        distance = factor * np.linalg.norm(self.truth[:, 3]) + sigma_m * self.rng.standard_normal()
        return PoseConstraint("scale", distance=distance, previous=np.eye(3, 4), sensor_sigma=declared)

    def gyro(self, sigma_rad: float, declared: float | None = None, log: bool = False) -> PoseConstraint:
        error = Rotation.from_rotvec(sigma_rad * self.rng.standard_normal(3)).as_matrix()
        kind = "displacement-rotation-log" if log else "displacement-rotation"
        rotation = self.truth[:, :3] @ error
        return PoseConstraint(kind, rotation=rotation, previous=np.eye(3, 4), sensor_sigma=declared)

    def gps(self, sigma_m: float, declared: float | None = None) -> PoseConstraint:
        centre = self.truth[:, 3] + sigma_m * self.rng.standard_normal(3)
        return PoseConstraint("position", translation=centre, sensor_sigma=declared)


def make_drive(seed: int, count: int = 40, noise_px: float = 1.0) -> Drive:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(5, 45, count)
    points = np.column_stack(
        [rng.uniform(-0.7, 0.7, count) * depth, rng.uniform(-0.2, 0.2, count) * depth, depth]
    )
    turn = Rotation.from_rotvec(0.03 * rng.standard_normal(3)).as_matrix()
    truth = np.column_stack([turn, [0.0, 0.0, 1.0] + 0.05 * rng.standard_normal(3)])
    pixels = project(truth, points) + noise_px * rng.standard_normal((count, 2))
    return Drive(PoseView(points, pixels, INTRINSICS), truth, rng)


def moved(pose: Array, delta: Array) -> Array:
    return np.column_stack(
        [pose[:, :3] @ Rotation.from_rotvec(delta[:3]).as_matrix(), pose[:, 3] + delta[3:]]
    )


def error_vector(constraint: PoseConstraint, pose: Array) -> Array:
    """Residual of a constraint whose earlier pose is the identity, divided by the root of its dimension."""
    if constraint.kind == "scale":
        return np.array([np.linalg.norm(pose[:, 3]) - constraint.distance])
    if constraint.kind == "displacement-rotation":
        return (pose[:, :3].T @ constraint.rotation - np.eye(3)).ravel() / 3
    if constraint.kind == "displacement-rotation-log":
        return Rotation.from_matrix(constraint.rotation.T @ pose[:, :3]).as_rotvec() / np.sqrt(3)
    assert constraint.kind == "position"
    return (pose[:, 3] - constraint.translation) / np.sqrt(3)


def stacked(view: PoseView, weighted: list[tuple[PoseConstraint, float]], pose: Array) -> Array:
    """Residuals whose sum of squares is ``mean ‖r‖² + Σ λ² ε``."""
    images = (view.pixels - project(pose, view.points)).ravel() / np.sqrt(view.count)
    return np.concatenate([images, *(weight * error_vector(c, pose) for c, weight in weighted)])


def slow_fit(view: PoseView, weighted: list[tuple[PoseConstraint, float]], start: Array) -> Array:
    fit = least_squares(
        lambda delta: stacked(view, weighted, moved(start, delta)),
        np.zeros(6),
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
    )
    return moved(start, fit.x)


def slow_leave_one_out(view: PoseView, weighted: list[tuple[PoseConstraint, float]], start: Array) -> float:
    errors = []
    for j in range(view.count):
        others = np.arange(view.count) != j
        fewer = PoseView(view.points[others], view.pixels[others], view.intrinsics)
        pose = slow_fit(fewer, weighted, start)
        errors.append(np.sum((view.pixels[j] - project(pose, view.points[j : j + 1])[0]) ** 2))
    return float(np.mean(errors))
