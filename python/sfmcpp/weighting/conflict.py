"""Conflict of a sensor with the images, in standard deviations, of a pose or of group members."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp import _core
from sfmcpp.ba.linearize import linearize
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, finite_array
from sfmcpp.model.residual_group import Group
from sfmcpp.model.weight_selection import ConflictReport
from sfmcpp.weighting.pose_inputs import PoseConstraint, PoseView
from sfmcpp.weighting.units import ConstraintUnit

CONFLICT_SIGMAS = 3.0
# Singular values below this share of the largest are directions that the constraint does not see.
_RANK_TOLERANCE = 1e-9
# Keeps the covariance of a pose finite where the images leave it open.
_RIDGE = 1e-14
# Members that the fit follows altogether tell nothing: their error is not blown up further than this.
_LEAST_FREE = 0.3
# Standard deviation of a standard deviation by the median of n squared normal numbers, times √n.
_MEDIAN_SPREAD = 1.17
# The smallest probability whose quantile the normal distribution still gives.
_LEAST_PROBABILITY = 1e-300
# Standard deviations, of a number, beyond which a member is an outlier: of normal ones fewer than one in
# 100,000 are.
OUTLIER_SIGMAS = 4.6
_Number = TypeVar("_Number", float, FloatArray)


@checked()
def conflict(view: PoseView, constraint: PoseConstraint, vision_pose: ArrayLike) -> ConflictReport:
    """Compare a sensor with the pose fitted to the images alone.

    The error of the constraint at that pose is weighed by the covariance it has from the images, whose points
    count as exact and whose noise is estimated from the fit, and by the variance of the sensor.

    Parameters
    ----------
    view : PoseView
        What the camera sees.
    constraint : PoseConstraint
        What the sensor says, with its declared standard deviation if it has one.
    vision_pose : (3, 4) float64
        Optimum of the images alone, world_from_camera.

    Returns
    -------
    ConflictReport
        The discrepancy, in the unit of the sensor and in standard deviations.

    Raises
    ------
    InvalidArgument
        If an argument has the wrong shape, a pose is no rotation, or there are fewer than 4 observations.
    """
    pose = finite_array("vision_pose", vision_pose, (3, 4))
    at = _core.linearize_pose(view.arrays(), [constraint.arrays(0.0)], pose)
    error = np.asarray(at["residuals"][0]).ravel()
    jacobian = np.asarray(at["jacobians"][0])
    vision = view.pixel_sigma(at["vision"]) ** 2 * _inverse_normal(np.asarray(at["vision_normal"]))
    sensor = math.hypot(constraint.sensor_sigma or 0.0, constraint.slack) ** 2 / constraint.unit.spread
    seen, covariance = _pose_directions(jacobian, vision)
    freedom = seen.shape[1]
    squared = _mahalanobis_squared(seen.T @ error, covariance + sensor * np.eye(freedom))
    from_images = float(np.trace(covariance)) * constraint.unit.spread / max(freedom, 1)
    sigmas = equivalent_sigmas(squared, freedom)
    return ConflictReport(
        name=constraint.name,
        discrepancy=float(np.sqrt(constraint.unit.spread) * np.linalg.norm(error)),
        unit=constraint.unit.name,
        squared_mahalanobis=squared,
        degrees_of_freedom=freedom,
        sigmas=sigmas,
        conflicting=sigmas > CONFLICT_SIGMAS,
        sensor_sigma=constraint.sensor_sigma,
        images_sigma=math.sqrt(from_images),
        observations=view.count,
    )


def member_conflict(
    name: str, unit: ConstraintUnit, member: IndexArray, errors: FloatArray, hat: FloatArray
) -> ConflictReport:
    """Judge a group by the errors that the fit leaves its members.

    The measure is the median member, which a few wrong ones do not move. A member draws the fit to itself:
    its squared error is blown up by what its leverage took. Errors have the covariance ``I − K``, which tells
    how large their mean, entry by entry, may be by chance, and how alike those of neighbours.

    Parameters
    ----------
    name : str
        What the group is called.
    unit : ConstraintUnit
        Unit of its sensor.
    member : (R,) int32
        The member each error belongs to, ascending.
    errors : (R,) float64
        The errors.
    hat : (R, R) float64
        Hat matrix K of the group; zero where the problem is too large to tell.

    Returns
    -------
    ConflictReport
        Of the worst member, with what mean and neighbours say.
    """
    members, places, counts = np.unique(member, return_inverse=True, return_counts=True)
    free = 1 - np.bincount(places, np.diag(hat)) / unit.freedom
    measured = np.bincount(places, errors**2)
    squared = measured / np.maximum(free, _LEAST_FREE)
    worst = int(np.argmax(squared))
    variance = float(np.median(squared)) / chi_square_median(unit.freedom)
    discrepancy = math.sqrt(unit.spread * measured[worst])
    if variance <= np.finfo(float).tiny:
        return ConflictReport(
            name, discrepancy, unit.name, 0.0, unit.freedom, 0.0, False, member=int(members[worst])
        )
    distance = float(squared[worst]) / variance
    sigmas = equivalent_sigmas(distance, unit.freedom)
    entry = np.arange(len(places)) - np.repeat(np.cumsum(counts) - counts, counts)
    entries = [np.flatnonzero(entry == e) for e in range(int(counts.max()))]
    bias = max(_mean_sigmas(errors, hat, variance, of_entry) for of_entry in entries)
    alike = _neighbour_sigmas(errors, hat, variance, entries)
    count = len(members)
    limits = [_sigma_limit(of, count) for of in (count, len(entries), 1)]
    return ConflictReport(
        name=name,
        discrepancy=discrepancy,
        unit=unit.name,
        squared_mahalanobis=distance,
        degrees_of_freedom=unit.freedom,
        sigmas=sigmas,
        conflicting=any(x > limit for x, limit in zip((sigmas, bias, alike), limits, strict=True)),
        member=int(members[worst]),
        bias_sigmas=bias,
        alike_sigmas=alike,
    )


def chi_square_median(degrees_of_freedom: _Number) -> _Number:
    """Median of the chi-square distribution, after Wilson and Hilferty; of an array, of each entry."""
    return degrees_of_freedom * (1 - 2 / (9 * degrees_of_freedom)) ** 3


def equivalent_sigmas(squared_mahalanobis: float, degrees_of_freedom: int) -> float:
    """How many standard deviations of one normal number are as unlikely as a squared Mahalanobis distance.

    Parameters
    ----------
    squared_mahalanobis : float
        A number from the chi-square distribution, if only chance is at work.
    degrees_of_freedom : int
        Of that distribution; 0: undetermined.

    Returns
    -------
    float
        Standard deviations, not negative.
    """
    from scipy.special import chdtrc, ndtri

    if degrees_of_freedom == 0:
        return 0.0
    probability = float(chdtrc(degrees_of_freedom, squared_mahalanobis))
    if probability < _LEAST_PROBABILITY:
        return math.sqrt(squared_mahalanobis)
    return abs(float(ndtri(probability / 2)))


def _inverse_normal(normal: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(normal) + np.finfo(float).tiny)
    unit = normal / np.outer(scale, scale) + _RIDGE * np.eye(len(normal))
    return np.asarray(np.linalg.inv(unit) / np.outer(scale, scale))


def _pose_directions(jacobian: FloatArray, pose_covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (R, k) in which the pose moves the error, of rotation matrices three out of nine.

    With the covariance (k, k) that the error has along them.
    """
    spread = np.sqrt(np.diag(pose_covariance))
    directions, sizes, _ = np.linalg.svd(jacobian * spread, full_matrices=False)
    seen = directions[:, sizes > _RANK_TOLERANCE * sizes.max(initial=0.0)]
    return seen, np.asarray(seen.T @ jacobian @ pose_covariance @ jacobian.T @ seen)


def _mahalanobis_squared(apart: FloatArray, covariance: FloatArray) -> float:
    return float(apart @ np.linalg.solve(covariance, apart)) if len(apart) else 0.0


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


def _sigma_limit(count: int, members: int) -> float:
    """Standard deviations that the largest of as many numbers exceeds as rarely as one the usual limit.

    Raised by what the median of the members leaves open of their measure.
    """
    rare = -NormalDist().inv_cdf(NormalDist().cdf(-CONFLICT_SIGMAS) / count)
    return rare * (1 + _MEDIAN_SPREAD / math.sqrt(members))


def agreeing_members(group: Group, unit: ConstraintUnit, problem: Problem, sigma: float | None) -> BoolArray:
    """Find the members that chance explains.

    Parameters
    ----------
    group : ConstraintGroup or ResidualGroup
        All members; of those without weight none is judged, and all agree.
    unit : ConstraintUnit
        Unit, spread and freedom of its kind.
    problem : Problem
        The state they are judged at.
    sigma : float or None
        Standard deviation of a number of a member of weight one, in the unit. None: that of which the median
        member is typical.

    Returns
    -------
    (n,) bool
        Which members are within `OUTLIER_SIGMAS` of the state.
    """
    (rows,) = linearize(problem, constraints=[group]).groups
    squared = np.bincount(rows.member, rows.errors**2, minlength=group.num_members) * unit.spread
    if sigma is None:
        judged = np.unique(rows.member)
        variance = float(np.median(squared[judged])) / chi_square_median(unit.freedom)
    else:
        variance = sigma**2
    return np.asarray(squared <= OUTLIER_SIGMAS**2 * unit.freedom * variance)
