"""Settings of a SLAM run."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model.arguments import check_fields
from sfmcpp.model.checks import (
    require_count,
    require_fraction,
    require_not_negative,
    require_one_of,
    require_positive,
    require_seed,
    require_share,
)
from sfmcpp.weighting import WEIGHT_BOUNDS, selection_method

FINAL_ADJUSTMENTS = ("auto", "on", "off")


@dataclass(frozen=True)
class SlamSettings:
    """Settings of keyframes, poses, points, the local adjustment and sensor weights.

    Attributes
    ----------
    window : int
        Number of keyframes whose poses the local bundle adjustment moves. The thesis uses 3 (§3.3.2); with
        tracks as short as those of KITTI, odometer distances need more keyframes to affect the points: 8
        halve the error of every drive or better, 3 that of two in seven.
    keyframe_overlap : float
        A frame becomes a keyframe if it sees less than this fraction of the last keyframe's tracks.
    keyframe_min_tracks : int
        A frame also becomes a keyframe if fewer of its tracks than this have a point and the image has moved
        by more than `keyframe_parallax_px`.
    keyframe_parallax_px : float
        Median image motion since the last keyframe that `keyframe_min_tracks` requires [px].
    start_parallax_px : float
        Median parallax that the first and the second keyframe need [px].
    start_point_ratio : float
        Fraction of the tracks shared by the first and the third keyframe that must become points.
    triangulation_keyframes : int
        Keyframes from which new points are triangulated (thesis: 3).
    resection_threshold_px : float
        Largest reprojection error of an inlier of resection [px].
    outlier_px : float
        Observations with larger errors after the local adjustment are dropped [px] (thesis: 4).
    min_views : int
        Minimum number of keyframes that see a point of the map (thesis: 3 as an option).
    min_angle_deg : float
        Smallest triangulation angle of a new point [deg].
    min_inliers : int
        Minimum number of inliers of a pose.
    registration_keyframes : int
        Number of keyframes used to register the map to the sensors' world (thesis §5.3.3: 6).
    weights : str
        How the weight of a sensor's constraint is chosen: a method of :func:`sfmcpp.weighting.select_weight`.
    weight_bounds : str
        Bounds of the weights: ``"declared"``, at most the weight of the σ that the sensor declares, at least
        that weight as reduced by a conflict with the images; ``"none"``, no bounds, as in the thesis. Without
        bounds, cross-validation treats an odometer accurate to centimetres as accurate to tenths of a
        millimetre at a quarter of the keyframes, and ignores it at another quarter.
    correct_drift : bool
        Whether the last keyframes are moved back to a sensor of poses or positions if they have drifted from
        it together. Not in the thesis; not done without weights.
    correct_scale : bool
        Whether the distances of an odometer correct the scale of the last keyframes as well. Their weights
        already keep the scale of the whole window; a correction of one percent breaks a consistent map into
        pieces that only sensors connect.
    final_adjustment : str
        Adjustment of all keyframes together at the end, with Cauchy's loss: ``"on"``, ``"off"``, or
        ``"auto"``: kept if it reduces the errors of the images and of every sensor.
    hindsight : bool
        Whether :func:`run_slam` starts again without the wrong measurements once it has found a sensor to be
        wrong, because they have distorted the map. Not in the thesis; not done if declared σ are not used.
    seed : int
        Seed of all random samples; the same seed gives the same result.

    Raises
    ------
    InvalidArgument
        If a number is out of its range, a flag is no bool, or a name is unknown.
    """

    window: int = 8
    keyframe_overlap: float = 0.7
    keyframe_min_tracks: int = 30
    keyframe_parallax_px: float = 5.0
    start_parallax_px: float = 20.0
    start_point_ratio: float = 0.6
    triangulation_keyframes: int = 8
    resection_threshold_px: float = 3.0
    outlier_px: float = 4.0
    min_views: int = 2
    min_angle_deg: float = 0.5
    min_inliers: int = 10
    registration_keyframes: int = 6
    weights: str = "loo"
    weight_bounds: str = "declared"
    correct_drift: bool = True
    correct_scale: bool = False
    final_adjustment: str = "auto"
    hindsight: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("window", "min_views", "registration_keyframes"):
            require_count(name, getattr(self, name), at_least=2)
        require_count("min_inliers", self.min_inliers, at_least=6)
        require_count("triangulation_keyframes", self.triangulation_keyframes)
        require_count("keyframe_min_tracks", self.keyframe_min_tracks, at_least=0)
        require_fraction("keyframe_overlap", self.keyframe_overlap)
        require_share("start_point_ratio", self.start_point_ratio)
        require_not_negative("min_angle_deg", self.min_angle_deg)
        require_seed(self.seed)
        for name in ("start_parallax_px", "resection_threshold_px", "outlier_px", "keyframe_parallax_px"):
            require_positive(name, getattr(self, name))
        check_fields(self, "weights", "correct_drift", "correct_scale", "hindsight")
        if self.weights != "none":
            selection_method(self.weights, argument="weights")
        require_one_of("weight_bounds", self.weight_bounds, WEIGHT_BOUNDS)
        require_one_of("final_adjustment", self.final_adjustment, FINAL_ADJUSTMENTS)

    @property
    def trusts_declared(self) -> bool:
        """Whether what sensors declare bounds their weights; else these are the thesis' own, or constant."""
        chosen = self.weights != "none" and selection_method(self.weights).grid is None
        return chosen and self.weight_bounds == "declared"
