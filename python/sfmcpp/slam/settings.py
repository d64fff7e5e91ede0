"""The numbers that steer a SLAM run."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model.arguments import check_fields
from sfmcpp.model.checks import require_count, require_fraction, require_one_of, require_positive
from sfmcpp.weighting import WEIGHT_BOUNDS, selection_method

FINAL_ADJUSTMENTS = ("auto", "on", "off")


@dataclass(frozen=True)
class SlamSettings:
    """What decides about keyframes, poses, points and the local adjustment.

    Attributes
    ----------
    window : int
        Keyframes whose poses the local bundle adjustment moves. The thesis has 3 (§3.3.2); on tracks as short
        as those of KITTI the distances of an odometer need more to reach the points: 8 bring the
        error of every drive to half and less, 3 that of two in seven.
    keyframe_overlap : float
        A frame becomes a keyframe when it sees less than this part of the last keyframe's tracks …
    keyframe_min_tracks : int
        … or when fewer of its tracks than this have a point …
    keyframe_parallax_px : float
        … and the image has moved this far in the median since the last keyframe [px].
    start_parallax_px : float
        Median parallax that the first and the second keyframe need [px].
    start_point_ratio : float
        Part of the tracks shared by the first and the third keyframe that must become points.
    triangulation_keyframes : int
        Keyframes from which new points are triangulated (thesis: 3).
    resection_threshold_px : float
        Largest reprojection error of an inlier of resection [px].
    outlier_px : float
        Observations with larger errors after the local adjustment are dropped [px] (thesis: 4).
    min_views : int
        Fewest keyframes that see a point of the map (thesis: 3 as an option).
    min_angle_deg : float
        Smallest angle under which a new point is seen [deg].
    min_inliers : int
        Fewest inliers of a pose to trust.
    registration_keyframes : int
        Keyframes that bring the map into the sensors' world (thesis §5.3.3: 6).
    weights : str
        How the weight of a sensor's constraint is chosen: a method of :func:`sfmcpp.weighting.select_weight`.
    weight_bounds : str
        Between which weights to choose: ``"declared"``, at most that of the σ that the sensor declares and at
        least what a conflict with the images leaves of it; ``"none"``, any, as in the thesis. Without bounds,
        cross-validation takes an odometer of centimetres for one of tenths of a millimetre at a quarter of
        the keyframes, and for nothing at another.
    correct_drift : bool
        Whether the last keyframes are moved back to a sensor of poses or positions, where they have drifted
        from it as one. Not in the thesis; not done where no weight is asked for.
    correct_scale : bool
        Whether they are by the distances of an odometer, too. These hold the scale of the whole window by
        their weights already; moved for a percent of it, the map is torn where it was in one piece, and
        nothing but sensors ties it together at the end.
    final_adjustment : str
        Whether all keyframes are adjusted together at the end, with Cauchy's loss: ``"on"``, ``"off"``, or
        ``"auto"``, where that brings the images nearer to the map and every sensor too.
    hindsight : bool
        Whether a run of :func:`run_slam` that has found a sensor wrong is begun again without what was wrong:
        its map is bent already. Not in the thesis; not done where declared σ count for nothing.
    seed : int
        Of every random sample; same seed, same result.
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
        require_fraction("keyframe_overlap", self.keyframe_overlap)
        for name in ("start_parallax_px", "resection_threshold_px", "outlier_px", "keyframe_parallax_px"):
            require_positive(name, getattr(self, name))
        check_fields(self, "weights")
        if self.weights != "none":
            selection_method(self.weights)
        require_one_of("weight_bounds", self.weight_bounds, WEIGHT_BOUNDS)
        require_one_of("final_adjustment", self.final_adjustment, FINAL_ADJUSTMENTS)

    @property
    def trusts_declared(self) -> bool:
        """Whether what sensors declare bounds their weights; else these are the thesis' own, or constant."""
        chosen = self.weights != "none" and selection_method(self.weights).grid is None
        return chosen and self.weight_bounds == "declared"
