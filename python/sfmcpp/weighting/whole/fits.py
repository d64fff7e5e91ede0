"""A whole problem fitted again and again, with other weights of its constraints."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.adjust import adjust
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.ba.options import SolveOptions
from sfmcpp.model import CONSTRAINT_KINDS, ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.pose_constraint import ConstraintUnit
from sfmcpp.weighting.whole.constraint_rows import squared_error
from sfmcpp.weighting.whole.robust_loss import influence_slope, rho, rho_slope, tukey

# Steps of a fit that starts at a neighbour's optimum; with hardly any damping, which would hold back just
# the weak directions that a sensor decides.
FIT_STEPS = 30
_WARM_DAMPING = 1e-9
# Without one of its observations a point may be hardly determined, and must be held.
_SUBSET_DAMPING = 1e-5
_FIT_TOLERANCE = 1e-10
# Inliers are within this many standard deviations of the images alone.
INLIER_SIGMAS = 2.0
# Predicted errors of this many standard deviations all count the same: the usual scale of Tukey's loss.
_LEFT_OUT_SIGMAS = 4.6851
# Squared length of two unit normal numbers: its median.
_MEDIAN_OF_TWO = 2 * math.log(2)
# Nearly all observations are outliers: the scale of the loss is too small.
_LEAST_SLOPE = 0.05
# Images without noise are taken to have this share of their declared one.
_LEAST_NOISE = 1e-6

# Best and worst sensor, as a share of the extent of what it measures.
_RANGE = 1e6


@dataclass(frozen=True)
class WeightFit:
    """An optimum at some weights.

    Attributes
    ----------
    problem : Problem
        The optimum.
    images : float
        Σ ρ(‖r‖²) of the observations.
    errors : (k,) float64
        Σ m ε of each group.
    inliers : int
        Observations within `INLIER_SIGMAS` of the noise of the images alone.
    """

    problem: Problem
    images: float
    errors: FloatArray
    inliers: int


class WeightFits:
    """A problem and its groups, to be fitted at any weights.

    Parameters
    ----------
    problem : Problem
        The start; left untouched.
    groups : sequence of ConstraintGroup
        All groups; left untouched.
    options : SolveOptions
        Those of the solve; its loss, linear solver, threads, gauge and time limit hold for each fit.

    Attributes
    ----------
    noise : float
        Standard deviation of the images alone by their median residual, in units of the declared one.
    alone : WeightFit
        The optimum of the images alone.
    latest : dict
        What :func:`fit_statistics` keeps.

    Raises
    ------
    InvalidArgument
        If the problem, a group or an option breaks a rule.
    """

    def __init__(self, problem: Problem, groups: Sequence[ConstraintGroup], options: SolveOptions) -> None:
        _core.check(core_arrays(problem))
        self.latest: dict[tuple[int, bytes], Any] = {}
        self.groups = [_without_unmoved(group, problem) for group in groups]
        self.options = _fit_options(options)
        state = problem.copy()
        started = _run(state, self.groups, np.zeros(len(groups)), self.options)
        self.options = self._changed(
            loss_scale_px=started, max_iterations=FIT_STEPS, initial_damping=_WARM_DAMPING
        )
        squared = _squared_residuals(state)
        self.noise = max(_noise(squared), _LEAST_NOISE)
        self.alone = self._result(state, squared)

    def fit(self, weights: FloatArray, start: Problem) -> WeightFit:
        """Fit at the given weights.

        Parameters
        ----------
        weights : (k,) float64
            One for each group.
        start : Problem
            Where to start; left untouched.

        Returns
        -------
        WeightFit
            The optimum.
        """
        state = start.copy()
        _run(state, self.groups, weights, self.options)
        return self._result(state, _squared_residuals(state))

    def fit_subset(self, weights: FloatArray, start: Problem, keep: FloatArray, steps: int) -> Problem:
        """Fit to some of the observations, for a few steps.

        Parameters
        ----------
        weights : (k,) float64
            One for each group.
        start : Problem
            Where to start; left untouched.
        keep : (M,) bool
            The observations to fit to.
        steps : int
            Steps tried at most.

        Returns
        -------
        Problem
            The start with the fitted cameras, intrinsics and points, and all its observations.
        """
        state = start.copy()
        sigma = None if state.sigma_px is None else state.sigma_px[keep]
        subset = dataclasses.replace(
            state,
            camera_index=state.camera_index[keep],
            point_index=state.point_index[keep],
            pixels=state.pixels[keep],
            sigma_px=sigma,
        )
        options = self._changed(max_iterations=steps, initial_damping=_SUBSET_DAMPING)
        _run(subset, self.groups, weights, options)
        return dataclasses.replace(
            state, cameras=subset.cameras, intrinsics=subset.intrinsics, points=subset.points
        )

    def unit(self, k: int) -> ConstraintUnit:
        """Unit and spread of group k; a comparison of images has the mean number of its points as spread."""
        kind = CONSTRAINT_KINDS[self.groups[k].kind]
        if kind.spread is not None:
            return ConstraintUnit(kind.unit, kind.spread)
        return ConstraintUnit(kind.unit, float(np.mean([len(x) for x in self.groups[k].points])))

    def freedom(self, k: int) -> int:
        """Independent numbers in one measurement of group k."""
        return CONSTRAINT_KINDS[self.groups[k].kind].freedom

    def measurements(self, k: int) -> int:
        """Independent numbers measured by group k."""
        return self.freedom(k) * int(np.count_nonzero(self.groups[k].member_weights))

    def sensor_sigma(self, k: int, weight: float, image_sigma: float) -> float:
        """Standard deviation that a weight of group k amounts to, in its unit."""
        return image_sigma * math.sqrt(self.unit(k).spread / weight) if weight > 0 else math.inf

    def bounded(self, k: int, weight: float) -> float:
        """A weight of group k within reason, in three digits.

        A sensor is neither better than a millionth of the extent of the cameras, of a radian or of a pixel,
        nor worse than a million of them. The rounding, far below what data can tell, is where the last bits
        of sums that depend on the machine's linear algebra end.
        """
        extent = float(np.ptp(self.alone.problem.centres, axis=0).max()) if self.unit(k).name == "m" else 1.0
        middle = self.noise**2 * self.unit(k).spread / (extent or 1.0) ** 2
        return float(f"{min(max(weight, middle / _RANGE**2), middle * _RANGE**2):.2e}")

    def left_out_loss(self, squared: FloatArray) -> FloatArray:
        """Loss of predicted errors, given squared: Tukey's, whatever that of the fits.

        Of points seen at small angles some are lost without one of their observations, and would decide
        alone.
        """
        return tukey(squared, _LEFT_OUT_SIGMAS * self.noise)

    def image_sigma(self, fit: WeightFit, redundancy: float) -> float:
        """Standard deviation of the images in units of the declared one.

        Under a robust loss what counts is how far chance moves the fit: the mean square of the influences ψ
        over the mean of their slope (Huber's asymptotic variance, for the weight of a cost with that slope).

        Parameters
        ----------
        fit : WeightFit
            An optimum.
        redundancy : float
            Redundancy of its observations.

        Returns
        -------
        float
            The standard deviation, positive.
        """
        squared = _squared_residuals(fit.problem)
        influence = float((squared * rho_slope(self.options, squared) ** 2).sum()) / max(redundancy, 1.0)
        slope = max(float(influence_slope(self.options, squared).mean()), _LEAST_SLOPE)
        return max(math.sqrt(influence / slope), _LEAST_NOISE)

    def _changed(self, **values: float) -> SolveOptions:
        return SolveOptions.from_dict({**self.options.to_dict(), **values})

    def _result(self, state: Problem, squared: FloatArray) -> WeightFit:
        return WeightFit(
            problem=state,
            images=float(rho(self.options, squared).sum()),
            errors=np.array([squared_error(group, state) for group in self.groups]),
            inliers=int(np.count_nonzero(squared <= (INLIER_SIGMAS * self.noise) ** 2)),
        )


def _fit_options(options: SolveOptions) -> SolveOptions:
    kept = ("linear_solver", "loss", "loss_scale_px", "max_iterations", "max_seconds", "threads", "gauge")
    values = {name: getattr(options, name) for name in kept}
    tolerance = min(options.function_tolerance, _FIT_TOLERANCE)
    return SolveOptions(**values, function_tolerance=tolerance)


def _run(
    state: Problem, groups: Sequence[ConstraintGroup], weights: FloatArray, options: SolveOptions
) -> float:
    """Adjust in place; returns the scale of the loss."""
    weighted = [dataclasses.replace(g, weight=float(w)) for g, w in zip(groups, weights, strict=True)]
    summary = adjust(state, weighted, options)
    if summary.termination == "interrupted":
        raise KeyboardInterrupt
    return summary.loss_scale_px


def _squared_residuals(state: Problem) -> FloatArray:
    return np.asarray((np.asarray(_core.residuals(core_arrays(state))) ** 2).sum(axis=1))


def _noise(squared: FloatArray) -> float:
    """Standard deviation of residuals by their median."""
    return math.sqrt(float(np.median(squared)) / _MEDIAN_OF_TWO)


def _without_unmoved(group: ConstraintGroup, problem: Problem) -> ConstraintGroup:
    """Members on cameras that all are fixed or unseen have no say and must not count as wrong."""
    pairs = group.cameras if group.cameras.ndim == 2 else group.cameras[:, None]
    if not ((pairs >= 0) & (pairs < problem.num_cameras)).all():
        return group  # the core says which
    seen = np.bincount(problem.camera_index, minlength=problem.num_cameras) > 0
    poses_matter = CONSTRAINT_KINDS[group.kind].on_poses
    moved = (seen & ~(problem.fixed_cameras & poses_matter))[pairs].any(axis=1)
    return dataclasses.replace(group, member_weights=np.where(moved, group.member_weights, 0.0))
