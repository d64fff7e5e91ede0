"""Relative pose and resection with known rotation, as from a gyroscope.

Two matches tell the direction of a motion, two points a centre; with the rotation given, few and far points
tell it as well as many. Samples of two, then least squares with Cauchy's weights among what is near.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry._matches import Matches, checked_matches
from sfmcpp.geometry.pinhole import intrinsics_row, mean_focal_px, to_normalised, unit
from sfmcpp.geometry.pose_estimate import PoseEstimate, failed_pose, pose_with_inliers, too_few
from sfmcpp.geometry.relative_pose import RelativePose
from sfmcpp.geometry.resection import pose_inliers
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.checks import require_count, require_positive, require_rotation

# With two thirds of the matches wrong, all samples miss once in 10⁷ times.
_SAMPLES = 150
_ROUNDS = 8
# Errors over the threshold beyond which a match has no say.
_FAR = 3.0
# Points at one place in the image tell no depth: this share of the identity keeps them solvable.
_LIFT = 1e-12


@checked()
def relative_pose_of_rotation(
    pixels_1: ArrayLike,
    pixels_2: ArrayLike,
    intrinsics: ArrayLike,
    rotation: ArrayLike,
    *,
    threshold_px: float = 1.0,
    min_inliers: int = 15,
    seed: int = 0,
) -> RelativePose:
    """Estimate the direction in which a camera has moved, its rotation given.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points before and after [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``, or with distortion; see :func:`sfmcpp.geometry.relative_pose`.
    rotation : (3, 3) float64
        Of the second camera in the frame of the first.
    threshold_px : float
        Largest Sampson error of an inlier [px].
    min_inliers : int
        Fewest inliers to trust, at least 2.
    seed : int
        Same seed, same result.

    Returns
    -------
    RelativePose
        ``[R | c]`` of the second camera, ‖c‖ = 1. Failures are ``"too few matches"`` and ``"too few
        inliers"``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range, or `rotation` is none.
    """
    matches = checked_matches(pixels_1, pixels_2, intrinsics, None)
    turn = _rotation(rotation)
    require_count("min_inliers", min_inliers, 2)
    require_positive("threshold_px", threshold_px)
    if len(matches) < min_inliers:
        failed = failed_pose(len(matches), *too_few("matches", len(matches), min_inliers))
        return RelativePose(**vars(failed), median_parallax_px=np.nan)
    epipolar = _Epipolar(*matches.rays, turn, threshold_px / matches.focal_px)
    camera = np.column_stack([turn, _direction_in_front(matches, turn, epipolar.solve(seed), threshold_px)])
    found = pose_with_inliers(camera, matches.inliers(camera, threshold_px), min_inliers)
    parallax_px = matches.parallax_px(turn)[found.inliers]
    median_px = float(np.median(parallax_px)) if found.success else np.nan
    return RelativePose(**vars(found), median_parallax_px=median_px)


@checked()
def resection_of_rotation(
    points: ArrayLike,
    pixels: ArrayLike,
    intrinsics: ArrayLike,
    rotation: ArrayLike,
    *,
    threshold_px: float = 3.0,
    min_inliers: int = 10,
    seed: int = 0,
) -> PoseEstimate:
    """Estimate the centre of a camera from world points it sees, its rotation given.

    Parameters
    ----------
    points : (N, 3) float64
        World points.
    pixels : (N, 2) float64
        Their images [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``, or with distortion; see :func:`sfmcpp.geometry.resection`.
    rotation : (3, 3) float64
        World_from_camera.
    threshold_px : float
        Largest reprojection error of an inlier [px].
    min_inliers : int
        Fewest inliers to trust, at least 2.
    seed : int
        Same seed, same result.

    Returns
    -------
    PoseEstimate
        ``[R | c]``, world_from_camera. Failures are ``"too few matches"`` and ``"too few inliers"``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range, or `rotation` is none.
    """
    world = finite_array("points", points, (-1, 3))
    images = finite_array("pixels", pixels, (len(world), 2))
    row, turn = intrinsics_row("intrinsics", intrinsics), _rotation(rotation)
    require_count("min_inliers", min_inliers, 2)
    require_positive("threshold_px", threshold_px)
    if len(world) < min_inliers:
        return failed_pose(len(world), *too_few("matches", len(world), min_inliers))
    equations = _Centre(world @ turn, to_normalised(images, row), threshold_px / mean_focal_px(row))
    camera = np.column_stack([turn, turn @ equations.solve(seed)])
    return pose_with_inliers(camera, pose_inliers(camera, world, images, row, threshold_px), min_inliers)


def _rotation(value: ArrayLike) -> FloatArray:
    rotation = finite_array("rotation", value, (3, 3))
    require_rotation("rotation", rotation)
    return rotation


class _Epipolar:
    """Direction (3,) of a motion in the planes of the rays (N, 3) to each point from both ends of it."""

    def __init__(self, rays_1: FloatArray, rays_2: FloatArray, turn: FloatArray, scale: float) -> None:
        self._rays_1, self._rays_2, self._scale = rays_1, rays_2 @ turn.T, scale
        self._normals = np.cross(self._rays_1, self._rays_2)

    def solve(self, seed: int) -> FloatArray:
        """Best of the samples of two matches, then weighted least squares."""
        first, second = _pairs(len(self._normals), seed)
        normals = unit(self._normals)
        samples = unit(np.cross(normals[first], normals[second]))
        best: FloatArray = samples[int(np.argmin(_truncated_sums(self._errors(samples), self._scale)))]
        for _ in range(_ROUNDS):
            weights = _weights(self._errors(best[None])[:, 0] / self._scale)
            weights /= self._widths(best[None])[:, 0] ** 2
            best = np.asarray(np.linalg.eigh((weights * self._normals.T) @ self._normals)[1][:, 0])
        return best

    def _errors(self, directions: FloatArray) -> FloatArray:
        """(N, k) first-order distances of the rays from epipolar planes, for each of (k, 3) directions."""
        return np.asarray(np.abs(self._normals @ directions.T) / self._widths(directions))

    def _widths(self, directions: FloatArray) -> FloatArray:
        """(N, k) what moves the triple product: sines between the direction and both rays."""
        cosines = [rays @ directions.T for rays in (self._rays_1, self._rays_2)]
        return np.asarray(np.sqrt(np.maximum(2.0 - cosines[0] ** 2 - cosines[1] ** 2, 1e-12)))


class _Centre:
    """Centre (3,) in the camera's axes of which points (N, 3) in these axes are seen at (N, 2).

    ``x − c_x = u (z − c_z)`` and the same for y are linear in c; over the depth they are errors at depth one.
    """

    def __init__(self, points: FloatArray, images: FloatArray, scale: float) -> None:
        # The lift draws a centre to the origin: that is among the points, wherever the world has it.
        self._origin = points.mean(axis=0)
        self._points, self._images, self._scale = points - self._origin, images, scale
        ones, zeros = np.ones(len(points)), np.zeros(len(points))
        u, v = images.T
        self._rows = np.stack(
            [np.column_stack([ones, zeros, -u]), np.column_stack([zeros, ones, -v])], axis=1
        )
        self._sides = np.einsum("nij,nj->ni", self._rows, self._points)

    def solve(self, seed: int) -> FloatArray:
        """Best of the samples of two points, then weighted least squares."""
        first, second = _pairs(len(self._points), seed)
        normal = np.einsum("nij,nik->njk", self._rows, self._rows)
        right = np.einsum("nij,ni->nj", self._rows, self._sides)
        pairs = normal[first] + normal[second], right[first] + right[second]
        centres = np.linalg.solve(_lifted(pairs[0]), pairs[1][:, :, None])[:, :, 0]
        best: FloatArray = centres[int(np.argmin(_truncated_sums(self._errors(centres), self._scale)))]
        for _ in range(_ROUNDS):
            weights = _weights(self._errors(best[None])[:, 0] / self._scale)
            if not weights.any():
                break
            weights /= np.where(weights > 0, self._points[:, 2] - best[2], 1.0) ** 2
            best = np.linalg.solve(_lifted(np.einsum("n,njk->jk", weights, normal)), weights @ right)
        return np.asarray(self._origin + best)

    def _errors(self, centres: FloatArray) -> FloatArray:
        """(N, k) distances at depth one for each of the centres (k, 3); infinite behind the camera."""
        seen = self._points[:, None] - centres
        ahead = seen[:, :, 2] > 0
        depth = np.where(ahead, seen[:, :, 2], 1.0)
        offset = seen[:, :, :2] / depth[:, :, None] - self._images[:, None]
        return np.where(ahead, np.linalg.norm(offset, axis=2), np.inf)


def _lifted(normal: FloatArray) -> FloatArray:
    """Normal matrices (..., 3, 3) that can be solved, whatever the unit of length."""
    size = np.trace(normal, axis1=-2, axis2=-1)[..., None, None]
    return np.asarray(normal + _LIFT * size * np.eye(3))


def _pairs(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    first = rng.integers(count, size=_SAMPLES)
    return first, (first + 1 + rng.integers(count - 1, size=_SAMPLES)) % count


def _weights(errors: FloatArray) -> FloatArray:
    """Weights of Cauchy's loss, and zero for what is far from an inlier: there is much of it."""
    return np.where(errors < _FAR, 1 / (1 + errors**2), 0.0)


def _truncated_sums(errors: FloatArray, scale: float) -> FloatArray:
    """Sums (k,) over the rows of errors (N, k)."""
    return np.asarray((np.minimum(np.abs(errors) / scale, 1.0) ** 2).sum(axis=0))


def _direction_in_front(
    matches: Matches, turn: FloatArray, centre: FloatArray, threshold_px: float
) -> FloatArray:
    """The direction or its opposite, whichever has more points in front of both cameras."""
    counts = [
        np.count_nonzero(matches.inliers(np.column_stack([turn, c]), threshold_px)) for c in (centre, -centre)
    ]
    return centre if counts[0] >= counts[1] else -centre
