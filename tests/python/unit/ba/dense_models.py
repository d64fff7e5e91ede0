"""Problems whose linear models are small, and dense covariances of these, by the normal matrix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import LinearModel, Problem

Array = NDArray[np.float64]
METRIC = ("calibrated", "perspective", "shared", "bal")


def problem_of(camera_model: str) -> Problem:
    """Each model, perturbed; "shared" has two rows of intrinsics for three cameras each."""
    name = "perspective" if camera_model == "shared" else camera_model
    truth = sfmcpp.circle_scene(6, 24, camera_model=name, pixel_sigma_px=1.0, seed=1)
    private = sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=2)
    if camera_model != "shared":
        return private
    return Problem(
        "perspective",
        private.cameras,
        private.intrinsics[:2].copy(),
        private.points,
        private.camera_index,
        private.point_index,
        private.pixels,
        intrinsics_index=np.repeat(np.arange(2, dtype=np.int32), 3),
    )


def root_of_normal_matrix(model: LinearModel) -> Array:
    """All rows, those of constraints times the roots of their weights: H is its square."""
    rows = [model.jacobian().toarray()]
    for group in model.groups:
        own = np.sqrt(group.weight) * group.jacobian().toarray()
        rows.append(np.pad(own, ((0, 0), (0, model.num_columns - own.shape[1]))))
    return np.concatenate(rows)


def exact_inverse(matrix: Array) -> Array:
    """Of a positive definite matrix of long doubles, by Gauss and Jordan: NumPy has no more than doubles."""
    n, scale = len(matrix), np.sqrt(np.diag(matrix))
    both = np.concatenate([matrix / np.outer(scale, scale), np.eye(n, dtype=np.longdouble)], axis=1)
    for k in range(n):
        both[k] /= both[k, k]
        factors = both[:, k].copy()
        factors[k] = 0
        both -= np.outer(factors, both[k])
    return np.asarray(both[:, n:] / np.outer(scale, scale))


def dense_covariance(model: LinearModel) -> Array:
    """H⁻¹, or ``H⁺ = (H + NNᵀ)⁻¹ − NNᵀ`` with N an orthonormal basis of what H does not see."""
    root = root_of_normal_matrix(model)
    _, sizes, vectors = np.linalg.svd(root, full_matrices=False)
    unseen = vectors[sizes < 1e-10 * sizes[0]].T.astype(np.longdouble)
    normal = root.astype(np.longdouble).T @ root
    if unseen.shape[1]:  # sharper, by inverse iteration
        unseen = exact_inverse(normal + 1e-6 * np.eye(len(normal))) @ unseen
        for j in range(unseen.shape[1]):
            for _ in range(2):
                unseen[:, j] -= unseen[:, :j] @ (unseen[:, :j].T @ unseen[:, j])
            unseen[:, j] /= np.sqrt(unseen[:, j] @ unseen[:, j])
    both = unseen @ unseen.T
    return np.asarray(exact_inverse(normal + both) - both, dtype=np.float64)


def assert_same_covariance(found: Array, expected: Array) -> None:
    scale = np.sqrt(np.diag(expected))
    assert (np.abs(found - expected) <= 1e-9 * np.outer(scale, scale)).all()


def odd_problem(camera_model: str) -> Problem:
    """With a fixed point beside the free ones, which leaves the gauge a turn and a growth."""
    problem = problem_of(camera_model)
    problem.fixed_points[3] = True
    return problem
