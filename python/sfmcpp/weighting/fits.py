"""Fits of a whole problem at different weights of its constraints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.adjust import adjust
from sfmcpp.ba.arrays import core_arrays, core_constraints
from sfmcpp.ba.linearize import LinearModel
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.summary import Summary
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.model import CONSTRAINT_KINDS, Problem, ResidualGroup
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.residual_group import Group
from sfmcpp.weighting.units import unit_of_group

# Steps of a fit that starts at the optimum of a neighbouring weight; with hardly any damping, because damping
# slows down the weakly determined directions, which are those that a sensor determines.
_FIT_STEPS = 30
_WARM_DAMPING = 1e-9
# More damping where observations are left out: a point may then be hardly determined.
_SUBSET_DAMPING = 1e-5
_FIT_TOLERANCE = 1e-10
# Of fits whose last part is left to the linear model.
_BRIEF_STEPS = 12
_BRIEF_TOLERANCE = 1e-5
# Of the fit of the images alone, which only gives their noise and the start of other fits.
_ALONE_TOLERANCE = 1e-4
# Inliers are within this many standard deviations of the images alone.
INLIER_SIGMAS = 2.0
# Scale of Tukey's loss of predicted errors, that of 95 % efficiency: beyond it the loss is constant.
_LEFT_OUT_SIGMAS = 4.6851
# Median of the squared length of a vector of two standard normal numbers.
_MEDIAN_OF_TWO = 2 * math.log(2)
# Lower bound of the noise of the images, as a share of the declared one.
LEAST_NOISE = 1e-6
# Bounds of the σ of a sensor: the extent of what it measures, divided and multiplied by this.
_RANGE = 1e6
# Share of the diagonal that is added to the normal equations, for cameras that are not determined.
_RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
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
    groups : sequence of ConstraintGroup or ResidualGroup
        All groups; left untouched.
    options : SolveOptions
        Those of the solve; its loss, linear solver, threads and gauge hold for each fit, its time limit for
        all together.

    Attributes
    ----------
    groups : list of ConstraintGroup or ResidualGroup
        The groups; members whose cameras and points are all fixed or unobserved have weight zero.
    units : list of ConstraintUnit
        Unit, spread and freedom of each.
    noise : float
        Standard deviation of the images alone by their median residual, in units of the declared one.
    alone : WeightFit
        The optimum of the images alone.

    Raises
    ------
    InvalidArgument
        If the problem, a group or an option breaks a rule.
    """

    def __init__(self, problem: Problem, groups: Sequence[Group], options: SolveOptions) -> None:
        self.groups = [_without_fixed_members(group, problem) for group in groups]
        self.units = [unit_of_group(group, problem) for group in groups]
        kept = ("linear_solver", "loss", "loss_scale_px", "max_iterations", "max_seconds", "threads", "gauge")
        self.options = SolveOptions(**{name: getattr(options, name) for name in kept})
        self._limit = TimeLimit(options.max_seconds)
        tolerance = max(options.function_tolerance, _ALONE_TOLERANCE)
        self.options = self._options_with(function_tolerance=tolerance)
        state = problem.copy()
        summary = self._adjust(state, np.zeros(len(groups)), self.options)
        self.options = self._options_with(
            loss_scale_px=summary.loss_scale_px,
            max_iterations=_FIT_STEPS,
            initial_damping=_WARM_DAMPING,
            function_tolerance=min(options.function_tolerance, _FIT_TOLERANCE),
        )
        squared = squared_residuals(state)
        self.noise = max(math.sqrt(float(np.median(squared)) / _MEDIAN_OF_TWO), LEAST_NOISE)
        self.alone = self._result(state, summary)

    def among(self, members: Mapping[int, BoolArray]) -> WeightFits:
        """The same fits with only the given members (n,) of some groups, by number of the group."""
        other = copy(self)
        other.groups = [
            _group_of_members(g, members[k]) if k in members else g for k, g in enumerate(self.groups)
        ]
        other.alone = replace(self.alone, errors=other.squared_errors(self.alone.problem))
        return other

    def fit(self, weights: FloatArray, start: Problem, brief: bool = False) -> WeightFit:
        """Fit at the given weights (k,), from a start that is left untouched; `brief`: less exactly."""
        state, options = start.copy(), self.options
        if brief:
            options = self._options_with(max_iterations=_BRIEF_STEPS, function_tolerance=_BRIEF_TOLERANCE)
        return self._result(state, self._adjust(state, weights, options))

    def loss_terms(self, squared: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """ρ, ρ′ and the slope of the influence ``d(s ρ′)/ds`` of squared residuals s (M,)."""
        return _core.loss_terms(self.options.loss, float(self.options.loss_scale_px), squared)

    def fit_subset(self, weights: FloatArray, start: Problem, keep: BoolArray, steps: int) -> Problem:
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
        subset = start.with_observations(keep)
        self._adjust(
            subset, weights, self._options_with(max_iterations=steps, initial_damping=_SUBSET_DAMPING)
        )
        moved = {name: getattr(subset, name) for name in ("cameras", "intrinsics", "points", "rigs")}
        return replace(start, **moved)

    def linearize(self, problem: Problem, weights: FloatArray) -> LinearModel:
        """The linear model at a state and weights (k,)."""
        return LinearModel(problem, self._weighted(weights), self.options, _RIDGE)

    def measurements(self, k: int) -> int:
        """Number of independent measurements of group k."""
        weights = self.groups[k].member_weights
        return (self.units[k].freedom if weights.ndim == 1 else 1) * int(np.count_nonzero(weights))

    def bounded(self, k: int, weight: float) -> float:
        """A weight of group k within bounds, rounded to three digits.

        The bounds are those of a σ between a millionth of the extent of the cameras (of a radian, of a pixel)
        and a million times that. The rounding, far below the accuracy of a weight, removes the last bits of
        sums, which depend on the machine's linear algebra.
        """
        unit = self.units[k]
        extent = float(np.ptp(self.alone.problem.centres, axis=0).max()) if unit.name == "m" else 1.0
        middle = self.noise**2 * unit.spread / (extent or 1.0) ** 2
        return float(f"{min(max(weight, middle / _RANGE**2), middle * _RANGE**2):.2e}")

    def balanced(self, k: int, fit: WeightFit) -> float:
        """The weight of group k at which a measurement costs on average as much as one of the images."""
        error = max(fit.errors[k], np.finfo(float).tiny)
        return self.bounded(k, self.noise**2 * self.measurements(k) / error)

    def left_out_loss(self, squared: FloatArray) -> FloatArray:
        """Tukey's loss of predicted errors, given squared; independent of the loss of the fits.

        It bounds the errors of points seen at small angles, which may be arbitrarily large without one of
        their observations, and would otherwise determine the mean.
        """
        return np.asarray(_core.loss_terms("tukey", _LEFT_OUT_SIGMAS * self.noise, squared)[0])

    def inliers(self, squared: FloatArray) -> int:
        """Squared residuals within `INLIER_SIGMAS` of the noise of the images alone."""
        return int(np.count_nonzero(squared <= (INLIER_SIGMAS * self.noise) ** 2))

    def _options_with(self, **values: float) -> SolveOptions:
        return SolveOptions.from_dict({**self.options.to_dict(), **values})

    def _weighted(self, weights: FloatArray) -> list[Group]:
        return [replace(g, weight=float(w)) for g, w in zip(self.groups, weights, strict=True)]

    def _adjust(self, state: Problem, weights: FloatArray, options: SolveOptions) -> Summary:
        limited = SolveOptions.from_dict(self._limit.of(options.to_dict()))
        return adjust(state, self._weighted(weights), limited).require_uninterrupted()

    def _result(self, state: Problem, summary: Summary) -> WeightFit:
        constraints = sum(final for _, final in summary.constraint_costs.values())
        images = 2 * (summary.final_cost - constraints)
        return WeightFit(state, images, self.squared_errors(state), self.inliers(squared_residuals(state)))

    def squared_errors(self, problem: Problem) -> FloatArray:
        """(k,) Σ m ε of each group at a state."""
        ones = np.ones(len(self.groups))
        arrays = {**core_arrays(problem), "constraints": core_constraints(self._weighted(ones), problem)}
        return 2 * np.array(_core.constraint_costs(arrays))


def squared_residuals(problem: Problem) -> FloatArray:
    """(M,) squared residuals of the observations."""
    return np.asarray((np.asarray(_core.residuals(core_arrays(problem))) ** 2).sum(axis=1))


def _without_fixed_members(group: Group, problem: Problem) -> Group:
    """Group without the weights of members whose cameras and points are all fixed or unobserved."""
    moved = np.zeros(group.num_members, dtype=np.bool_)
    if group.cameras is not None:
        poses_matter = isinstance(group, ResidualGroup) or CONSTRAINT_KINDS[group.kind].on_poses
        held = _is_held(problem) & poses_matter
        moved |= _has_free_entity(group.cameras, _with_observed_frames(problem), held)
    if isinstance(group, ResidualGroup) and group.points is not None:
        moved |= _has_free_entity(group.points, problem.point_index, problem.fixed_points)
    return _group_of_members(group, moved)


def _is_held(problem: Problem) -> BoolArray:
    """(C,) whether cameras are fixed; with a free sensor the frame is, and they move in it."""
    rigs = problem.rigs
    if rigs is None:
        return problem.fixed_cameras
    return np.asarray(problem.fixed_cameras & ~rigs.free_sensors[rigs.sensor_of_camera])


def _with_observed_frames(problem: Problem) -> IndexArray:
    """Cameras that observe something, and those of a rig that move with one; some are there several times."""
    if problem.rigs is None:
        return problem.camera_index
    frames = problem.rigs.frame_of_camera
    return np.flatnonzero(np.isin(frames, frames[problem.camera_index])).astype(np.int32)


def _has_free_entity(members: IndexArray, seen: IndexArray, held: BoolArray) -> BoolArray:
    """(n,) whether one at least of each member (n,) or (n, p) is observed and not held."""
    listed = members if members.ndim == 2 else members[:, None]
    if not ((listed >= 0) & (listed < len(held))).all():
        return np.ones(len(members), dtype=np.bool_)  # the core refuses it and names the member
    observed = np.bincount(seen, minlength=len(held)) > 0
    return np.asarray((observed & ~held)[listed].any(axis=1))


def _group_of_members(group: Group, members: BoolArray) -> Group:
    """A group whose other members have no weight."""
    member_weights = group.member_weights.copy()
    member_weights[~members] = 0.0
    return replace(group, member_weights=member_weights)


def total_weight(member_weights: FloatArray) -> float:
    """Sum of the weights (n,) of members, those (n, d) of single numbers counting by their mean."""
    return float(member_weights.sum() / np.prod(member_weights.shape[1:]))
