"""An independent projection in plain NumPy, and minima by SciPy: the references for the core."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sfmcpp import Problem


def distorted(x: NDArray, y: NDArray, k: dict[str, NDArray]) -> tuple[NDArray, NDArray]:
    """Brown's radial and tangential distortion, as OpenCV documents it."""
    r2 = x * x + y * y
    radial = 1 + sum(k[f"k{n}"] * r2**n for n in range(1, 6))
    dx = 2 * k["p1"] * x * y + k["p2"] * (r2 + 2 * x * x)
    dy = k["p1"] * (r2 + 2 * y * y) + 2 * k["p2"] * x * y
    return radial * x + dx, radial * y + dy


def reference_residuals(problem: Problem) -> NDArray[np.float64]:
    """(M, 2) residuals (observed − projected) / σ."""
    rows = problem.intrinsics[problem.intrinsics_index[problem.camera_index]]
    k = {name: np.zeros(len(rows)) for name in ("cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "p1", "p2")}
    k["aspect"] = np.ones(len(rows))
    k.update(zip(problem.intrinsic_names, rows.T, strict=True))
    offset = problem.points[problem.point_index] - problem.centres[problem.camera_index]
    camera = np.einsum("mij,mi->mj", problem.rotations[problem.camera_index], offset)
    x, y = distorted(camera[:, 0] / camera[:, 2], camera[:, 1] / camera[:, 2], k)
    u = k["f"] * x + k["skew"] * y + k["cx"]
    v = k["f"] * k["aspect"] * y + k["cy"]
    residuals = problem.pixels - np.stack([u, v], axis=1)
    return residuals if problem.sigma_px is None else residuals / problem.sigma_px[:, None]


def minimum_by_scipy(start: Problem, residuals: Callable[[Problem], NDArray[np.float64]]) -> float:
    """The least half sum of squares of residuals of a problem, by its poses and points."""

    def residuals_at(x: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = start.copy()
        steps = x[: 6 * start.num_cameras].reshape(-1, 6)
        moved.rotations[:] = start.rotations @ Rotation.from_rotvec(steps[:, :3]).as_matrix()
        moved.centres[:] = start.centres + steps[:, 3:]
        moved.points[:] = start.points + x[6 * start.num_cameras :].reshape(-1, 3)
        return residuals(moved).ravel()

    unknowns = 6 * start.num_cameras + 3 * start.num_points
    return float(least_squares(residuals_at, np.zeros(unknowns), x_scale="jac", ftol=1e-12).cost)
