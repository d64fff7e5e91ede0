"""Weights of constraints for a whole adjustment, chosen from its data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sfmcpp.ba.options import SolveOptions
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.weight_selection import GroupWeightSelection
from sfmcpp.weighting.whole.columns import camera_columns
from sfmcpp.weighting.whole.fits import WeightFit, WeightFits
from sfmcpp.weighting.whole.member_errors import member_errors, selection_of
from sfmcpp.weighting.whole.methods import SWEEPS, Trials, balanced, sweep
from sfmcpp.weighting.whole.reduced_system import MAX_COLUMNS
from sfmcpp.weighting.whole.statistics import fit_statistics
from sfmcpp.weighting.whole.variance_components import variance_components

# Fewer numbers than this, left by the fit, are none.
_LEAST_REDUNDANCY = 0.5

# Rounds over several units: each is weighed with the others in place, then once more.
_ROUNDS = 2

AUTO = "auto"
VARIANCE = "variance"
WEIGHT_METHODS: tuple[str, ...] = (AUTO, VARIANCE, *SWEEPS)


def select_group_weights(
    problem: Problem,
    groups: Sequence[ConstraintGroup],
    weight: str | Mapping[str, str],
    options: SolveOptions,
) -> list[GroupWeightSelection]:
    """Choose the weights of groups of constraints from a whole problem, and set them.

    All weights start where images and constraints balance. Groups of method "variance" are weighed together,
    others one after the other with the rest held, and twice round if there are several
    (:func:`sfmcpp.weighting.select_weights` does so for one pose).

    Parameters
    ----------
    problem : Problem
        The start; left untouched.
    groups : sequence of ConstraintGroup
        All groups; the attribute `weight` of those named is set to the choice, if nothing raises.
    weight : str or mapping
        A method for all groups, or the method of some by name; the others keep their weights.
    options : SolveOptions
        Those of the solve.

    Returns
    -------
    list of GroupWeightSelection
        One for each group that was weighed, in their order.

    Raises
    ------
    InvalidArgument
        If there are no groups, a method or a group is unknown, a group leaves nothing to choose its weight
        by, or a method cannot be used for this problem.
    KeyboardInterrupt
        On Ctrl-C; nothing is changed then.
    """
    methods = _methods(groups, weight)
    fits = WeightFits(problem, groups, options)
    weights = np.array([float(group.weight) for group in groups])
    weights, fit = balanced(fits, weights, list(methods))
    _require_redundancy(fits, fit, weights, methods)
    trials: dict[int, Trials] = {}
    units = _units(methods)
    for _ in range(_ROUNDS if len(units) > 1 else 1):
        for unit in units:
            found = _choose(fits, weights, fit, methods[unit[0]], unit)
            trials.update(zip(unit, found, strict=True))
            weights = weights.copy()
            weights[unit] = [t.weights[t.index] for t in found]
            fit = found[-1].fits[found[-1].index]
    at = member_errors(fits, fit, weights)
    for k in methods:
        groups[k].weight = float(weights[k])
    return [selection_of(fits, k, float(weights[k]), trials[k], m, at) for k, m in methods.items()]


def _methods(groups: Sequence[ConstraintGroup], weight: str | Mapping[str, str]) -> dict[int, str]:
    """Method of each group to weigh, by its number."""
    names = [group.name for group in groups]
    if not groups:
        raise InvalidArgument(f"weight = {weight!r}: there are no constraints to weigh")
    wanted = dict.fromkeys(names, weight) if isinstance(weight, str) else dict(weight)
    for name, method in wanted.items():
        if name not in names:
            raise InvalidArgument(f"weight[{name!r}]: no such group, must be one of {', '.join(names)}")
        if method not in WEIGHT_METHODS:
            raise InvalidArgument(f"weight = {method!r}: must be one of {', '.join(WEIGHT_METHODS)}")
    resolved = {name: VARIANCE if method == AUTO else method for name, method in wanted.items()}
    return {k: resolved[name] for k, name in enumerate(names) if name in resolved}


def _require_redundancy(
    fits: WeightFits, fit: WeightFit, weights: FloatArray, methods: Iterable[int]
) -> None:
    """A group that the fit can follow in all it says, at whatever weight, leaves nothing to choose by."""
    if camera_columns(fit.problem).count > MAX_COLUMNS:
        return
    redundancy = fit_statistics(fits, fit, weights).redundancy.groups
    for k in methods:
        if redundancy[k] < _LEAST_REDUNDANCY:
            raise InvalidArgument(
                f"constraints[{fits.groups[k].name!r}]: the fit leaves {max(redundancy[k], 0):.1f} of its "
                f"{fits.measurements(k)} numbers on cameras that can move, nothing to choose a weight by"
            )


def _units(methods: Mapping[int, str]) -> list[list[int]]:
    """Groups that are weighed together."""
    together = [k for k, method in methods.items() if method == VARIANCE]
    return ([together] if together else []) + [[k] for k, method in methods.items() if method != VARIANCE]


def _choose(
    fits: WeightFits, weights: FloatArray, fit: WeightFit, method: str, unit: list[int]
) -> list[Trials]:
    if method == VARIANCE:
        return variance_components(fits, weights, fit, unit)
    return [sweep(fits, unit[0], weights, fit, SWEEPS[method])]
