"""An independent projection in plain NumPy, the reference for the core."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
