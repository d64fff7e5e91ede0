"""The numbers that steer an incremental reconstruction."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model.checks import require_count, require_fraction, require_positive, require_seed


@dataclass(frozen=True)
class IncrementalSettings:
    """What decides about the first pair, poses, points and adjustments (thesis algorithm 5).

    Attributes
    ----------
    outlier_px : float
        Observations with larger errors are left out [px] (thesis: 4).
    min_views : int
        Fewest images that see a point (thesis: 3 as an option).
    min_angle_deg : float
        Smallest angle between two rays of a point [deg]. Where the camera moves ahead, points under small
        angles carry the scale from image to image: on Malaga's drive 0.5° ends 0.20 m from the supplied
        poses, 1° 0.23 m, and 1.5° 6.4 m. Sets of photos hardly care.
    start_angle_deg : float
        Smallest median angle of the pair that is tried first [deg]; halved as long as no pair will do.
    start_points : int
        Fewest points that the first pair must give.
    resection_threshold_px : float
        Largest reprojection error of an inlier of resection [px]; twice as much where the focal length of the
        camera is a guess.
    min_inliers : int
        Fewest inliers of a pose to trust …
    min_inlier_ratio : float
        … and the smallest part of the points seen that they are.
    local_images : int
        Images that the local adjustment moves: the new one and those that share most points with it.
    growth : float
        The whole model is adjusted when its images or points have grown by this part since the last time.
    intrinsics_images : int
        Images of a camera that a model needs before its intrinsics are adjusted.
    loss_sigmas : float
        Scale of the robust (Cauchy) loss of adjustments, in standard deviations of a keypoint. A strict one
        takes what a camera model lacks for outliers: with 1 instead of 10 the focal length of a drone's
        photos moves by 2 %.
    min_model_images : int
        Fewest images of a model beside the largest.
    overlap_images : int
        Images of another model that a model takes in at most, so that both can be joined.
    seed : int
        Of every random sample; same seed, same result.
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
        for name, least in (("min_views", 2), ("min_inliers", 4), ("local_images", 2), ("start_points", 8)):
            require_count(name, getattr(self, name), least)
        require_fraction("min_inlier_ratio", self.min_inlier_ratio)
        require_seed(self.seed)
