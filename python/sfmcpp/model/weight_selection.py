"""Results of weight selection: the chosen weight of a sensor, and its conflict with the images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class ConflictReport:
    """Distance of a sensor from the images: of one constraint, or of the worst member of a group.

    Attributes
    ----------
    name : str
        What the constraint or the group is called.
    discrepancy : float
        Length of the error, in `unit`.
    unit : str
        Unit of the sensor.
    squared_mahalanobis : float
        Squared length of the error under its covariance.
    degrees_of_freedom : int
        Independent numbers in the error.
    sigmas : float
        As many standard deviations of one normal number are as unlikely.
    conflicting : bool
        Whether chance does not explain it: in a group, the worst among as many members as there are, the mean
        or the neighbours.
    sensor_sigma : float or None
        Declared standard deviation of the sensor; None: there is none.
    member : int or None
        The worst member of a group; None: one constraint.
    bias_sigmas : float
        Standard deviations by which the mean error of the members differs from zero.
    alike_sigmas : float
        Standard deviations by which errors of neighbouring members are more alike than chance has it.
    images_sigma : float
        Standard deviation that the noise of the images gives each number of the error, in `unit`; of a group:
        0.
    observations : int
        Images of points that tell the pose it is compared with; of a group: 0.
    """

    name: str
    discrepancy: float
    unit: str
    squared_mahalanobis: float
    degrees_of_freedom: int
    sigmas: float
    conflicting: bool
    sensor_sigma: float | None = None
    member: int | None = None
    bias_sigmas: float = 0.0
    alike_sigmas: float = 0.0
    images_sigma: float = 0.0
    observations: int = 0

    def describe(self) -> str:
        """The report in one sentence."""
        verdict = "disagrees with" if self.conflicting else "agrees with"
        if self.member is not None:
            return (
                f"{self.name} {verdict} the images: member {self.member} is {self.sigmas:.1f} σ away, "
                f"the mean {self.bias_sigmas:.1f} σ, neighbours alike by {self.alike_sigmas:.1f} σ"
            )
        if self.degrees_of_freedom == 0:
            return f"{self.name}: its error does not depend on the pose, so the images cannot test it"
        given = "taken as exact" if self.sensor_sigma is None else f"σ = {self.sensor_sigma:.3g} {self.unit}"
        return (
            f"{self.name} ({given}) {verdict} the images: {self.discrepancy:.3g} {self.unit} apart, "
            f"{self.sigmas:.1f} σ"
        )


@dataclass(frozen=True, eq=False)
class WeightSelection:
    """The weight of one constraint or of a group, and the whole curve it was chosen from.

    Attributes
    ----------
    name : str
        What the constraint or the group is called.
    method : str
        How it was chosen.
    weight : float
        The choice: λ of one pose's constraint, w of a group (:mod:`sfmcpp.weighting` says what they are).
    weights : (W,) float64
        The weights tried, increasing.
    vision : (W,) float64
        Mean squared reprojection error at each, in units of sigma_px²; of groups, under the robust loss.
    constraint_error : (W,) float64
        Mean squared error of the constraint, or of the members, at each.
    score : (W,) float64
        What the method minimises; infinite where it may not choose. Of groups, "loo-approx" and "k-fold": the
        mean robust loss of predicted observations; "variance": minus twice the logarithm of the likelihood
        and its prior, up to a constant, at the weights on the way.
    admissible : (W,) bool
        Weights that keep at least 90 % of the inliers of the images alone.
    sensor_sigma : float
        Standard deviation that the weight amounts to, in `unit`: with it and with the noise of the images,
        maximum likelihood has the same minimum. Infinite for no weight.
    unit : str
        Unit of the sensor.
    conflict : ConflictReport
        Whether the sensor agrees with the images.
    redundancy : float or None
        How many of a group's numbers the fit leaves to judge it by; None: one constraint, or a problem too
        large to tell.
    pose : (3, 4) float64 or None
        The pose fitted at that weight, world_from_camera; None: a group.
    """

    name: str
    method: str
    weight: float
    weights: FloatArray
    vision: FloatArray
    constraint_error: FloatArray
    score: FloatArray
    admissible: BoolArray
    sensor_sigma: float
    unit: str
    conflict: ConflictReport
    redundancy: float | None = None
    pose: FloatArray | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain values only, as for JSON; infinite scores are None."""
        values = {name: _plain_value(getattr(self, name)) for name in self.__dataclass_fields__}
        return {**values, "conflict": dict(vars(self.conflict))}

    @property
    def at_end(self) -> bool:
        """Whether it is the smallest or the largest positive weight that has a score.

        A trade-off criterion ends there where its curve has no corner.
        """
        scored = self.weights[(self.weights > 0) & np.isfinite(self.score)]
        if self.method == "variance" or len(scored) < 3:
            return False
        return bool(0 < self.weight <= scored[0] or self.weight >= scored[-1])

    def describe(self) -> str:
        """The choice, and whether sensor and images agree, in one line."""
        amounts = f"σ = {self.sensor_sigma:.3g} {self.unit}" if self.weight > 0 else "left out"
        end = ", at the end of what was tried: no better one inside" if self.at_end else ""
        return f"{self.weight:.3g} by {self.method} ({amounts}{end}); {self.conflict.describe()}"


def _plain_value(value: Any) -> Any:
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if not isinstance(value, np.ndarray):
        return value
    if value.ndim > 1:
        return value.tolist()
    return [x if np.isfinite(x) else None for x in value.tolist()]
