"""Whether the sensor of a group agrees with the images: its members at the weights chosen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.weight_selection import GroupWeightSelection
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS, equivalent_sigmas
from sfmcpp.weighting.whole.columns import camera_columns
from sfmcpp.weighting.whole.constraint_rows import ConstraintRows, constraint_rows
from sfmcpp.weighting.whole.fits import WeightFit, WeightFits
from sfmcpp.weighting.whole.methods import Trials
from sfmcpp.weighting.whole.reduced_system import MAX_COLUMNS
from sfmcpp.weighting.whole.statistics import fit_statistics

# Members that the fit follows altogether tell nothing: their error is not blown up further than this.
_LEAST_FREE = 0.3
# Standard deviation of a standard deviation by the median of n squared normal numbers, times √n.
_MEDIAN_SPREAD = 1.17


@dataclass(frozen=True)
class MemberErrors:
    """What the members of all groups say at the weights chosen.

    Attributes
    ----------
    rows : list of ConstraintRows
        The errors of each group.
    hats : list of (R, R) float64
        Hat matrices: which share of the errors the fit took away; zero if the problem is too large.
    redundancy : (k,) float64 or None
        Redundancy of each group; None: too large to tell.
    image_sigma : float
        Standard deviation of the images in units of the declared one.
    """

    rows: Sequence[ConstraintRows]
    hats: Sequence[FloatArray]
    redundancy: FloatArray | None
    image_sigma: float


@dataclass(frozen=True)
class Agreement:
    """Whether chance explains the errors of a group.

    Attributes
    ----------
    worst_member : int
        The member with the largest error.
    worst_sigmas : float
        As many standard deviations of one normal number are as unlikely.
    bias_sigmas : float
        Standard deviations by which the mean error differs from zero, in the entry where it does most.
    alike_sigmas : float
        Standard deviations by which errors of neighbouring members are more alike than chance has it.
    agrees : bool
        Whether none is beyond chance.
    """

    worst_member: int
    worst_sigmas: float
    bias_sigmas: float
    alike_sigmas: float
    agrees: bool


def member_errors(fits: WeightFits, fit: WeightFit, weights: FloatArray) -> MemberErrors:
    """Linearise the groups at the weights chosen.

    Parameters
    ----------
    fits : WeightFits
        Problem and groups.
    fit : WeightFit
        The optimum.
    weights : (k,) float64
        Its weights.

    Returns
    -------
    MemberErrors
        Errors and leverages.
    """
    columns = camera_columns(fit.problem)
    if columns.count <= MAX_COLUMNS:
        at = fit_statistics(fits, fit, weights)
        rows = [at.rows(k) for k in range(len(weights))]
        return MemberErrors(rows, at.hats, at.redundancy.groups, at.image_sigma)
    rows = [constraint_rows(group, fit.problem, None) for group in fits.groups]
    free = 2 * fit.problem.num_observations - columns.count - 3 * fit.problem.num_points
    nothing = [np.broadcast_to(0.0, (len(r.errors), len(r.errors))) for r in rows]
    return MemberErrors(rows, nothing, None, fits.image_sigma(fit, free))


def selection_of(
    fits: WeightFits, k: int, weight: float, trials: Trials, method: str, at: MemberErrors
) -> GroupWeightSelection:
    """Put the choice for one group together with what its members say.

    Parameters
    ----------
    fits : WeightFits
        Problem and groups.
    k : int
        Number of the group.
    weight : float
        Its weight in the end.
    trials : Trials
        The weights tried for it.
    method : str
        How it was chosen.
    at : MemberErrors
        Errors at the weights chosen for all groups.

    Returns
    -------
    GroupWeightSelection
        All of it.
    """
    group = fits.groups[k]
    verdict = agreement(at.rows[k], at.hats[k], fits.freedom(k))
    return GroupWeightSelection(
        name=group.name,
        method=method,
        weight=weight,
        weights=trials.weights,
        vision=np.array([fit.images for fit in trials.fits]) / fits.alone.problem.num_observations,
        constraint_error=np.array([fit.errors[k] for fit in trials.fits]) / group.member_weights.sum(),
        score=trials.score,
        admissible=trials.admissible,
        sensor_sigma=fits.sensor_sigma(k, weight, at.image_sigma),
        unit=fits.unit(k).name,
        redundancy=None if at.redundancy is None else float(at.redundancy[k]),
        worst_member=verdict.worst_member,
        worst_sigmas=verdict.worst_sigmas,
        bias_sigmas=verdict.bias_sigmas,
        alike_sigmas=verdict.alike_sigmas,
        agrees=verdict.agrees,
    )


def agreement(rows: ConstraintRows, hat: FloatArray, freedom: int) -> Agreement:
    """Judge a group by its errors.

    The measure is the median member, which a few wrong ones do not move. A member draws the fit to itself:
    its squared error is blown up by what its leverage took. Errors have the covariance ``I − K``, which tells
    how large their mean, entry by entry, may be by chance, and how alike those of neighbours.

    Parameters
    ----------
    rows : ConstraintRows
        The errors.
    hat : (R, R) float64
        Hat matrix K of the group.
    freedom : int
        Independent numbers in one measurement.

    Returns
    -------
    Agreement
        The verdict.
    """
    members, places, counts = np.unique(rows.member, return_inverse=True, return_counts=True)
    free = 1 - np.bincount(places, np.diag(hat)) / freedom
    squared = np.bincount(places, rows.errors**2) / np.maximum(free, _LEAST_FREE)
    worst = int(np.argmax(squared))
    median = freedom * (1 - 2 / (9 * freedom)) ** 3  # Wilson and Hilferty's, of a chi-square number
    variance = float(np.median(squared)) / median
    if variance <= np.finfo(float).tiny:
        return Agreement(int(members[worst]), 0.0, 0.0, 0.0, True)
    sigmas = equivalent_sigmas(float(squared[worst]) / variance, freedom)
    entry = np.arange(len(places)) - np.repeat(np.cumsum(counts) - counts, counts)
    entries = [np.flatnonzero(entry == e) for e in range(int(counts.max()))]
    bias = max(_mean_sigmas(rows.errors, hat, variance, of_entry) for of_entry in entries)
    alike = _neighbour_sigmas(rows.errors, hat, variance, entries)
    count = len(members)
    agrees = (
        sigmas <= _limit(count, count) and bias <= _limit(len(entries), count) and alike <= _limit(1, count)
    )
    return Agreement(int(members[worst]), sigmas, bias, alike, agrees)


def _neighbour_sigmas(
    errors: FloatArray, hat: FloatArray, variance: float, entries: Sequence[NDArray[np.intp]]
) -> float:
    """Standard deviations by which products of neighbouring errors exceed what chance makes of them.

    A sensor that is wrong for a while bends the fit towards itself, and leaves errors that are not large but
    alike.
    """
    products = expected = spread = 0.0
    free = 1 - np.diag(hat)
    for entry in entries:
        before, here = entry[:-1], entry[1:]
        products += float(errors[before] @ errors[here])
        expected -= variance * float(hat[before, here].sum())
        spread += float(free[before] @ free[here])
    return (products - expected) / (variance * math.sqrt(max(spread, _LEAST_FREE)))


def _mean_sigmas(errors: FloatArray, hat: FloatArray, variance: float, entry: NDArray[np.intp]) -> float:
    """Standard deviations by which the mean of some errors differs from zero."""
    among = hat[np.ix_(entry, entry)]
    free = max(len(among) - float(among.sum()), _LEAST_FREE)
    return float(abs(errors[entry].sum()) / np.sqrt(variance * free))


def _limit(count: int, members: int) -> float:
    """Standard deviations that the largest of as many numbers exceeds as rarely as one the usual limit.

    Raised by what the median of the members leaves open of their measure.
    """
    rare = -NormalDist().inv_cdf(NormalDist().cdf(-CONFLICT_SIGMAS) / count)
    return rare * (1 + _MEDIAN_SPREAD / math.sqrt(members))
