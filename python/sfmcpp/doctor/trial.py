"""Trial adjustments of a copy of the problem, its camera freed where asked, and measures to judge them by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.ba import LinearModel, SolveOptions, Summary, adjust, residuals
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.geometry.point_tests import reprojection_errors_px
from sfmcpp.geometry.significance import MEDIAN_LENGTH
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, largest_of_each
from sfmcpp.model.camera_models import PERSPECTIVE, is_pinhole
from sfmcpp.model.names import Loss
from sfmcpp.model.residual_group import Group
from sfmcpp.model.uncertainty import Whitener

MAX_ITERATIONS = 30
# Errors are told long before the digits of the cost that send badly determined intrinsics on their way.
TOLERANCE = 1e-4
# A sum of squares is more about gross errors than about all the rest from this share on: an error of ten
# standard deviations costs as much as a hundred good observations.
GROSS, NOTABLE_SHARE = 10.0, 0.01
# What a loss keeps must be a good part of all, and fit twice as well as by another, to be believed.
_LEAST_SHARE, _TWICE = 0.4, 0.5
# Share of its diagonal added to H: what is not determined at all gets a large variance instead of none.
RIDGE = 1e-12
# Part of the image's radius that pixels at the border must move by for a scene to bend much.
BENDS = 0.02


@dataclass(frozen=True)
class Trial:
    """Result of a trial adjustment.

    Attributes
    ----------
    problem : Problem
        At its end.
    errors_px : (M,) float64
        Distances of the observations from the images of their points; infinite behind the camera [px]. Where
        observations have different σ, over their own and times the median σ.
    sigma_px : float
        Standard deviation that the median of those that the loss has not let go of amounts to [px].
    loss : str
        The loss.
    """

    problem: Problem
    errors_px: FloatArray
    sigma_px: float
    loss: Loss

    @property
    def median_px(self) -> float:
        """Median error [px]."""
        return float(self.sigma_px * MEDIAN_LENGTH)

    def gross(self, sigma_px: float) -> BoolArray:
        """(M,) observations off by more than ten standard deviations, as stated or as found."""
        return np.asarray(self.errors_px > GROSS * max(self.sigma_px, sigma_px))

    def squared_error(self, extent_px: float) -> float:
        """Sum of squares, errors beyond the image (and behind cameras) counted as its extent [px²]."""
        return float((np.minimum(self.errors_px, extent_px) ** 2).sum())


def adjusted(problem: Problem, constraints: Sequence[Group] = (), loss: Loss = "cauchy") -> Trial | str:
    """Adjust a copy of `problem`; a text with the reason if that fails."""
    moved = problem.copy()
    options = SolveOptions(
        loss=loss, loss_scale_px="auto", max_iterations=MAX_ITERATIONS, function_tolerance=TOLERANCE
    )
    try:
        summary = adjust(moved, constraints, options).require_uninterrupted()
    except InvalidArgument as error:
        return str(error)
    errors = _comparable_errors_px(moved)
    kept = _inlier_mask(moved, summary) if loss == "auto" else slice(None)
    return Trial(moved, errors, float(np.median(errors[kept]) / MEDIAN_LENGTH), loss)


def redundancy(problem: Problem, intrinsics: int = 0) -> int:
    """Numbers observed less those estimated, some intrinsics among them; at least one."""
    cameras, points = (len(np.unique(k)) for k in (problem.camera_index, problem.point_index))
    return max(2 * problem.num_observations - 6 * cameras - 3 * points - intrinsics, 1)


def may_be_perspective(problem: Problem) -> bool:
    """Whether :func:`as_perspective` takes a problem."""
    return problem.camera_model != "bal" and is_pinhole(problem.camera_model)


def as_perspective(problem: Problem) -> Problem:
    """A calibrated or perspective problem with all columns of perspective cameras; new ones are 0, held."""
    shape, given = (len(problem.intrinsics), len(PERSPECTIVE)), problem.intrinsics.shape[1]
    intrinsics, fixed = np.zeros(shape), np.ones(shape, dtype=np.bool_)
    intrinsics[:, :given], fixed[:, :given] = problem.intrinsics, problem.fixed_intrinsics
    return replace(problem, camera_model="perspective", intrinsics=intrinsics, fixed_intrinsics=fixed)


def with_free_sensors(problem: Problem, *free: int) -> Problem:
    """The problem with these sensors of its rigs free and no others."""
    if problem.rigs is None:
        return problem
    mask = np.isin(np.arange(problem.rigs.num_sensors), free)
    return replace(problem, rigs=replace(problem.rigs, free_sensors=mask))


def ridged_model(problem: Problem, constraints: Sequence[Group], *free: int) -> LinearModel:
    """The linear model in the fixed gauge with these sensors free; what is open has a large variance."""
    return LinearModel(with_free_sensors(problem, *free), constraints, SolveOptions(gauge="fixed"), RIDGE)


def rows_seen(problem: Problem) -> tuple[IndexArray, IndexArray]:
    """Rows of intrinsics (k,) that are observed, and a camera (k,) of each."""
    seen = np.unique(problem.camera_index)
    rows, first = np.unique(problem.intrinsics_index[seen], return_index=True)
    return rows.astype(np.int32), seen[first].astype(np.int32)


def radii_px(problem: Problem) -> FloatArray:
    """(C,) distance of the farthest observation of each camera from the principal point, or 1 [px]."""
    centres = pinhole_rows(problem.intrinsics)[problem.intrinsics_index[problem.camera_index], 2:4]
    distances = np.linalg.norm(problem.pixels - centres, axis=1)
    radii = largest_of_each(problem.camera_index, distances, problem.num_cameras)
    radii[radii == 0] = 1.0
    return radii


def moved_at_border(column: int, focals: FloatArray, radii: FloatArray) -> FloatArray:
    """Part of its radius by which one more of f, aspect, cx, cy or k1, by column, moves an image's border."""
    by_unit = {
        "f": 1 / focals,
        "aspect": np.ones_like(radii),
        "cx": 1 / radii,
        "cy": 1 / radii,
        "k1": (radii / focals) ** 2,
    }
    return by_unit[PERSPECTIVE[column]]


def median_sigma_px(problem: Problem) -> float:
    """Median stated standard deviation of the pixels, of u where there are covariances; else one [px]."""
    stated = Whitener.of(problem.sigma_px, problem.covariance_px2).sigma_px
    return float(np.median(stated)) if len(stated) else 1.0


def _comparable_errors_px(problem: Problem) -> FloatArray:
    """Reprojection errors (M,) over their own σ and times the median σ; infinite behind the camera."""
    errors, median = reprojection_errors_px(problem, problem.points), median_sigma_px(problem)
    if problem.covariance_px2 is not None:
        whitened = median * np.linalg.norm(residuals(problem), axis=1)
        return np.where(np.isfinite(errors), whitened, errors)
    return errors if problem.sigma_px is None else np.asarray(errors * (median / problem.sigma_px))


def _inlier_mask(problem: Problem, summary: Summary) -> BoolArray:
    """(M,) observations within the scale of a loss that is constant beyond it; all, if these are too few."""
    kept = np.linalg.norm(residuals(problem), axis=1) <= summary.loss_scale_px
    return kept if kept.mean() >= _LEAST_SHARE else np.ones_like(kept)


def robust_trial(problem: Problem, constraints: Sequence[Group], sigma_px: float) -> Trial | str:
    """Adjust a copy by the loss that gross errors lead away least.

    That is Cauchy's where they are few, and 'auto' where it shows that Cauchy's was led away: a good part of
    the observations is within ten standard deviations then, and fits twice as well.
    """
    limit_px = GROSS * sigma_px
    trial = adjusted(problem, constraints)
    if isinstance(trial, str) or np.mean(trial.errors_px > limit_px) <= NOTABLE_SHARE:
        return trial
    other = adjusted(problem, constraints, "auto")
    if isinstance(other, str) or np.mean(other.errors_px <= limit_px) < _LEAST_SHARE:
        return trial
    return other if other.sigma_px < _TWICE * trial.sigma_px else trial
