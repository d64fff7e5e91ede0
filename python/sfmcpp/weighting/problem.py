"""Weights w of constraint groups, selected from the data of a whole adjustment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.ba.options import SolveOptions
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem, ResidualGroup
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.residual_group import Group
from sfmcpp.model.weight_selection import WeightSelection
from sfmcpp.weighting.conflict import agreeing_members, member_conflict
from sfmcpp.weighting.fits import WeightFit, WeightFits, total_weight
from sfmcpp.weighting.methods import ROUNDS, selection_method
from sfmcpp.weighting.statistics import FitStatistics
from sfmcpp.weighting.trials import Trials, sweep
from sfmcpp.weighting.units import sigma_of_weight
from sfmcpp.weighting.variance import VarianceSearch

# A group with less redundancy than this has none, but for rounding.
_LEAST_REDUNDANCY = 0.5
# Positions farther from the cameras than this many times the extent of both are in another frame.
_FARTHEST = 100.0
VARIANCE = "variance"
_SQUARED = "squared"
# Rounds in which the members that agree with the fit, and the weights by these, determine each other.
_ROUNDS_OF_MEMBERS = 8


def select_group_weights(
    problem: Problem,
    groups: Sequence[Group],
    weight: str | Mapping[str, str],
    options: SolveOptions,
) -> list[WeightSelection]:
    """Choose the weights of groups of constraints from a whole problem, and set them.

    All weights start where images and constraints balance. Groups of method "variance" are weighed together,
    others one after the other with the rest held, and twice round if there are several
    (:func:`sfmcpp.weighting.select_weights` does so for one pose). A weight is that of errors that count by
    their squares; of a group with a robust loss, of the members that are within 4.6 standard deviations.

    Parameters
    ----------
    problem : Problem
        The start; left untouched.
    groups : sequence of ConstraintGroup or ResidualGroup
        All groups; the attribute `weight` of those named is set to the choice, if
        nothing raises.
    weight : str or mapping
        A method for all groups, or the method of some by name; the others keep their weights.
    options : SolveOptions
        Those of the solve.

    Returns
    -------
    list of WeightSelection
        One for each group that was weighed, in their order.

    Raises
    ------
    InvalidArgument
        If there are no groups, a method or a group is unknown, a group leaves nothing to choose its weight
        by or lies in another frame, or a method cannot be used for this problem.
    KeyboardInterrupt
        On Ctrl-C; nothing is changed then.
    """
    methods = _methods(groups, weight)
    for k in methods:
        apart = frame_conflict(problem, groups[k])
        if apart is not None:
            raise InvalidArgument(apart)
    by_squares = [replace(g, loss=_SQUARED) if k in methods else g for k, g in enumerate(groups)]
    fits = WeightFits(problem, by_squares, options)
    robust = [k for k in methods if groups[k].loss != _SQUARED]
    chosen = _select_with_robust_groups(
        fits, methods, robust, np.array([float(group.weight) for group in groups])
    )
    for k, found in zip(methods, chosen, strict=True):
        groups[k].weight = found.weight
    return chosen


def _select_with_robust_groups(
    fits: WeightFits, methods: Mapping[int, str], robust: Sequence[int], weights: FloatArray
) -> list[WeightSelection]:
    """Weights by the squares of all members, and of robust groups of those that agree with the fit.

    These are first those that the median allows at the optimum of the images alone, then those that the
    chosen weight does, until they stay.
    """

    def agreeing(at: Problem, sigmas: Mapping[int, float]) -> dict[int, BoolArray]:
        return {k: agreeing_members(fits.groups[k], fits.units[k], at, sigmas.get(k)) for k in robust}

    members = agreeing(fits.alone.problem, {})
    for _ in range(_ROUNDS_OF_MEMBERS):
        selection = _Selection(fits.among(members), methods)
        found = dict(zip(methods, selection.run(weights), strict=True))
        before = members
        members = agreeing(selection.optimum, {k: found[k].sensor_sigma for k in robust})
        if all((members[k] == before[k]).all() for k in robust):
            break
    return list(found.values())


def frame_conflict(problem: Problem, group: Group) -> str | None:
    """Whether the positions of a group are in another frame than the cameras, and what to do about it.

    Parameters
    ----------
    problem : Problem
        The cameras.
    group : ConstraintGroup or ResidualGroup
        A group; only positions and poses can be anywhere.

    Returns
    -------
    str or None
        A message, if they are farther apart than a hundred times the extent of the positions and of all
        cameras.
    """
    if isinstance(group, ResidualGroup):
        return None
    if group.kind not in ("position", "pose") or group.values is None or group.num_members < 2:
        return None
    if not ((group.cameras >= 0) & (group.cameras < problem.num_cameras)).all():
        return None  # the core says which
    values = group.values if group.kind == "position" else group.values[..., 3]
    centres = problem.centres[group.cameras]
    if values.shape != centres.shape:
        return None  # the core says where
    with np.errstate(over="ignore"):
        distance = float(np.linalg.norm(values.mean(axis=0) - centres.mean(axis=0)))
        extent = max(float(np.ptp(x, axis=0).max()) for x in (values, problem.centres))
    if not extent or not distance > _FARTHEST * extent:  # nor where a value is no number: the core says which
        return None
    here = f"constraints[{group.name!r}]"
    measured = "values" if group.kind == "position" else "values[:, :, 3]"
    return (
        f"{here}: its positions are {distance:.3g} from the cameras, {distance / extent:.3g} "
        "times their extent: they must be in the frame of the cameras. Align first, by "
        "sfmcpp.sfm.georeference or by hand: "
        f"sfmcpp.geometry.fit_similarity(problem.centres[group.cameras], group.{measured}).move(problem)"
    )


def _methods(groups: Sequence[Group], weight: str | Mapping[str, str]) -> dict[int, str]:
    """Method of each group to weigh, by its number."""
    names = [group.name for group in groups]
    if not groups:
        raise InvalidArgument(f"weight = {weight!r}: there are no constraints to weigh")
    if not isinstance(weight, str | Mapping):
        raise InvalidArgument(f"weight = {weight!r}: must be a method, or methods by the names of groups")
    wanted = dict.fromkeys(names, weight) if isinstance(weight, str) else dict(weight)
    for name, method in wanted.items():
        if name not in names:
            raise InvalidArgument(f"weight[{name!r}]: no such group, must be one of {', '.join(names)}")
        if not isinstance(method, str):
            raise InvalidArgument(f"weight[{name!r}] = {method!r}: must be a method")
        selection_method(method, "problem", "weight")
    resolved = {name: VARIANCE if method == "auto" else method for name, method in wanted.items()}
    return {k: resolved[name] for k, name in enumerate(names) if name in resolved}


class _Selection:
    """The choice of the weights of all groups; `optimum` is the state at the chosen weights."""

    optimum: Problem

    def __init__(self, fits: WeightFits, methods: Mapping[int, str]) -> None:
        self._fits, self._methods = fits, methods
        self._together = [k for k, method in methods.items() if method == VARIANCE]
        self._alone = [k for k, method in methods.items() if method != VARIANCE]
        self._trials: dict[int, Trials] = {}

    def run(self, weights: FloatArray) -> list[WeightSelection]:
        weights, fit = self._balanced(weights)
        at = FitStatistics(self._fits, fit.problem, weights)
        self._require_redundancy(at)
        units = len(self._alone) + bool(self._together)
        for _ in range(ROUNDS if units > 1 else 1):
            if self._together:
                at = self._by_variance(at)
            for k in self._alone:
                at = self._by_sweep(at, k)
        self.optimum = at.step.problem
        return [self._selection_result(k, at) for k in self._methods]

    def _balanced(self, weights: FloatArray) -> tuple[FloatArray, WeightFit]:
        """Weights at which images and constraints balance, as if the fit used up no redundancy.

        Where sweeps begin they are fitted, twice: the images alone are free to drift away from the sensor.
        """
        found, fit = weights.copy(), self._fits.alone
        for _ in range(2 if self._alone else 1):
            for k in self._methods:
                found[k] = self._fits.balanced(k, fit)
            fit = self._fits.fit(found, fit.problem) if self._alone else fit
        return found, fit

    def _require_redundancy(self, at: FitStatistics) -> None:
        """Refuse a group without redundancy, which the fit follows at any weight."""
        for k in self._together if at.too_large else self._methods:
            left = at.redundancy.groups[k]
            if left < _LEAST_REDUNDANCY:
                raise InvalidArgument(
                    f"constraints[{self._fits.groups[k].name!r}]: the fit leaves {max(left, 0):.1f} of its "
                    f"{self._fits.measurements(k)} numbers on cameras that can move, nothing to choose a "
                    "weight by"
                )

    def _by_variance(self, at: FitStatistics) -> FitStatistics:
        search = VarianceSearch(self._fits, at, self._together)
        search.run()
        self._trials.update({k: search.trials(k) for k in self._together})
        return search.last

    def _by_sweep(self, at: FitStatistics, k: int) -> FitStatistics:
        method = selection_method(self._methods[k], "problem")
        found = self._trials[k] = sweep(self._fits, k, at.weights, at.fit, method)
        weights: FloatArray = at.weights.copy()
        weights[k] = found.weights[found.index]
        return FitStatistics(self._fits, found.fits[found.index].problem, weights)

    def _selection_result(self, k: int, at: FitStatistics) -> WeightSelection:
        fits, trials = self._fits, self._trials[k]
        group, unit, weight = fits.groups[k], fits.units[k], float(at.weights[k])
        return WeightSelection(
            name=group.name,
            method=self._methods[k],
            weight=weight,
            weights=trials.weights,
            vision=np.array([fit.images for fit in trials.fits]) / fits.alone.problem.num_observations,
            constraint_error=np.array([fit.errors[k] for fit in trials.fits])
            / total_weight(group.member_weights),
            score=trials.score,
            admissible=trials.admissible,
            sensor_sigma=sigma_of_weight(unit, weight, at.image_sigma),
            unit=unit.name,
            conflict=member_conflict(group.name, unit, at.linear.groups[k].member, at.errors[k], at.hats[k]),
            redundancy=self._redundancy(k, at),
        )

    def _redundancy(self, k: int, at: FitStatistics) -> float | None:
        """Not estimated where only a sweep would need it."""
        is_known = k in self._together or not at.too_large
        return float(at.redundancy.groups[k]) if is_known else None
