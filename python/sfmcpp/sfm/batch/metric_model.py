"""A metric model in progress: poses, points, inlier observations; its refinement and merged tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import SolveOptions, adjust
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import (
    Similarity,
    depths,
    refine_points,
    reprojection_errors_px,
    robust_triangulation,
    triangulate_linear,
)
from sfmcpp.geometry.autocalibration import MetricFrame
from sfmcpp.geometry.duplicate_points import duplicate_points, merged_tracks
from sfmcpp.geometry.significance import MEDIAN_LENGTH
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray

# Errors above this many robust standard deviations of one coordinate are outliers.
_OUTLIER_SIGMAS = 5.0
# A projection matrix has eleven freedoms, an observation two.
LEAST_OBSERVATIONS = 6
_LEAST_LIMIT_PX = 0.1
# Errors before the first adjustment that all count the same.
_FAR_PX = 30.0
_ROUNDS = 3
# Tolerances of merging, in multiples of the largest error of an observation: wide at first, as what has
# drifted lies beside itself, then as narrow as the errors are.
_TOLERANCES = (1.5, 0.75, 0.4)
# The last tolerance, in multiples of the error from which on an observation is an outlier.
_NARROWEST = 2.0
# Share by which the errors of tracks that were not merged may grow where others are.
_TOLERATED_GROWTH = 0.25


@dataclass(frozen=True)
class AdjustmentPlan:
    """How the model is adjusted.

    Attributes
    ----------
    free : tuple of str
        Intrinsics that are free.
    max_error_px : float
        Observations off by more are left out, however large the noise is.
    min_views : int
        Points that fewer images see are left out.
    threads : int
        Of the adjustments; the same bits for any.
    """

    free: tuple[str, ...]
    max_error_px: float
    min_views: int
    threads: int = 0


@dataclass(eq=False)
class MetricModel:
    """Cameras and points of a metric world, and the observations among those given that count.

    Attributes
    ----------
    problem : Problem
        Of camera model "perspective" with all observations and points that were given. Points that are not
        known are not a number.
    counts : (M,) bool
        Which observations take part.
    """

    problem: Problem
    counts: BoolArray

    def copy(self) -> MetricModel:
        """An independent copy."""
        return MetricModel(self.problem.copy(), self.counts.copy())

    @property
    def share_in_front(self) -> float:
        """Share of the observations whose point is in front of the camera."""
        return float(np.mean(depths(self.problem, self.problem.points) > 0))

    def errors_px(self) -> FloatArray:
        """(M,) errors of all observations; infinite where the point is behind the camera or unknown."""
        return reprojection_errors_px(self.problem, self.problem.points)

    def truncated_cost(self, limit_px: float) -> float:
        """Σ of squared errors, those above the limit counting as the limit: comparable between models."""
        return float(np.sum(np.minimum(self.errors_px(), limit_px) ** 2))

    def triangulate(self) -> None:
        """Find every point anew from the observations that count."""
        part, points = self.counting()
        found = triangulate_linear(part)
        self.problem.points[:] = np.nan
        self.problem.points[points] = refine_points(part, found)

    def prefer(self, points: FloatArray) -> None:
        """Take those of other `points` (N, 3) that lie nearer to their observations, outliers aside."""
        own, other = (self._closeness(p) for p in (self.problem.points, points))
        self.problem.points[:] = np.where((other < own)[:, None], points, self.problem.points)

    def _closeness(self, points: FloatArray) -> FloatArray:
        """(N,) sums of squared errors, none counting more than a wrong observation may."""
        errors = np.minimum(_errors_px(self.problem, points), _FAR_PX)
        squares = np.bincount(self.problem.point_index, errors**2, self.problem.num_points)
        return squares.astype(np.float64)

    def triangulate_robustly(self, max_error_px: float, min_views: int) -> None:
        """Find every point anew from what most of its observations agree on; these count."""
        points, inliers = robust_triangulation(
            self.problem, max_error_px=max_error_px, min_angle_deg=0.0, min_views=min_views
        )
        self.problem.points[:] = points
        self._count(inliers, min_views)

    def leave_out_behind(self, min_views: int) -> None:
        """Of the observations that count, keep those whose point is in front."""
        self._count(self.counts & (depths(self.problem, self.problem.points) > 0), min_views)

    def leave_out_outliers(self, max_error_px: float, min_views: int) -> None:
        """Of the observations that count, keep those that agree with the model."""
        self._count(self.counts & (self.errors_px() <= self.outlier_limit_px(max_error_px)), min_views)

    def outlier_limit_px(self, max_error_px: float) -> float:
        """Error from which on an observation is an outlier [px]."""
        errors = self.errors_px()[self.counts]
        spread = float(np.median(errors)) / MEDIAN_LENGTH if len(errors) else 0.0
        return min(max_error_px, max(_OUTLIER_SIGMAS * spread, _LEAST_LIMIT_PX))

    def merge(self, tolerance_px: float) -> int:
        """Merge points that are one, among those that count; how many there are fewer."""
        part, points = self.counting()
        pairs = duplicate_points(part, part.points, tolerance_px=tolerance_px)
        merged = merged_tracks(part, pairs)
        # Outliers keep their point: an image might see the merged one twice.
        self.problem.point_index[self.counts] = points[merged]
        return len(points) - len(np.unique(merged))

    def adjust(self, plan: AdjustmentPlan, *, loss: str = "squared", max_iterations: int = 100) -> None:
        """Adjust cameras, free intrinsics and points by the observations that count."""
        part, points = self.counting()
        part.set_free_intrinsics(*plan.free)
        scale: float | str = "auto" if loss != "squared" else 1.0
        options = {"loss": loss, "loss_scale_px": scale, "max_iterations": max_iterations}
        adjust(part, [], SolveOptions(threads=plan.threads, **options))  # type: ignore[arg-type]
        self.problem.cameras[:], self.problem.intrinsics[:] = part.cameras, part.intrinsics
        self.problem.points[points] = part.points

    def normalise(self) -> None:
        """Move the mean of the centres to the origin, and scale their RMS distance from it to one."""
        centres = self.problem.centres
        mean = centres.mean(axis=0)
        spread = float(np.sqrt(((centres - mean) ** 2).sum(axis=1).mean()))
        if spread > 0:
            place = Similarity(1 / spread, np.eye(3), -mean / spread)
            self.problem.cameras[:] = place.apply_to_poses(self.problem.cameras)
            self.problem.points[:] = place.apply(self.problem.points)

    def _count(self, good: BoolArray, min_views: int) -> None:
        """Let what is good count, without points of too few views and images of too few observations."""
        whole, before = self.problem, np.intp(-1)
        while np.count_nonzero(good) != before:
            before = np.count_nonzero(good)
            views = np.bincount(whole.point_index[good], minlength=whole.num_points)
            good = good & (views >= min_views)[whole.point_index]
            seen = np.bincount(whole.camera_index[good], minlength=whole.num_cameras)
            good = good & (seen >= LEAST_OBSERVATIONS)[whole.camera_index]
        self.counts = good

    def counting(self) -> tuple[Problem, NDArray[np.intp]]:
        """The problem of the observations that count, and which points it has."""
        part = self.problem.with_observations(self.counts)
        points = np.unique(part.point_index)
        return part.with_points(points), points.astype(np.intp)


@dataclass(frozen=True, eq=False)
class KeptIndices:
    """Indices of the images, tracks and observations that a model keeps.

    Attributes
    ----------
    problem : Problem
        Of that alone.
    cameras, points, observations : (C',), (N',), (M',) int
        Which it holds of those given.
    """

    problem: Problem
    cameras: NDArray[np.intp]
    points: NDArray[np.intp]
    observations: NDArray[np.intp]


def kept_indices(model: MetricModel, free: tuple[str, ...]) -> KeptIndices:
    """Kept part of a model as a problem, with the intrinsics `free` free, and its indices."""
    part, points = model.counting()
    cameras = np.unique(part.camera_index).astype(np.intp)
    result = part.with_cameras(cameras)
    result.set_free_intrinsics(*free)
    return KeptIndices(result, cameras, points, np.flatnonzero(model.counts))


def model_in_frame(
    problem: Problem, projections: FloatArray, frame: MetricFrame, intrinsics: FloatArray
) -> MetricModel:
    """See a projective problem in a metric frame (thesis eq. 3.43), mirrored as cheirality demands.

    Parameters
    ----------
    problem : Problem
        Of camera model "projective".
    projections : (C, 3, 4) float64
        Its projection matrices to pixels.
    frame : MetricFrame
        Of these matrices.
    intrinsics : (C, 5) float64
        ``f, aspect, cx, cy, skew`` of each camera in this frame.

    Returns
    -------
    MetricModel
        Points are triangulated anew; one row of intrinsics for each camera, free as the model has it. All
        observations count whose points are known and in front of the camera.
    """
    matrices = np.linalg.solve(calibration_matrices(intrinsics), projections @ frame.homography)
    scale = np.cbrt(np.linalg.det(matrices[:, :, :3]))
    if not (np.isfinite(scale).all() and (scale != 0).all()):
        raise InvalidArgument("frame: has a camera at infinity")
    matrices = matrices / scale[:, None, None]
    centres = -np.linalg.solve(matrices[:, :, :3], matrices[:, :, 3:])
    rotations = np.swapaxes(nearest_rotation(matrices[:, :, :3]), 1, 2)
    rows = np.zeros((problem.num_cameras, 12))
    rows[:, : intrinsics.shape[1]] = intrinsics
    metric = Problem(
        "perspective",
        np.concatenate([rotations, centres], axis=2),
        rows,
        np.full((problem.num_points, 3), np.nan),
        problem.camera_index.copy(),
        problem.point_index.copy(),
        problem.pixels.copy(),
        sigma_px=problem.sigma_px,
        covariance_px2=problem.covariance_px2,
        metadata=_plain_metadata(problem.metadata),
    )
    model = MetricModel(metric, np.ones(problem.num_observations, dtype=np.bool_))
    model.triangulate()
    if model.share_in_front < 0.5:
        # Seen in a mirror: x_cam = Rᵀ(X − c) changes its sign with X and c.
        metric.centres[:] *= -1
        model.triangulate()
    model.prefer(_points_in_frame(problem, frame, metric))
    model.leave_out_behind(2)
    model.normalise()
    return model


def _points_in_frame(problem: Problem, frame: MetricFrame, metric: Problem) -> FloatArray:
    """(N, 3) points of the projective problem in the frame, mirrored if the centres are."""
    homogeneous = np.linalg.solve(frame.homography, problem.points.T).T
    with np.errstate(all="ignore"):
        points = homogeneous[:, :3] / homogeneous[:, 3:]
    near, far = (np.nanmedian(_errors_px(metric, sign * points)) for sign in (1.0, -1.0))
    return np.asarray(points if near <= far else -points)


def _errors_px(metric: Problem, points: FloatArray) -> FloatArray:
    known = np.isfinite(points).all(axis=1, keepdims=True)
    return reprojection_errors_px(metric, np.where(known, points, np.nan))


def calibration_matrices(intrinsics: FloatArray) -> FloatArray:
    """(C, 3, 3) upper triangular K of (C, 5) ``f, aspect, cx, cy, skew``."""
    f, aspect, cx, cy, skew = np.moveaxis(np.asarray(intrinsics), -1, 0)
    zero, one = np.zeros_like(f), np.ones_like(f)
    rows = np.stack([f, skew, cx, zero, aspect * f, cy, zero, zero, one], axis=-1)
    return np.asarray(rows.reshape(*f.shape, 3, 3))


def share_intrinsics(model: MetricModel) -> None:
    """Let all cameras share one row of intrinsics, the mean of theirs."""
    whole = model.problem
    model.problem = replace(
        whole,
        intrinsics=whole.intrinsics.mean(axis=0, keepdims=True),
        intrinsics_index=np.zeros(whole.num_cameras, dtype=np.int32),
        fixed_intrinsics=whole.fixed_intrinsics[:1],
    )


def _plain_metadata(metadata: Metadata) -> Metadata:
    """Metadata without entries per observation and point: names, sizes, colours."""
    return replace(metadata, extra={})


def refine(model: MetricModel, plan: AdjustmentPlan) -> None:
    """Adjust a model and leave out outliers, in turn.

    Parameters
    ----------
    model : MetricModel
        Changed in place; any observation may come back.
    plan : AdjustmentPlan
        What is free and what counts.
    """
    for _ in range(_ROUNDS):
        _select_inliers(model, plan)
        if not model.counts.any():
            return
        model.adjust(plan, loss="cauchy")
    model.leave_out_outliers(plan.max_error_px, plan.min_views)


def close_gaps(model: MetricModel, plan: AdjustmentPlan) -> int:
    """Merge tracks of one point and adjust, in turn; as it was before where this spoils the other tracks.

    Every round starts with the tracks that were given, so that what was merged wrongly with a wide tolerance
    does not stay.

    Parameters
    ----------
    model : MetricModel
        A refined one, changed in place.
    plan : AdjustmentPlan
        What is free and what counts.

    Returns
    -------
    int
        How many points there are fewer.
    """
    if not model.counts.any():
        return 0
    before, tracks = model.copy(), model.problem.point_index.copy()
    narrow = _NARROWEST * model.outlier_limit_px(plan.max_error_px)
    # Two tracks of two views may be one of four.
    short = replace(plan, min_views=2)
    wide = [share * plan.max_error_px for share in _TOLERANCES]
    for tolerance in [*(t for t in wide if t > narrow), narrow]:
        _select_inliers(model, short)
        model.merge(tolerance)
        model.triangulate()
        model.leave_out_behind(short.min_views)
        model.adjust(plan, loss="cauchy")
        model.problem.point_index[:] = tracks
    _select_inliers(model, short)
    limit = plan.max_error_px
    if model.truncated_cost(limit) > (1 + _TOLERATED_GROWTH) * before.truncated_cost(limit) + 1e-12:
        model.problem, model.counts = before.problem, before.counts
        return 0
    fewer = model.merge(narrow)
    model.triangulate()
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
    model.adjust(plan, loss="cauchy")
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
    return fewer


def _select_inliers(model: MetricModel, plan: AdjustmentPlan) -> None:
    """Triangulate all points anew and let count what agrees."""
    model.triangulate_robustly(plan.max_error_px, plan.min_views)
    model.leave_out_outliers(plan.max_error_px, plan.min_views)
