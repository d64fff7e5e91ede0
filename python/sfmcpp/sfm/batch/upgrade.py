"""Metric upgrade of a projective reconstruction, calibrated or not (thesis algorithm 4)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.ba import projection_matrices
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.autocalibration import FOCALS, MetricFrame, metric_frames
from sfmcpp.model import Problem
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import require_count, require_one_of, require_positive
from sfmcpp.sfm.batch.metric_model import (
    LEAST_OBSERVATIONS,
    AdjustmentPlan,
    MetricModel,
    calibration_matrices,
    close_gaps,
    kept_indices,
    model_in_frame,
    refine,
    share_intrinsics,
)
from sfmcpp.sfm.batch.verdict import (
    contradiction,
    critical_motion,
    focal_sigmas,
    left_out_warnings,
    misfit_warnings,
    no_model_message,
)

# Metric frames that are adjusted at most, and how far the cost of the worst may lie above that of the best.
_MOST_FRAMES, _COST_RANGE = 4, 30.0
# Share of observations that must be in front of their cameras before the adjustment, and that must agree
# with the model in the end.
_LEAST_IN_FRONT, _LEAST_KEPT = 0.6, 0.5
# Errors before the adjustment, in multiples of the largest after it, that all count the same.
_FAR_ERRORS = 10.0
# Models whose costs differ by less than this share fit as well as each other.
_AS_GOOD = 0.02
# Relative standard deviation from which on the images do not tell the focal length.
_UNTOLD = 0.1
# Cameras from which on those of few observations do not help to calibrate.
_ENOUGH_CAMERAS = 5


def _no_indices() -> NDArray[np.intp]:
    return np.zeros(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class MetricUpgrade:
    """Result of the metric upgrade.

    Attributes
    ----------
    problem : Problem or None
        Of camera model "perspective", adjusted, with the observations that agree with it; the mean of its
        centres is the origin, their root mean squared distance from it one. None if there is no upgrade.
    reason : str
        Why there is none, in a sentence; empty if there is one.
    cameras, points, observations : (C',), (N',), (M',) int
        Which of those given it holds; of points that were merged the first.
    focal_sigma : float
        Standard deviation of the focal length over itself, the largest of all cameras; 0 if it is known.
    warnings : list of str
        What a user should know, in sentences.
    """

    problem: Problem | None
    reason: str = ""
    cameras: NDArray[np.intp] = field(default_factory=_no_indices)
    points: NDArray[np.intp] = field(default_factory=_no_indices)
    observations: NDArray[np.intp] = field(default_factory=_no_indices)
    focal_sigma: float = 0.0
    warnings: list[str] = field(default_factory=list)


def metric_upgrade(
    problem: Problem,
    sizes: ArrayLike,
    *,
    focal: str = "shared",
    intrinsics: ArrayLike | None = None,
    aspect: float = 1.0,
    principal_point: ArrayLike | None = None,
    distortion: int = 0,
    max_error_px: float = 4.0,
    min_views: int = 2,
    merge_tracks: bool = True,
    adjusted: bool = True,
    threads: int = 0,
) -> MetricUpgrade:
    """Make a metric problem of a projective one (thesis §3.3.1.2), and adjust it.

    The metric frames that fit are tried (:func:`sfmcpp.geometry.autocalibration.metric_frames`): points are
    triangulated, cheirality rejects what is inside out, and the best after a robust bundle adjustment is
    kept. Its focal length stays free if it was not known. Outliers are found by the spread of the errors.

    Parameters
    ----------
    problem : Problem
        Of camera model "projective", with C cameras and M observations of N points; left untouched.
    sizes : (2,) or (C, 2) int
        Width and height of the images [px].
    focal : {"shared", "varying", "known"}
        Whether all cameras have one unknown focal length, each its own, or `intrinsics` are known.
    intrinsics : (5,) or (C, 5), optional
        Known ``f, aspect, cx, cy, skew``; only with ``focal="known"``. The observations are free of
        distortion.
    aspect : float
        Known aspect ratio ``f_y / f_x``.
    principal_point : (2,) or (C, 2), optional
        Known principal point [px]. Default: the centre of the image.
    distortion : int
        How many of k1 … k5 are free in the last adjustment, from 0.
    max_error_px : float
        Observations off by more are outliers, however large the noise is [px].
    min_views : int
        Points that fewer images see are left out, at least 2.
    merge_tracks : bool
        Whether points that prove to be one are merged: a corner lost and found again, also where the cameras
        come back to their start. This is what keeps a turntable from drifting.
    adjusted : bool
        False: the best metric frame as it is found, with all observations whose point is in front of the
        camera, as an adjustment finds it.
    threads : int
        0: as many as the machine has. The same bits for any.

    Returns
    -------
    MetricUpgrade
        With a problem, or with the reason why there is none: cameras that move so that the focal length is
        not seen, cameras or points that contradict each other, or what was taken as known.

    Raises
    ------
    InvalidArgument
        If the problem is metric, a shape is wrong, or an option is out of its range.
    """
    if problem.is_metric:
        raise InvalidArgument(f"problem: camera model {problem.camera_model!r}, must be 'projective'")
    require_one_of("focal", focal, FOCALS)
    require_positive("aspect", aspect)
    require_positive("max_error_px", max_error_px)
    require_count("min_views", min_views, 2)
    if not 0 <= distortion <= 5:
        raise InvalidArgument(f"distortion = {distortion}: must be from 0 to 5")
    rows = _assumed_calibrations(problem.num_cameras, sizes, focal, intrinsics, aspect, principal_point)
    names = () if focal == "known" else ("f",)
    plan = AdjustmentPlan(names, max_error_px, min_views, threads)
    last = replace(plan, free=(*names, *(f"k{k + 1}" for k in range(distortion))))
    projections = projection_matrices(problem)
    good, fewest = _well_determined_cameras(problem), 2 if focal == "known" else 3
    if len(good) < fewest:
        reason = f"{len(good)} cameras with {LEAST_OBSERVATIONS} observations, must be at least {fewest}"
        return MetricUpgrade(None, reason)
    try:
        frames = metric_frames(projections[good], calibration_matrices(rows[good]), focal=focal)
    except InvalidArgument:
        reason = "all projection matrices share one centre, or one lacks the rank of three: no depth is seen"
        return MetricUpgrade(None, reason)
    models = _candidate_models(problem, projections, good, frames, rows, focal)
    if not models:
        return MetricUpgrade(None, no_model_message(focal))
    if not adjusted:
        kept = kept_indices(_ranked_models(models, _FAR_ERRORS * max_error_px)[0], names)
        return MetricUpgrade(kept.problem, "", kept.cameras, kept.points, kept.observations)
    for model in models:
        model.adjust(plan, loss="cauchy", max_iterations=40)
    result = _adjusted_best_model(_ranked_models(models, max_error_px), last, focal, merge_tracks)
    if result.problem is not None:
        result.warnings.extend(misfit_warnings(problem, result.problem, result.observations, max_error_px))
    return result


def _well_determined_cameras(problem: Problem) -> NDArray[np.intp]:
    """Cameras whose matrix the observations hold well, or, of too few such, hold at all."""
    seen = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    good = np.flatnonzero(seen >= 2 * LEAST_OBSERVATIONS)
    return good if len(good) >= _ENOUGH_CAMERAS else np.flatnonzero(seen >= LEAST_OBSERVATIONS)


def _assumed_calibrations(
    count: int,
    sizes: ArrayLike,
    focal: str,
    intrinsics: ArrayLike | None,
    aspect: float,
    principal_point: ArrayLike | None,
) -> FloatArray:
    """(C, 5) ``f, aspect, cx, cy, skew``, with width plus height in place of an unknown focal length."""
    if (intrinsics is not None) != (focal == "known"):
        rule = "must be given" if focal == "known" else "must be left out"
        raise InvalidArgument(f"intrinsics: {rule} with focal = {focal!r}")
    if intrinsics is not None:
        rows = _row_per_camera("intrinsics", intrinsics, count, 5)
        if not (rows[:, :2] > 0).all():
            raise InvalidArgument("intrinsics: f and aspect must be positive")
        return rows
    extent = _row_per_camera("sizes", sizes, count, 2)
    if not (extent > 0).all():
        raise InvalidArgument("sizes: must be positive")
    centre = extent / 2 if principal_point is None else principal_point
    rows = np.zeros((count, 5))
    rows[:, 0], rows[:, 1] = extent.sum(axis=1), aspect
    rows[:, 2:4] = _row_per_camera("principal_point", centre, count, 2)
    return rows


def _row_per_camera(name: str, value: ArrayLike, count: int, width: int) -> FloatArray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 1:
        array = np.tile(array, (count, 1))
    array = finite_array(name, array, (ANY, width))
    if len(array) != count:
        raise InvalidArgument(f"{name}: {len(array)} rows for {count} cameras")
    return array


def _candidate_models(
    problem: Problem,
    projections: FloatArray,
    good: NDArray[np.intp],
    frames: list[MetricFrame],
    rows: FloatArray,
    focal: str,
) -> list[MetricModel]:
    """Models of the frames that fit about as well as the best and have their points in front."""
    models = []
    for frame in frames[:_MOST_FRAMES]:
        if frame.cost > _COST_RANGE * frames[0].cost + 1e-9 * len(rows):
            break
        factors = np.full(len(rows), np.median(frame.focals))
        factors[good] = frame.focals
        own = rows.copy()
        own[:, 0] *= factors
        model = model_in_frame(problem, projections, frame, own)
        if model.share_in_front >= _LEAST_IN_FRONT:
            if focal == "shared":
                share_intrinsics(model)
            models.append(model)
    return models


def _ranked_models(models: list[MetricModel], limit_px: float) -> list[MetricModel]:
    costs = [model.truncated_cost(limit_px) for model in models]
    return [models[k] for k in np.argsort(costs, kind="stable")]


def _adjusted_best_model(
    models: list[MetricModel], plan: AdjustmentPlan, focal: str, merge_tracks: bool
) -> MetricUpgrade:
    """Adjust the best model without outliers, with warnings about it."""
    best = models[0]
    rivals = [m for m in models[1:] if _is_equally_good(m, best, plan.max_error_px)]
    refine(best, plan)
    if merge_tracks:
        close_gaps(best, plan)
    kept_share = float(np.mean(best.counts))
    if kept_share < _LEAST_KEPT:
        return MetricUpgrade(None, contradiction(kept_share, focal))
    best.adjust(plan)
    best.normalise()
    kept = kept_indices(best, plan.free)
    sigma, cautious = (0.0, 0.0) if focal == "known" else focal_sigmas(kept.problem, plan.threads)
    if not cautious < _UNTOLD or any(_have_different_focals(m, best) for m in rivals):
        return MetricUpgrade(None, critical_motion(cautious), focal_sigma=cautious)
    warnings = left_out_warnings(best.problem, kept.cameras)
    return MetricUpgrade(kept.problem, "", kept.cameras, kept.points, kept.observations, sigma, warnings)


def _is_equally_good(model: MetricModel, best: MetricModel, limit_px: float) -> bool:
    return model.truncated_cost(limit_px) <= (1 + _AS_GOOD) * best.truncated_cost(limit_px) + 1e-12


def _have_different_focals(model: MetricModel, best: MetricModel) -> bool:
    """Whether two models have other focal lengths."""
    focals = [m.problem.intrinsics[m.problem.intrinsics_index, 0] for m in (model, best)]
    return bool(np.abs(np.log(focals[0] / focals[1])).max() > _UNTOLD)
