"""Two-view geometry from matches, with calibrated or uncalibrated cameras (thesis §3.1.4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry._degenerate_pairs import (
    cameras_of_plane,
    homography_inliers,
    homography_of_inliers,
    is_explained_by_smaller_model,
    rotation_inliers,
    rotation_of_homography,
    unmoved_matches,
)
from sfmcpp.geometry._matches import Matches, checked_matches
from sfmcpp.geometry._poselib import RansacOptions, relative_camera
from sfmcpp.geometry.epipolar import fundamental_matrix, in_front_of_both, sampson_errors_px
from sfmcpp.geometry.pose_estimate import unknown_camera
from sfmcpp.geometry.relative_pose import ambiguity_message, best_and_rivals, is_open
from sfmcpp.geometry.rotation_fit import angles_rad
from sfmcpp.geometry.significance import chance_near_line, least_significant
from sfmcpp.geometry.two_view_matrices import (
    EIGHT_POINTS,
    fundamental_linear,
    significant_fundamental,
    significant_homography,
    with_sample_limit,
)
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count

_FIVE_POINTS = 5
_UNKNOWN_CAMERA = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
# Intrinsics are far off where a fundamental matrix, which needs none, explains this many times the matches
# that they do.
_FAR_OFF = 1.1
# And the pose they lead to is worth nothing where they explain less than this part.
_LEAST_PART_OF_POSE = 0.5
# More inliers of a scene in depth than these leave no second pose.
_FEW = 200


@dataclass(frozen=True, eq=False)
class TwoViewGeometry:
    """Two-view geometry of the matches of two images.

    Attributes
    ----------
    kind : str
        ``"general"``: two places and a scene in depth. ``"planar"``: a plane, or too little depth to tell.
        ``"rotation"``: the camera turned on the spot, or the photos are the same. ``"none"``: nothing agrees.
    inliers : (m,) bool
        Matches that agree with it.
    fundamental : (3, 3) float64
        ``(u₁, v₁, 1) F (u₂, v₂, 1)ᵀ = 0``; not a number unless ``"general"``, or both cameras are known and
        the translation too. With known distortion (u, v) are where a lens without would have seen them.
    homography : (3, 3) float64
        ``(u₂, v₂, 1) ∝ H (u₁, v₁, 1)``; not a number where it was not needed or not found.
    camera : (3, 4) float64
        ``[R | c]`` of camera 2 in the frame of camera 1, ‖c‖ = 1 (0 for a rotation); not a number unless both
        cameras are known, or good enough guessed.
    median_angle_deg : float
        Median angle between the rays of the inliers [deg]; not a number without a camera.
    message : str
        Why it is no better than it is. Empty for ``"general"``, unless the intrinsics are far off, or the
        matches so few that another pose fits nearly as well.
    """

    kind: str
    inliers: BoolArray
    fundamental: FloatArray
    homography: FloatArray
    camera: FloatArray
    median_angle_deg: float
    message: str


def two_view_geometry(
    pixels_1: ArrayLike,
    pixels_2: ArrayLike,
    intrinsics_1: ArrayLike | None = None,
    intrinsics_2: ArrayLike | None = None,
    *,
    threshold_px: float = 2.0,
    min_inliers: int = 15,
    confidence: float = 0.9999,
    max_iterations: int = 5_000,
    seed: int = 0,
) -> TwoViewGeometry:
    """Estimate what relates two images: epipolar geometry, a homography, a rotation, or nothing.

    Unknown cameras: a fundamental matrix by seven points. Known ones: an essential matrix by five, and the
    pose that has the points in front of both. Both in adaptive LO-RANSAC, refined on the inliers (PoseLib),
    and trusted only if more matches agree than would by chance.

    The smaller model is taken where the larger one explains few more matches: at least a tenth of the
    inliers, and more than would by chance, must be off the homography for ``"general"``, and off the rotation
    for ``"planar"``. Unknown cameras that turn on the spot are ``"planar"``: their homography is one of many
    that a plane could have.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points in both photos [px].
    intrinsics_1, intrinsics_2 : (5,) float64, optional
        ``(f, aspect, cx, cy, skew)`` of each camera, or with distortion a row of ``"perspective"`` (12,) or
        ``"bal"`` (3,). Default: unknown, unless both are given. Guesses will do: where they explain much less
        than a fundamental matrix, the inliers are that one's, and the message says so.
    threshold_px : float
        Largest Sampson error of an inlier [px].
    min_inliers : int
        Fewest inliers to trust, at least 8.
    confidence : float
        Asked probability of having drawn one sample without outliers.
    max_iterations : int
        Samples at most.
    seed : int
        Same seed, same result.

    Returns
    -------
    TwoViewGeometry

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    known = intrinsics_1 is not None and intrinsics_2 is not None
    if intrinsics_1 is None or intrinsics_2 is None:
        intrinsics_1 = intrinsics_2 = _UNKNOWN_CAMERA
    matches = checked_matches(pixels_1, pixels_2, intrinsics_1, intrinsics_2)
    require_count("min_inliers", min_inliers, EIGHT_POINTS)
    options = RansacOptions(threshold_px, confidence, max_iterations, seed)
    if len(matches) < min_inliers:
        return _no_geometry(len(matches), f"{len(matches)} matches: must be at least {min_inliers}")
    same = unmoved_matches(matches.pixels_1, matches.pixels_2)
    if same is not None and np.array_equal(matches.intrinsics_1, matches.intrinsics_2):
        return _identical_photos(same, known)
    if known:
        return _of_known_cameras(matches, options, min_inliers)
    return _of_unknown_cameras(matches, options, min_inliers)


def _of_unknown_cameras(matches: Matches, options: RansacOptions, min_inliers: int) -> TwoViewGeometry:
    found = significant_fundamental(matches.pixels_1, matches.pixels_2, options, min_inliers)
    if not found.success:
        # Four points may find among many outliers what seven do not.
        plane = significant_homography(matches.pixels_1, matches.pixels_2, options, min_inliers)
        if not plane.success:
            return _no_geometry(len(matches), found.message)
        return _uncalibrated_planar(plane.inliers, plane.matrix)
    homography = homography_of_inliers(matches, found.inliers, options)
    flat = homography_inliers(matches, homography, options.threshold_px)
    if is_explained_by_smaller_model(matches, found.inliers, flat, options.threshold_px):
        return _uncalibrated_planar(flat, homography)
    return TwoViewGeometry("general", found.inliers, found.matrix, homography, unknown_camera(), np.nan, "")


def _of_known_cameras(matches: Matches, options: RansacOptions, min_inliers: int) -> TwoViewGeometry:
    chance = chance_near_line(matches.pixels_1, matches.pixels_2, options.threshold_px)
    least = max(min_inliers, least_significant(len(matches), _FIVE_POINTS, chance))
    if len(matches) < least:
        return _no_geometry(len(matches), f"{len(matches)} matches: must be at least {least}")
    camera = relative_camera(*matches.arrays, with_sample_limit(options, least / len(matches), _FIVE_POINTS))
    near = _near_lines(matches, camera, options.threshold_px)
    if _are_far_off(matches, near, options.threshold_px):
        free = _of_unknown_cameras(matches, options, min_inliers)
        if free.kind != "none":
            return _with_uncertain_focal(free, matches, camera, near)
    if np.count_nonzero(near) < least:
        plane = significant_homography(matches.pixels_1, matches.pixels_2, options, min_inliers)
        if plane.success:
            return _planar_or_rotation(matches, camera, plane.matrix, options)
        return _no_geometry(len(matches), _too_few(near, least))
    homography = homography_of_inliers(matches, near, options)
    flat = homography_inliers(matches, homography, options.threshold_px)
    if is_explained_by_smaller_model(matches, near, flat, options.threshold_px):
        return _planar_or_rotation(matches, camera, homography, options)
    inliers = _epipolar_inliers(matches, camera, options.threshold_px)
    if np.count_nonzero(inliers) < least:
        return _no_geometry(len(matches), _too_few(inliers, least))
    return _general_geometry(matches, camera, inliers, homography, options)


def _general_geometry(
    matches: Matches, camera: FloatArray, inliers: BoolArray, homography: FloatArray, options: RansacOptions
) -> TwoViewGeometry:
    """A scene in depth, cameras known; of few matches with a word on other poses that fit as well."""
    message = ""
    if np.count_nonzero(inliers) < _FEW:
        rotation = matches.select(inliers).fit_rotation(2 * options.threshold_px, options.seed)
        camera, rivals = best_and_rivals(matches, camera, rotation, options)
        inliers = _epipolar_inliers(matches, camera, options.threshold_px)
        message = ambiguity_message(camera, rivals) if len(rivals) else ""
    return _with_camera("general", matches, inliers, homography, camera, message)


def _planar_or_rotation(
    matches: Matches, camera: FloatArray, homography: FloatArray, options: RansacOptions
) -> TwoViewGeometry:
    """A plane or a rotation, cameras known."""
    flat = homography_inliers(matches, homography, options.threshold_px)
    rotation = rotation_of_homography(matches, flat, homography, options.threshold_px)
    turned = rotation_inliers(matches, rotation, options.threshold_px)
    if is_explained_by_smaller_model(matches, flat, turned, options.threshold_px):
        return _rotation_geometry(matches, turned, homography, rotation)
    camera, rivals = cameras_of_plane(matches, flat, homography, camera, options)
    inliers = _epipolar_inliers(matches, camera, options.threshold_px)
    if np.count_nonzero(inliers) < _LEAST_PART_OF_POSE * np.count_nonzero(flat):
        return _uncalibrated_planar(flat, homography)
    both = inliers & matches.inliers(camera, options.threshold_px)
    if np.count_nonzero(both) >= _FIVE_POINTS and is_open(matches, camera, both, options.threshold_px):
        message = "the matches lie on one line: neither a plane nor a pose is known"
        return replace(_uncalibrated_planar(flat, homography), message=message)
    message = "one homography explains the matches: a plane, or too little depth variation"
    if len(rivals):
        message += "; " + ambiguity_message(camera, rivals)
    return _with_camera("planar", matches, inliers, homography, camera, message)


def _with_uncertain_focal(
    free: TwoViewGeometry, matches: Matches, camera: FloatArray, explained: BoolArray
) -> TwoViewGeometry:
    """Geometry found without the intrinsics, which are far off; with the pose if it is usable."""
    share = float((explained & free.inliers).sum() / free.inliers.sum())
    if free.kind != "general" or share < _LEAST_PART_OF_POSE:
        return free
    angle = _median_angle_deg(matches, free.inliers, camera)
    message = (
        f"intrinsics are far off: they explain {share:.0%} of the matches that a fundamental matrix explains"
    )
    return replace(free, camera=camera, median_angle_deg=angle, message=message)


def _are_far_off(matches: Matches, inliers: BoolArray, threshold_px: float) -> bool:
    """Whether a fundamental matrix of the inliers of known intrinsics explains many more matches."""
    count = np.count_nonzero(inliers)
    if count < EIGHT_POINTS:
        return False
    first, second = matches.pixels_1, matches.pixels_2
    free = fundamental_linear(first[inliers], second[inliers])
    return bool(np.count_nonzero(sampson_errors_px(free, first, second) <= threshold_px) > _FAR_OFF * count)


def _near_lines(matches: Matches, camera: FloatArray, threshold_px: float) -> BoolArray:
    """Matches near the epipolar lines of a second camera."""
    fundamental = fundamental_matrix(np.eye(3, 4), camera, matches.intrinsics_1, matches.intrinsics_2)
    lenses = matches.slopes_1, matches.slopes_2
    errors = sampson_errors_px(fundamental, matches.pixels_1, matches.pixels_2, *lenses)
    return np.asarray(errors <= threshold_px)


def _epipolar_inliers(matches: Matches, camera: FloatArray, threshold_px: float) -> BoolArray:
    """Matches near their epipolar lines and in front of both cameras, or too far away to decide."""
    near = _near_lines(matches, camera, threshold_px)
    in_front = in_front_of_both(np.eye(3, 4), camera, *matches.normalised)
    far = matches.parallax_px(camera[:, :3]) <= threshold_px
    return np.asarray(near & (in_front | far))


def _with_camera(
    kind: str, matches: Matches, inliers: BoolArray, homography: FloatArray, camera: FloatArray, message: str
) -> TwoViewGeometry:
    matrix = fundamental_matrix(np.eye(3, 4), camera, matches.intrinsics_1, matches.intrinsics_2)
    matrix /= np.linalg.norm(matrix)
    angle = _median_angle_deg(matches, inliers, camera)
    return TwoViewGeometry(kind, inliers, matrix, homography, camera, angle, message)


def _median_angle_deg(matches: Matches, inliers: BoolArray, camera: FloatArray) -> float:
    rays_1, rays_2 = matches.select(inliers).rays
    return float(np.degrees(np.median(angles_rad(rays_1, rays_2, camera[:, :3]))))


def _rotation_geometry(
    matches: Matches, inliers: BoolArray, homography: FloatArray, rotation: FloatArray
) -> TwoViewGeometry:
    if not inliers.any():
        return _no_geometry(len(inliers), "no rotation and no plane explain the matches")
    camera = np.column_stack([rotation, np.zeros(3)])
    message = "the camera only turned: no parallax to determine depths"
    angle = _median_angle_deg(matches, inliers, camera)
    return TwoViewGeometry("rotation", inliers, _unknown_matrix(), homography, camera, angle, message)


def _identical_photos(still: BoolArray, known: bool) -> TwoViewGeometry:
    camera, angle = (np.eye(3, 4), 0.0) if known else (unknown_camera(), np.nan)
    message = "the photos are identical, or the camera did not move"
    return TwoViewGeometry("rotation", still, _unknown_matrix(), np.eye(3), camera, angle, message)


def _uncalibrated_planar(inliers: BoolArray, homography: FloatArray) -> TwoViewGeometry:
    message = "one homography explains the matches: a plane, or a camera that only turned"
    return TwoViewGeometry(
        "planar", inliers, _unknown_matrix(), homography, unknown_camera(), np.nan, message
    )


def _no_geometry(count: int, message: str) -> TwoViewGeometry:
    inliers = np.zeros(count, dtype=np.bool_)
    unknown = _unknown_matrix()
    return TwoViewGeometry("none", inliers, unknown, unknown, unknown_camera(), np.nan, message)


def _too_few(inliers: BoolArray, least: int) -> str:
    return f"{np.count_nonzero(inliers)} inliers: must be at least {least}"


def _unknown_matrix() -> FloatArray:
    return np.full((3, 3), np.nan)
