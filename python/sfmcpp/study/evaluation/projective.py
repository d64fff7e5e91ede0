"""Errors of a projective reconstruction against the truth, up to a homography of the world."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.ba import projection_matrices
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray

_STEPS, _SETTLED, _LEAST_DEPTH, _WHITENINGS = 50, 1e-5, 1e-9, 5


def projective_errors_px(estimate: Problem, truth: Problem, trusted: ArrayLike | None = None) -> FloatArray:
    """How far the points of a reconstruction, brought into the true world, are off in the true images.

    The homography that brings them there has the least sum of these errors: linear from the cameras alone,
    then by Levenberg–Marquardt steps.

    Parameters
    ----------
    estimate : Problem
        Projective or metric.
    truth : Problem
        The same cameras, points and observations in the same order; its pixels are not looked at.
    trusted : (M,) bool, optional
        Observations that the homography is fitted to. Default: all.

    Returns
    -------
    (M,) float64
        Distance of the projections of both points, by the true camera of each observation [px].

    Raises
    ------
    InvalidArgument
        If the counts differ, or `trusted` has another shape or is true nowhere.
    """
    for name in ("num_cameras", "num_points", "num_observations"):
        if getattr(estimate, name) != getattr(truth, name):
            found = f"{getattr(estimate, name)}, the truth has {getattr(truth, name)}"
            raise InvalidArgument(f"estimate: {name} {found}")
    used = np.ones(truth.num_observations, dtype=np.bool_) if trusted is None else np.asarray(trusted)
    if used.shape != (truth.num_observations,) or used.dtype != np.bool_ or not used.any():
        raise InvalidArgument(f"trusted: {used.dtype} {used.shape}, must be (M,) bool, true somewhere")
    world = _Whitened(projection_matrices(truth), truth.points)
    other = _Whitened(projection_matrices(estimate), estimate.points)
    cameras, points = world.cameras[truth.camera_index], other.points[truth.point_index]
    wanted = _homogeneous_projections(cameras, world.points[truth.point_index])
    start = _linear_homography(other, world)
    homography = _refined_homography(start, cameras[used], points[used], wanted[used])
    return np.asarray(
        np.linalg.norm(_homogeneous_projections(cameras, points @ homography.T) - wanted, axis=1)
    )


class _Whitened:
    """Cameras and points in a frame of the world in which unit points scatter alike in all directions."""

    def __init__(self, cameras: FloatArray, points: FloatArray) -> None:
        full = points if points.shape[1] == 4 else np.concatenate([points, np.ones((len(points), 1))], axis=1)
        self.cameras, self.points = cameras, full
        for _ in range(_WHITENINGS):
            self.points = self.points / np.linalg.norm(self.points, axis=1, keepdims=True)
            root = np.linalg.cholesky(self.points.T @ self.points / len(points))
            self.points = np.linalg.solve(root, self.points.T).T
            self.cameras = self.cameras @ root
            self.cameras = self.cameras / np.linalg.norm(self.cameras, axis=(1, 2), keepdims=True)
        self.points = self.points / np.linalg.norm(self.points, axis=1, keepdims=True)


def _linear_homography(one: _Whitened, other: _Whitened) -> FloatArray:
    """H (4, 4) with ``X* ~ H X`` and ``P ~ P* H``: what is across vanishes."""
    # (N, 4, 16) and (C, 12, 16): the entries of H X and of P* H as functions of those of H.
    of_points = np.einsum("ik,nl->nikl", np.eye(4), one.points).reshape(-1, 4, 16)
    of_cameras = np.einsum("cik,jl->cijkl", other.cameras, np.eye(4)).reshape(-1, 12, 16)
    flat = one.cameras.reshape(-1, 12)
    normal = _orthogonal_equations(of_points, other.points) / len(of_points) + _orthogonal_equations(
        of_cameras, flat
    ) / len(of_cameras)
    return np.asarray(np.linalg.eigh(normal)[1][:, 0].reshape(4, 4))


def _orthogonal_equations(design: FloatArray, directions: FloatArray) -> FloatArray:
    """(16, 16) squares of what of ``design h`` is across the unit `directions`."""
    off = design - directions[:, :, None] * np.einsum("ni,nik->nk", directions, design)[:, None]
    return np.asarray(np.einsum("nik,nil->kl", off, off))


def _refined_homography(
    start: FloatArray, cameras: FloatArray, points: FloatArray, wanted: FloatArray
) -> FloatArray:
    """Minimise the sum of the lengths of the errors by steps of weighted least squares."""
    homography, damping = start, 1e-4
    cost = np.linalg.norm(_homogeneous_projections(cameras, points @ homography.T) - wanted, axis=1).sum()
    for _ in range(_STEPS):
        normal, gradient = _normal_equations(homography, cameras, points, wanted)
        scaled = normal + damping * np.diag(np.diag(normal)) + 1e-14 * np.trace(normal) * np.eye(16)
        step = np.linalg.solve(scaled, -gradient).reshape(4, 4)
        moved = (homography + step) / np.linalg.norm(homography + step)
        new = np.linalg.norm(_homogeneous_projections(cameras, points @ moved.T) - wanted, axis=1).sum()
        if new < cost:
            settled = cost - new < _SETTLED * cost
            homography, cost, damping = moved, new, damping / 10
            if settled:
                break
        else:
            damping *= 10
    return homography


def _normal_equations(
    homography: FloatArray, cameras: FloatArray, points: FloatArray, wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    seen = np.einsum("mij,mj->mi", cameras, points @ homography.T)
    depth = _nonzero_depth(seen[:, 2:])
    position = seen[:, :2] / depth
    # (M, 2, 4): change of the position with the transferred point.
    slope = (cameras[:, :2] - position[:, :, None] * cameras[:, 2:]) / depth[:, :, None]
    jacobian = (slope[:, :, :, None] * points[:, None, None, :]).reshape(len(points), 2, 16)
    off = position - wanted
    weight = 1 / np.maximum(np.linalg.norm(off, axis=1), 0.1)
    weighted = (jacobian * weight[:, None, None]).reshape(-1, 16)
    return weighted.T @ jacobian.reshape(-1, 16), weighted.T @ off.ravel()


def _homogeneous_projections(cameras: FloatArray, points: FloatArray) -> FloatArray:
    seen = np.einsum("mij,mj->mi", cameras, points)
    return np.asarray(seen[:, :2] / _nonzero_depth(seen[:, 2:]))


def _nonzero_depth(depth: FloatArray) -> FloatArray:
    small: BoolArray = np.abs(depth) < _LEAST_DEPTH
    return np.where(small, _LEAST_DEPTH, depth)
