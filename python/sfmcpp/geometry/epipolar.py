"""Epipolar geometry of two cameras: fundamental matrix, Sampson error, closest points of rays, cheirality."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.pinhole import homogeneous, inverse_calibration
from sfmcpp.model.arrays import BoolArray, FloatArray


def fundamental_matrix(
    camera_1: FloatArray, camera_2: FloatArray, intrinsics_1: FloatArray, intrinsics_2: FloatArray
) -> FloatArray:
    """``F`` with ``(u₁, v₁, 1) F (u₂, v₂, 1)ᵀ = 0`` for the images of one point.

    ``F = K₁⁻ᵀ R₁ᵀ [c₂ − c₁]× R₂ K₂⁻¹``. The cameras of many pairs may be given at once.

    Parameters
    ----------
    camera_1, camera_2 : (..., 3, 4) float64
        ``[R | c]``, world_from_camera.
    intrinsics_1, intrinsics_2 : (..., 5) float64
        ``(f, aspect, cx, cy, skew)``.

    Returns
    -------
    (..., 3, 3) float64
        Rank two; zero where the centres coincide.
    """
    baseline = camera_2[..., 3] - camera_1[..., 3]
    across = np.cross(baseline[..., None, :], np.swapaxes(camera_2[..., :3], -1, -2))
    essential = np.swapaxes(camera_1[..., :3], -1, -2) @ np.swapaxes(across, -1, -2)
    left = np.swapaxes(inverse_calibration(intrinsics_1), -1, -2)
    return np.asarray(left @ essential @ inverse_calibration(intrinsics_2))


def sampson_errors_px(
    fundamental: FloatArray,
    pixels_1: FloatArray,
    pixels_2: FloatArray,
    slopes_1: FloatArray | None = None,
    slopes_2: FloatArray | None = None,
) -> FloatArray:
    """First-order distance of matches from the epipolar geometry (Hartley & Zisserman, eq. 11.9).

    Parameters
    ----------
    fundamental : (3, 3) or (N, 3, 3) float64
        See :func:`fundamental_matrix`.
    pixels_1, pixels_2 : (N, 2) float64
        Image positions [px], distortion taken out.
    slopes_1, slopes_2 : (N, 2, 2) float64, optional
        Their derivatives with respect to the positions seen, in which the distance is measured. Default:
        there is no distortion.

    Returns
    -------
    (N,) float64
        Distance in the joint space of both images [px]; infinite where both points are epipoles.
    """
    points = homogeneous(pixels_1), homogeneous(pixels_2)
    algebraic, slope = sampson_terms(fundamental, *points, slopes_1, slopes_2)
    errors: FloatArray = np.divide(np.abs(algebraic), slope, out=np.full_like(slope, np.inf), where=slope > 0)
    return errors


def sampson_terms(
    matrix: FloatArray,
    points_1: FloatArray,
    points_2: FloatArray,
    slopes_1: FloatArray | None = None,
    slopes_2: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Numerator, signed, and denominator (..., N) of Sampson errors.

    Parameters
    ----------
    matrix : (..., 3, 3) float64
        Fundamental, or essential; its leading axes are those of the result.
    points_1, points_2 : (N, 3) float64
        Homogeneous image positions, the third coordinate 1.
    slopes_1, slopes_2 : (N, 2, 2) float64, optional
        See :func:`sampson_errors_px`.
    """
    line_1 = np.einsum("...ij,...j->...i", matrix, points_2)
    line_2 = np.einsum("...ji,...j->...i", matrix, points_1)
    normal_1, normal_2 = _line_gradients(line_1, slopes_1), _line_gradients(line_2, slopes_2)
    slope = np.sqrt((normal_1**2).sum(-1) + (normal_2**2).sum(-1))
    return (points_1 * line_1).sum(-1), slope


def _line_gradients(lines: FloatArray, slopes: FloatArray | None) -> FloatArray:
    """Gradients (N, 2) of ``line · (u, v, 1)`` with respect to the positions seen."""
    normals = lines[..., :2]
    return normals if slopes is None else np.einsum("ni,nij->nj", normals, slopes)


def camera_of_fundamental(
    fundamental: FloatArray,
    intrinsics_1: FloatArray,
    intrinsics_2: FloatArray,
    normalised_1: FloatArray,
    normalised_2: FloatArray,
) -> FloatArray:
    """Second camera of the essential matrix that is nearest to ``K₁ᵀ F K₂``, the first being at the origin.

    Parameters
    ----------
    fundamental : (3, 3) float64
        See :func:`fundamental_matrix`; of any scale.
    intrinsics_1, intrinsics_2 : (5,) float64
        ``(f, aspect, cx, cy, skew)``.
    normalised_1, normalised_2 : (N, 2) float64
        Image points at depth one: of the four cameras with that matrix most of these are in front of one.

    Returns
    -------
    (3, 4) float64
        ``[R | c]``, ‖c‖ = 1.
    """
    k_1, k_2 = (np.linalg.inv(inverse_calibration(row)) for row in (intrinsics_1, intrinsics_2))
    u, _, vt = np.linalg.svd(k_1.T @ fundamental @ k_2)
    u, vt = u * np.linalg.det(u), vt * np.linalg.det(vt)
    quarter_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    cameras = [
        np.column_stack([u @ turn @ vt, sign * u[:, 2]])
        for turn in (quarter_turn, quarter_turn.T)
        for sign in (1, -1)
    ]
    in_front = [
        np.count_nonzero(in_front_of_both(np.eye(3, 4), camera, normalised_1, normalised_2))
        for camera in cameras
    ]
    return cameras[int(np.argmax(in_front))]


def in_front_of_both(
    camera_1: FloatArray, camera_2: FloatArray, normalised_1: FloatArray, normalised_2: FloatArray
) -> BoolArray:
    """Whether the rays of each match pass closest to each other in front of both cameras.

    Parameters
    ----------
    camera_1, camera_2 : (3, 4) float64
        ``[R | c]``, world_from_camera.
    normalised_1, normalised_2 : (N, 2) float64
        Image points at depth one.

    Returns
    -------
    (N,) bool
        False for parallel rays too.
    """
    ray_1 = homogeneous(normalised_1) @ camera_1[:, :3].T
    ray_2 = homogeneous(normalised_2) @ camera_2[:, :3].T
    depth_1, depth_2, _ = closest_depths(ray_1, ray_2, camera_2[:, 3] - camera_1[:, 3])
    return np.asarray((depth_1 > 0) & (depth_2 > 0))


def closest_depths(
    rays_1: FloatArray, rays_2: FloatArray, baselines: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Depths at which lines come nearest to each other, times a number that is not negative (thesis eq. 3.3).

    Parameters
    ----------
    rays_1, rays_2 : (..., 3) float64
        Directions of the lines, of any length, which is the unit of the depths.
    baselines : (..., 3) float64
        From where the first starts to where the second does.

    Returns
    -------
    depth_1, depth_2, factor : (...) float64
        The depths are ``depth_1 / factor`` and ``depth_2 / factor``. The factor is the squared sine of the
        angle between the lines, times the squares of both lengths: zero, or rounding, for parallel ones.
    """
    square_1, square_2, across = dot(rays_1, rays_1), dot(rays_2, rays_2), dot(rays_1, rays_2)
    along_1, along_2 = dot(rays_1, baselines), dot(rays_2, baselines)
    depth_1 = square_2 * along_1 - across * along_2
    depth_2 = across * along_1 - square_1 * along_2
    return depth_1, depth_2, square_1 * square_2 - across**2


def midpoints(
    rays_1: FloatArray, centres_1: FloatArray, rays_2: FloatArray, centres_2: FloatArray
) -> FloatArray:
    """Middle (..., 3) of the shortest connection of two lines each (thesis eq. 3.2).

    Parameters
    ----------
    rays_1, rays_2 : (..., 3) float64
        Directions of the lines.
    centres_1, centres_2 : (..., 3) float64
        Where they start.

    Returns
    -------
    (..., 3) float64
        Not a number, or infinite, for parallel lines.
    """
    depth_1, depth_2, factor = closest_depths(rays_1, rays_2, centres_2 - centres_1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = centres_1 + (depth_1 / factor)[..., None] * rays_1
        ends += centres_2 + (depth_2 / factor)[..., None] * rays_2
    return np.asarray(ends / 2)


def inverse_depths(left: FloatArray, right: FloatArray, centre: FloatArray) -> FloatArray:
    """Inverse depths of points in the first of two cameras with common axes.

    Of a second camera at (b, 0, 0) that is the disparity over b; off the epipolar line does not count.

    Parameters
    ----------
    left, right : (..., 2) float64
        Image points at depth one.
    centre : (3,) float64
        Where the second camera is, in the axes of both.

    Returns
    -------
    (...) float64
        Negative behind the cameras, zero far away.
    """
    # A point at depth 1/w moves from `left` by −w times this.
    motion = centre[:2] - centre[2] * right
    return np.asarray(((left - right) * motion).sum(axis=-1) / (motion**2).sum(axis=-1))


def dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Scalar products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, other))
