"""SciPy's `least_squares` (trust region reflective) with an analytic sparse Jacobian in NumPy.

It takes seconds an iteration, so a run ends after `MAX_SECONDS` and is not repeated.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from harness.bal_file import (
    BalProblem,
    FloatArray,
    State,
    cross_matrices,
    points_in_cameras,
    residuals_px,
)
from harness.in_process import InProcessPeer, Solution
from harness.protocol import Job, Variant

MAX_SECONDS = 30.0


class Scipy(InProcessPeer):
    """`trf` with `lsmr` inside, columns scaled by the Jacobian."""

    name = "scipy"
    title = "SciPy"
    package = "scipy.optimize"
    max_repeats = 1

    def variants(self, threads: int) -> list[Variant]:
        """One way only."""
        return [Variant("", {"method": "trf", "tr_solver": "lsmr"})]

    def prepare(self, problem: BalProblem, job: Job, settings: dict[str, str]) -> Callable[[], Solution]:
        """Parameters in one vector: cameras, then points."""
        from scipy.optimize import least_squares  # type: ignore[import-untyped,unused-ignore]

        start = np.concatenate([problem.cameras.ravel(), problem.points.ravel()])
        jacobian = SparseJacobian(problem)

        def residuals(x: FloatArray) -> FloatArray:
            return residuals_px(problem, unpack(problem, x)).ravel()

        def solve() -> Solution:
            recorder = Recorder(min(MAX_SECONDS, job.max_seconds))
            recorder.record(0.5 * float(np.sum(residuals(start) ** 2)))
            result = least_squares(
                residuals,
                start,
                jacobian,
                ftol=job.rule.function_tolerance,
                xtol=None,
                gtol=None,
                x_scale="jac",
                max_nfev=job.rule.max_iterations,
                callback=recorder,
                **settings,
            )
            return Solution(recorder.trace, result.cost, result.message, lambda: unpack(problem, result.x))

        return solve


class Recorder:
    """Callback of `least_squares`: notes seconds and cost, ends the run when its time is up."""

    def __init__(self, max_seconds: float) -> None:
        self.began = time.perf_counter()
        self.max_seconds = max_seconds
        self.trace: list[tuple[float, float]] = []

    def record(self, cost: float) -> None:
        """Append an entry to the trace."""
        self.trace.append((time.perf_counter() - self.began, cost))

    def __call__(self, intermediate_result: Any) -> None:
        """One iteration is done."""
        self.record(float(intermediate_result.cost))
        if self.trace[-1][0] > self.max_seconds:
            raise StopIteration


def unpack(problem: BalProblem, x: FloatArray) -> State:
    """The parameter vector as a state."""
    cameras, points = np.split(x, [problem.cameras.size])
    return State.from_parameters(cameras.reshape(-1, 9), points.reshape(-1, 3))


class SparseJacobian:
    """∂r/∂(cameras, points) as CSR, its pattern (twelve columns a row) made once."""

    def __init__(self, problem: BalProblem) -> None:
        self.problem = problem
        camera_columns = 9 * problem.camera_index[:, None] + np.arange(9)
        point_columns = problem.cameras.size + 3 * problem.point_index[:, None] + np.arange(3)
        self.columns = np.repeat(np.hstack([camera_columns, point_columns]), 2, axis=0).ravel()
        self.starts = np.arange(0, len(self.columns) + 1, 12)

    def __call__(self, x: FloatArray) -> Any:
        """The Jacobian at x, a scipy.sparse.csr_matrix of shape (2M, 9C + 3N)."""
        from scipy.sparse import csr_matrix  # type: ignore[import-untyped,unused-ignore]

        camera_blocks, point_blocks = jacobian_blocks(self.problem, x)
        values = np.concatenate([camera_blocks, point_blocks], axis=2).ravel()
        shape = (2 * len(self.problem.pixels), len(x))
        return csr_matrix((values, self.columns, self.starts), shape=shape)


def jacobian_blocks(problem: BalProblem, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(M, 2, 9) by the camera and (M, 2, 3) by the point of each observation."""
    state = unpack(problem, x)
    local = points_in_cameras(problem, state)
    image = -local[:, :2] / local[:, 2:]
    by_image, by_intrinsics = _image_derivatives(problem, state, image)
    by_local = by_image @ _projection_derivative(local, image)
    rotated = local - state.translations[problem.camera_index]
    jl = left_jacobians(x[: problem.cameras.size].reshape(-1, 9)[:, :3])[problem.camera_index]
    by_rotation = -by_local @ cross_matrices(rotated) @ jl
    by_point = by_local @ state.rotations[problem.camera_index]
    return np.concatenate([by_rotation, by_local, by_intrinsics], axis=2), by_point


def _image_derivatives(problem: BalProblem, state: State, image: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(M, 2, 2) of the pixel by the undistorted image point, (M, 2, 3) by f, k1, k2."""
    focal, k1, k2 = state.intrinsics[problem.camera_index].T
    r2 = np.sum(image**2, axis=1)
    distortion = 1.0 + r2 * (k1 + k2 * r2)
    slope = 2.0 * focal * (k1 + 2.0 * k2 * r2)
    outer = image[:, :, None] * image[:, None, :]
    by_image = slope[:, None, None] * outer + (focal * distortion)[:, None, None] * np.eye(2)
    factors = np.stack([distortion, focal * r2, focal * r2**2], axis=1)
    return by_image, image[:, :, None] * factors[:, None, :]


def _projection_derivative(local: FloatArray, image: FloatArray) -> FloatArray:
    """(M, 2, 3) of −P.xy / P.z by P."""
    derivative = np.zeros((len(local), 2, 3))
    derivative[:, 0, 0] = derivative[:, 1, 1] = -1.0
    derivative[:, :, 2] = -image
    return np.asarray(derivative / local[:, 2, None, None])


def left_jacobians(angle_axis: FloatArray) -> FloatArray:
    """Left Jacobians of SO(3), (C, 3, 3): R(w + dw) ≈ exp([Jl dw]×) R(w)."""
    angle = np.linalg.norm(angle_axis, axis=1)[:, None, None]
    cross = cross_matrices(angle_axis)
    linear = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    safe = np.where(angle > 1e-4, angle, 1.0)
    quadratic = np.where(angle > 1e-4, (1.0 - np.sinc(angle / np.pi)) / safe**2, 1.0 / 6.0)
    return np.asarray(np.eye(3) + linear * cross + quadratic * (cross @ cross))


PEER = Scipy()
