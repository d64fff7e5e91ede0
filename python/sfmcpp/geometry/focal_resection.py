"""Resection with unknown focal length, with outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry import so3
from sfmcpp.geometry._lines import turn_is_open
from sfmcpp.geometry._poselib import (
    RansacOptions,
    absolute_camera,
    cameras_of_four_points,
    working_frame,
)
from sfmcpp.geometry.pinhole import intrinsics_row, mean_focal_px, to_normalised
from sfmcpp.geometry.pose_estimate import PoseEstimate, too_few, unknown_camera
from sfmcpp.geometry.resection import are_collinear
from sfmcpp.geometry.significance import samples_needed
from sfmcpp.model.arrays import BoolArray, FloatArray, finite_array
from sfmcpp.model.checks import require_count, require_fraction, require_positive

_SAMPLE_SIZE = 4
# Samples that are drawn before the best of them is looked at; points that samples are compared on.
_BATCH, _MOST_COMPARED = 100, 500
# The focal length given may be so wrong that errors are this many times the threshold.
_GUESS_SLACK = 4.0
_MAX_CHANGES = 8
_MAX_STEPS, _FIRST_DAMPING, _MAX_DAMPING, _CONVERGED = 30, 1e-3, 1e6, 1e-12


@dataclass(frozen=True)
class FocalPoseEstimate(PoseEstimate):
    """A camera pose with its focal length from matches with outliers, or why there is none.

    Attributes
    ----------
    camera, inliers, failure, message
        See :class:`PoseEstimate`.
    focal_px : float
        Focal length along u [px]; not a number after a failure.
    focal_sigma_px : float
        Its standard deviation, from the errors of the inliers [px].
    """

    focal_px: float
    focal_sigma_px: float


@dataclass(frozen=True)
class _View:
    """World points, and images as a camera of square pixels sees them, counted from the principal point."""

    points: FloatArray
    images: FloatArray

    def errors_px(self, camera: FloatArray, focal: float) -> FloatArray:
        """(N,) reprojection errors; infinite behind the camera."""
        return np.asarray(_errors_px(self, camera[None], np.array([focal]))[0])

    def select(self, chosen: BoolArray) -> _View:
        return _View(self.points[chosen], self.images[chosen])


def resection_with_focal(
    points: ArrayLike,
    pixels: ArrayLike,
    intrinsics: ArrayLike,
    *,
    threshold_px: float = 3.0,
    min_inliers: int = 10,
    min_inlier_ratio: float = 0.2,
    max_focal_sigma: float = 0.1,
    confidence: float = 0.9999,
    max_iterations: int = 10_000,
    seed: int = 0,
) -> FocalPoseEstimate:
    """Estimate an absolute pose with the focal length: four points in adaptive LO-RANSAC, refined on inliers.

    The solver of four points and an unknown focal length is PoseLib's. It has no answer where the points lie
    on a plane: there the focal length given, or one near it, must do as a start.

    Failures, named in the result, all with a camera that is not a number:

    - ``"too few matches"``: fewer than `min_inliers`.
    - ``"collinear points"``: all points that the pose explains, or all but one, lie on a line or so near it
      that the camera may turn round it by more than 3° (one standard deviation).
    - ``"too few inliers"``: no pose agrees with enough matches.
    - ``"open focal length"``: its standard deviation is above `max_focal_sigma`, as with points at one depth.

    Parameters
    ----------
    points : (N, 3) float64
        World points.
    pixels : (N, 2) float64
        Their images [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``, or with distortion a row of ``"perspective"`` (12,) or ``"bal"`` (3,).
        Its focal length is a guess; all else is kept, skew in proportion to the focal length. Distortion is
        taken out with the guess.
    threshold_px : float
        Largest reprojection error of an inlier [px].
    min_inliers : int
        Fewest inliers of a pose to trust, at least 5.
    min_inlier_ratio : float
        Smallest part of the matches that are inliers of a pose to trust.
    max_focal_sigma : float
        Largest standard deviation of a focal length to trust, as part of it.
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    FocalPoseEstimate
        ``[R | c]``, world_from_camera, and the focal length.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    world = finite_array("points", points, (-1, 3))
    seen = finite_array("pixels", pixels, (len(world), 2))
    row = intrinsics_row("intrinsics", intrinsics)
    require_count("min_inliers", min_inliers, _SAMPLE_SIZE + 1)
    require_fraction("min_inlier_ratio", min_inlier_ratio)
    require_positive("max_focal_sigma", max_focal_sigma)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    if len(world) < min_inliers:
        return _failed(len(world), *too_few("matches", len(world), min_inliers))
    if are_collinear(world):
        return _failed(len(world), "collinear points", f"{len(world)} points on one line")
    guess = mean_focal_px(row)
    # The world may be far from its origin: four points far from it leave few digits.
    origin = world.mean(axis=0)
    _, length = working_frame(world - origin)
    view = _View((world - origin) / length, guess * to_normalised(seen, row))
    camera, focal = _search(view, guess, options)
    inliers = np.asarray(view.errors_px(camera, focal) <= threshold_px)
    least = max(min_inliers, math.ceil(min_inlier_ratio * len(world)))
    if np.count_nonzero(inliers) < least:
        return _failed(len(world), *too_few("inliers", int(np.count_nonzero(inliers)), least))
    explained = view.select(inliers)
    if _may_turn(explained, camera, focal, threshold_px):
        return _failed(len(world), "collinear points", f"{len(explained.points)} inliers near one line")
    sigma = _focal_sigma(explained, camera, focal)
    if not sigma <= max_focal_sigma:
        reason = f"focal length within {sigma:.2g} of it: must be at most {max_focal_sigma:g}"
        return _failed(len(world), "open focal length", reason)
    # The guess is the mean of both focal lengths; the one along u is to it as before.
    focal *= row[0] / guess
    camera = np.column_stack([camera[:, :3], origin + length * camera[:, 3]])
    return FocalPoseEstimate(camera, inliers, "", "", focal, sigma * focal)


def _may_turn(view: _View, camera: FloatArray, focal: float, threshold_px: float) -> bool:
    """Whether the points of a view lie so near one line that its pose is open."""
    depths = (view.points - camera[:, 3]) @ camera[:, 2]
    return turn_is_open(view.points, depths, view.errors_px(camera, focal), focal, threshold_px)


def _failed(count: int, failure: str, message: str) -> FocalPoseEstimate:
    none = np.zeros(count, dtype=np.bool_)
    return FocalPoseEstimate(unknown_camera(), none, failure, message, np.nan, np.nan)


def _search(view: _View, guess: float, options: RansacOptions) -> tuple[FloatArray, float]:
    """Camera and focal length with the least truncated squared errors, refined whenever a better is drawn."""
    rng = np.random.default_rng(options.seed)
    best = _minimal_solutions(view, guess, options)
    least = _cost(view, best, options.threshold_px)
    drawn, needed = 0, options.max_iterations
    while drawn < needed:
        candidate = _best_of_batch(view, guess, options.threshold_px, rng)
        drawn += _BATCH
        if candidate is not None:
            candidate = _refined(view, *candidate, options.threshold_px)
            cost = _cost(view, candidate, options.threshold_px)
            best, least = (candidate, cost) if cost < least else (best, least)
        ratio = float(np.mean(view.errors_px(*best) <= options.threshold_px))
        needed = samples_needed(ratio, _SAMPLE_SIZE, options.confidence, options.max_iterations)
    return best


def _minimal_solutions(view: _View, guess: float, options: RansacOptions) -> tuple[FloatArray, float]:
    """Three points with the focal length given, refined with it free."""
    slack = replace(options, threshold_px=_GUESS_SLACK * options.threshold_px)
    camera = absolute_camera(view.points, view.images, np.array([guess, 1.0, 0, 0, 0]), slack)
    camera, focal = _refined(view, camera, guess, slack.threshold_px)
    return _refined(view, camera, focal, options.threshold_px)


def _best_of_batch(
    view: _View, guess: float, threshold_px: float, rng: np.random.Generator
) -> tuple[FloatArray, float] | None:
    found = []
    for _ in range(_BATCH):
        some = rng.choice(len(view.points), _SAMPLE_SIZE, replace=False)
        found += cameras_of_four_points(view.points[some], view.images[some] / guess)
    if not found:
        return None
    cameras = np.stack([camera for camera, _ in found])
    focals = guess * np.array([focal for _, focal in found])
    stride = -(-len(view.points) // _MOST_COMPARED)
    compared = _View(view.points[::stride], view.images[::stride])
    errors = np.minimum(_errors_px(compared, cameras, focals), threshold_px)
    best = int(np.argmin((errors**2).sum(axis=1)))
    return cameras[best], float(focals[best])


def _errors_px(view: _View, cameras: FloatArray, focals: FloatArray) -> FloatArray:
    """(S, N) reprojection errors of every camera (S, 3, 4); infinite behind it."""
    in_camera = (view.points - cameras[:, None, :, 3]) @ cameras[:, :, :3]
    depth = in_camera[:, :, 2]
    in_front = depth > 0
    scale = focals[:, None] / np.where(in_front, depth, 1.0)
    offsets = in_camera[:, :, :2] * scale[:, :, None] - view.images
    return np.where(in_front, np.sqrt((offsets**2).sum(axis=2)), np.inf)


def _cost(view: _View, found: tuple[FloatArray, float], threshold_px: float) -> float:
    return float((np.minimum(view.errors_px(*found), threshold_px) ** 2).sum())


def _refined(view: _View, camera: FloatArray, focal: float, threshold_px: float) -> tuple[FloatArray, float]:
    """Camera and focal length at a local minimum, and again as long as other inliers make it better."""
    best = _minimised(view, camera, focal, threshold_px)
    for _ in range(_MAX_CHANGES):
        better = _minimised(view, *best, threshold_px)
        if _cost(view, better, threshold_px) >= _cost(view, best, threshold_px):
            break
        best = better
    return best


def _minimised(
    view: _View, camera: FloatArray, focal: float, threshold_px: float
) -> tuple[FloatArray, float]:
    """Camera and focal length at a local minimum of the Cauchy loss of the inliers' errors."""
    inliers = view.select(np.asarray(view.errors_px(camera, focal) <= 2 * threshold_px))
    if len(inliers.points) < _SAMPLE_SIZE:
        return camera, focal
    best, least = (camera, focal), _loss(inliers, camera, focal, threshold_px)
    damping = _FIRST_DAMPING
    for _ in range(_MAX_STEPS):
        candidate, promised = _damped_step(inliers, *best, threshold_px, damping)
        loss = _loss(inliers, *candidate, threshold_px)
        if loss < least:
            best, least, damping = candidate, loss, damping / 10
        else:
            damping *= 10
        if damping > _MAX_DAMPING or promised < _CONVERGED * least:
            break
    return best


def _loss(view: _View, camera: FloatArray, focal: float, scale_px: float) -> float:
    return float(np.log1p((view.errors_px(camera, focal) / scale_px) ** 2).sum())


def _damped_step(
    view: _View, camera: FloatArray, focal: float, scale_px: float, damping: float
) -> tuple[tuple[FloatArray, float], float]:
    """One damped step on ``(δω, δc, δ ln f)``, weighted as the loss asks, and what it promises."""
    residuals, jacobian = _linearised(view, camera, focal)
    weights = 1 / (1 + (residuals**2).sum(axis=1) / scale_px**2) / scale_px**2
    weighted = (jacobian * weights[:, None, None]).reshape(-1, 7)
    normal = weighted.T @ jacobian.reshape(-1, 7)
    descent = -weighted.T @ residuals.reshape(-1)
    normal[np.diag_indices(7)] *= 1 + damping
    # Of points at one depth the matrix is singular: no step that the points do not ask for.
    step = np.linalg.lstsq(normal, descent, rcond=None)[0]
    rotation = camera[:, :3] @ so3.exp(step[:3])
    # No step multiplies the focal length by more than e.
    moved = np.column_stack([rotation, camera[:, 3] + step[3:6]])
    return (moved, focal * float(np.exp(np.clip(step[6], -1, 1)))), float(step @ descent)


def _linearised(view: _View, camera: FloatArray, focal: float) -> tuple[FloatArray, FloatArray]:
    """Residuals (N, 2) and their derivatives (N, 2, 7) by ``(δω, δc, δ ln f)``, with R ← R exp(δω)."""
    in_camera = (view.points - camera[:, 3]) @ camera[:, :3]
    x, y, depth = in_camera.T
    image = focal * in_camera[:, :2] / depth[:, None]
    slope = np.zeros((len(x), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = focal / depth
    slope[:, :, 2] = -image / depth[:, None]
    # d(exp(−δω) X) = X × δω.
    zero = np.zeros_like(x)
    cross = np.stack([zero, -depth, y, depth, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    jacobian = np.concatenate([slope @ cross, -slope @ camera[:, :3].T, image[:, :, None]], axis=2)
    return image - view.images, jacobian


def _focal_sigma(view: _View, camera: FloatArray, focal: float) -> float:
    """Standard deviation of ``ln f`` from the residuals; infinite where the points leave it open."""
    residuals, jacobian = _linearised(view, camera, focal)
    flat = jacobian.reshape(-1, 7)
    others, last = flat[:, :6], flat[:, 6]
    # What of the derivative by ln f the pose cannot imitate.
    left = last - others @ np.linalg.lstsq(others, last, rcond=None)[0]
    variance = (residuals**2).sum() / max(2 * len(residuals) - 7, 1)
    norm = float(left @ left)
    return float(np.sqrt(variance / norm)) if norm > 1e-20 * float(last @ last) else np.inf
