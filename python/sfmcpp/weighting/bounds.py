"""Bounds of a weight: from above by the declared σ, from below by the conflict with the images.

Images alone choose impossible weights where they tell little: of one pose, leave-one-out takes an odometer of
20 mm for one of 0.15 mm, or takes none of it. The thesis has no bounds (``"none"``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_positive
from sfmcpp.model.weight_selection import ConflictReport
from sfmcpp.weighting.criteria import MEDIAN_WIDTH
from sfmcpp.weighting.pose_inputs import PoseConstraint

WeightBoundsName = Literal["declared", "none"]
WEIGHT_BOUNDS: tuple[str, ...] = get_args(WeightBoundsName)
# A conflict of as many standard deviations takes half of the weight λ away; of many more, nearly all of it.
_YIELDING_SIGMAS = 3.0
# Ratio of neighbouring weights at most, as in the grid of the thesis.
_LARGEST_RATIO = 1.15
# Bounds nearer to each other leave nothing to choose.
_SAME = 1.05


@dataclass(frozen=True)
class WeightBounds:
    """The weights λ to choose from, both ends included.

    Attributes
    ----------
    smallest, largest : float
        The ends.
    """

    smallest: float
    largest: float

    def grid(self) -> FloatArray:
        """Weights (W,) to try: zero, those within, and as many on either side as running medians need."""
        between = max(1, math.ceil(math.log(self.largest / self.smallest) / math.log(_LARGEST_RATIO)))
        within = np.geomspace(self.smallest, self.largest, between + 1)
        if self.largest < _SAME * self.smallest:
            within = np.array([self.largest])
        outside = _LARGEST_RATIO ** np.arange(1, MEDIAN_WIDTH // 2 + 1)
        return np.concatenate([[0.0], self.smallest / outside[::-1], within, self.largest * outside])

    def hold(self, weights: FloatArray) -> BoolArray:
        """Which of the weights (W,) are within, but for rounding."""
        rounding = 1 + 1e-9
        return (weights * rounding >= self.smallest) & (weights <= rounding * self.largest)


@checked()
def declared_weight(constraint: PoseConstraint, count: int, pixel_sigma: float) -> float:
    """Weight λ that the declared standard deviation of a sensor amounts to: ``σ_px √(spread / n) / σ``.

    The inverse of :func:`sfmcpp.weighting.equivalent_sigma`. With ``ε = ‖d‖² / spread`` the cost of a pose,
    ``1/n Σ‖r‖² + λ² ε``, is then ``σ_px²/n`` times ``Σ‖r‖²/σ_px² + ‖d‖²/σ²``, twice its negative
    log-likelihood.

    Parameters
    ----------
    constraint : PoseConstraint
        The constraint.
    count : int
        Number n of observations.
    pixel_sigma : float
        Standard deviation of the images, in the units of their errors.

    Returns
    -------
    float
        The weight.

    Raises
    ------
    InvalidArgument
        If the constraint declares none, `count` is not positive, or `pixel_sigma` is not positive and finite.
    """
    require_count("count", count)
    require_positive("pixel_sigma", pixel_sigma)
    if constraint.sensor_sigma is None:
        raise InvalidArgument(
            f"{constraint.name}: sensor_sigma = None: bounds = 'declared' needs a standard deviation"
        )
    return pixel_sigma * math.sqrt(constraint.unit.spread / count) / constraint.sensor_sigma


@checked()
def declared_bounds(
    constraint: PoseConstraint, count: int, pixel_sigma: float, report: ConflictReport
) -> WeightBounds:
    """Bounds of λ: the declared weight, and what a conflict of c standard deviations leaves of it.

    The lower bound is ``λ / (1 + (c/3)²)``. With its root instead, the influence of Cauchy's loss, errors of
    drives with a faulty gyroscope grow by half, and those of drives without faults fall by a tenth. A sensor
    that does not yield has λ for both.

    Parameters
    ----------
    constraint : PoseConstraint
        The constraint.
    count : int
        Number of observations.
    pixel_sigma : float
        Standard deviation of the images.
    report : ConflictReport
        How far the sensor is from the images.

    Returns
    -------
    WeightBounds
        Within them a criterion chooses.

    Raises
    ------
    InvalidArgument
        If the constraint declares no standard deviation.
    """
    largest = declared_weight(constraint, count, pixel_sigma)
    left = 1 / (1 + (report.sigmas / _YIELDING_SIGMAS) ** 2) if constraint.yields else 1.0
    return WeightBounds(left * largest, largest)
