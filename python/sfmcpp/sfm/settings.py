"""Settings of an incremental reconstruction."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model.checks import (
    require_count,
    require_fraction,
    require_not_negative,
    require_positive,
    require_seed,
)

_LEAST_COUNTS = {
    "min_views": 2,
    "min_inliers": 4,
    "local_images": 2,
    "start_points": 8,
    "intrinsics_images": 1,
    "min_model_images": 1,
    "overlap_images": 0,
}


@dataclass(frozen=True)
class IncrementalSettings:
    """Settings of the initial pair, poses, points and adjustments (thesis algorithm 5).

    Attributes
    ----------
    outlier_px : float
        Observations with larger errors are left out [px] (thesis: 4).
    min_views : int
        Minimum number of images that see a point (thesis: 3 as an option).
    min_angle_deg : float
        Smallest triangulation angle of a point [deg]. If the camera moves forward, points with small angles
        carry the scale from image to image: on Malaga's drive the result is 0.20 m from the supplied poses
        with 0.5°, 0.23 m with 1°, and 6.4 m with 1.5°. The effect on photo collections is small.
    start_angle_deg : float
        Smallest median angle of the initial pair [deg]; halved until a pair meets it.
    start_points : int
        Minimum number of points that the initial pair must yield.
    resection_threshold_px : float
        Largest reprojection error of an inlier of resection [px]; doubled if the focal length of the camera
        is a guess.
    min_inliers : int
        Minimum number of inliers of a pose.
    min_inlier_ratio : float
        Minimum fraction of inliers among the points seen.
    local_images : int
        Number of images that the local adjustment moves: the new one and those that share the most points
        with it.
    growth : float
        The whole model is adjusted when its images or points have grown by this fraction since the last time.
    intrinsics_images : int
        Number of images of a camera in the model from which its intrinsics are adjusted.
    loss_sigmas : float
        Scale of the robust (Cauchy) loss of adjustments, in standard deviations of a keypoint. A small scale
        treats errors of the camera model as outliers: with 1 instead of 10, the focal length of a drone's
        photos changes by 2 %.
    min_model_images : int
        Minimum number of images of a model other than the largest.
    overlap_images : int
        Maximum number of images of another model that a model registers, so that the two can be joined.
    seed : int
        Seed of all random samples; the same seed gives the same result.
    """

    outlier_px: float = 4.0
    min_views: int = 2
    min_angle_deg: float = 0.75
    start_angle_deg: float = 16.0
    start_points: int = 50
    resection_threshold_px: float = 6.0
    min_inliers: int = 15
    min_inlier_ratio: float = 0.25
    local_images: int = 6
    growth: float = 0.2
    intrinsics_images: int = 4
    loss_sigmas: float = 10.0
    min_model_images: int = 3
    overlap_images: int = 10
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("outlier_px", "start_angle_deg", "resection_threshold_px", "growth", "loss_sigmas"):
            require_positive(name, getattr(self, name))
        for name, least in _LEAST_COUNTS.items():
            require_count(name, getattr(self, name), least)
        require_not_negative("min_angle_deg", self.min_angle_deg)
        require_fraction("min_inlier_ratio", self.min_inlier_ratio)
        require_seed(self.seed)
