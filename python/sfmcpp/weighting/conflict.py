"""Whether a sensor agrees with what the images say, and by how many standard deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.weighting.pose_constraint import PoseConstraint
from sfmcpp.weighting.pose_view import PoseView

CONFLICT_SIGMAS = 3.0
# Singular values below this share of the largest are directions that the constraint does not see.
_RANK_TOLERANCE = 1e-9
# Keeps the covariance of a pose finite where the images leave it open.
_RIDGE = 1e-14
# The smallest probability whose quantile the normal distribution still gives.
_LEAST_PROBABILITY = 1e-300


@dataclass(frozen=True)
class ConflictReport:
    """How far a sensor is from the pose that the images alone say.

    Attributes
    ----------
    name : str
        What the constraint is called.
    discrepancy : float
        Length of the error, in `unit`.
    unit : str
        Unit of the sensor.
    squared_mahalanobis : float
        Squared length of the error under the covariance of the images and of the sensor.
    degrees_of_freedom : int
        Directions in which the pose moves the error.
    sigmas : float
        As many standard deviations of one normal number are as unlikely.
    sensor_sigma : float or None
        Declared standard deviation of the sensor; None: it was taken as exact.
    """

    name: str
    discrepancy: float
    unit: str
    squared_mahalanobis: float
    degrees_of_freedom: int
    sigmas: float
    sensor_sigma: float | None

    @property
    def conflicting(self) -> bool:
        """Whether chance does not explain the discrepancy: more than `CONFLICT_SIGMAS`."""
        return self.sigmas > CONFLICT_SIGMAS

    def describe(self) -> str:
        """The report in one sentence."""
        if self.degrees_of_freedom == 0:
            return f"{self.name}: the pose does not move its error, so the images say nothing of it"
        given = "taken as exact" if self.sensor_sigma is None else f"σ = {self.sensor_sigma:.3g} {self.unit}"
        verdict = "disagrees with" if self.conflicting else "agrees with"
        return (
            f"{self.name} ({given}) {verdict} the images: {self.discrepancy:.3g} {self.unit} apart, "
            f"{self.sigmas:.1f} σ"
        )


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
    vision = view.pixel_sigma(at["vision"]) ** 2 * _inverse(np.asarray(at["vision_normal"]))
    sensor = (constraint.sensor_sigma or 0.0) ** 2 / constraint.spread
    squared, freedom = _squared_mahalanobis(error, jacobian, vision, sensor)
    return ConflictReport(
        name=constraint.name,
        discrepancy=float(np.sqrt(constraint.spread) * np.linalg.norm(error)),
        unit=constraint.unit,
        squared_mahalanobis=squared,
        degrees_of_freedom=freedom,
        sigmas=equivalent_sigmas(squared, freedom),
        sensor_sigma=constraint.sensor_sigma,
    )


def equivalent_sigmas(squared_mahalanobis: float, degrees_of_freedom: int) -> float:
    """How many standard deviations of one normal number are as unlikely as a squared Mahalanobis distance.

    Parameters
    ----------
    squared_mahalanobis : float
        A number from the chi-square distribution, if only chance is at work.
    degrees_of_freedom : int
        Of that distribution; 0: nothing can be told.

    Returns
    -------
    float
        Standard deviations, not negative.
    """
    if degrees_of_freedom == 0:
        return 0.0
    probability = chi_square_survival(squared_mahalanobis, degrees_of_freedom)
    if probability < _LEAST_PROBABILITY:
        return math.sqrt(squared_mahalanobis)
    return abs(NormalDist().inv_cdf(probability / 2))


def chi_square_survival(x: float, degrees_of_freedom: int) -> float:
    """Probability that a chi-square number exceeds `x`, by recursion from one or two degrees of freedom.

    Parameters
    ----------
    x : float
        The number, not negative.
    degrees_of_freedom : int
        At least 1.

    Returns
    -------
    float
        The probability.
    """
    odd = degrees_of_freedom % 2 == 1
    survival = math.erfc(math.sqrt(x / 2)) if odd else math.exp(-x / 2)
    for k in range(1 if odd else 2, degrees_of_freedom, 2):
        survival += (x / 2) ** (k / 2) * math.exp(-x / 2) / math.gamma(k / 2 + 1)
    return survival


def _inverse(normal: FloatArray) -> FloatArray:
    scale = np.sqrt(np.diag(normal) + np.finfo(float).tiny)
    unit = normal / np.outer(scale, scale) + _RIDGE * np.eye(len(normal))
    return np.asarray(np.linalg.inv(unit) / np.outer(scale, scale))


def _squared_mahalanobis(
    error: FloatArray, jacobian: FloatArray, pose_covariance: FloatArray, sensor_variance: float
) -> tuple[float, int]:
    """Within the directions in which the pose moves the error: of rotation matrices three out of nine."""
    spread = np.sqrt(np.diag(pose_covariance))
    directions, sizes, _ = np.linalg.svd(jacobian * spread, full_matrices=False)
    seen = directions[:, sizes > _RANK_TOLERANCE * sizes.max(initial=0.0)]
    if seen.shape[1] == 0:
        return 0.0, 0
    covariance = seen.T @ jacobian @ pose_covariance @ jacobian.T @ seen
    covariance += sensor_variance * np.eye(len(covariance))
    apart = seen.T @ error
    return float(apart @ np.linalg.solve(covariance, apart)), seen.shape[1]
