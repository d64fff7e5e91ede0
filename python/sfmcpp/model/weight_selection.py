"""What was chosen for a group of constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class GroupWeightSelection:
    """The weight of a group of constraints, and what it was chosen from.

    Attributes
    ----------
    name : str
        Name of the group.
    method : str
        How it was chosen.
    weight : float
        The chosen weight.
    weights : (W,) float64
        The weights tried, increasing.
    vision : (W,) float64
        Mean ρ of the squared residuals of the images at each.
    constraint_error : (W,) float64
        Mean squared error of the members at each.
    score : (W,) float64
        What the method minimises; infinite where it may not choose.
    admissible : (W,) bool
        Weights that keep at least 90 % of the inliers of the images alone, those within twice their noise.
    sensor_sigma : float
        Standard deviation that the weight amounts to, in `unit`.
    unit : str
        Unit of the sensor.
    redundancy : float or None
        How many of the group's numbers the fit leaves to judge it by; None: the problem is too large to tell.
    worst_member : int
        The member farthest from the others' measure.
    worst_sigmas : float
        As many standard deviations of one normal number are as unlikely as its error, by the median member.
    bias_sigmas : float
        Standard deviations by which the mean error of the members differs from zero.
    alike_sigmas : float
        Standard deviations by which errors of neighbouring members are more alike than chance has it.
    agrees : bool
        Whether chance explains the worst member, among as many as there are, the mean and the neighbours.
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
    redundancy: float | None
    worst_member: int
    worst_sigmas: float
    bias_sigmas: float
    alike_sigmas: float
    agrees: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain values only, as for JSON; infinite scores are None."""
        return {name: _plain(getattr(self, name)) for name in self.__dataclass_fields__}

    def describe(self) -> str:
        """What was chosen, and whether sensor and images agree, in one line."""
        verdict = "agrees with" if self.agrees else "disagrees with"
        return (
            f"{self.weight:.3g} by {self.method} (σ = {self.sensor_sigma:.3g} {self.unit}); "
            f"{verdict} the images: member {self.worst_member} is {self.worst_sigmas:.1f} σ away, "
            f"the mean {self.bias_sigmas:.1f} σ, neighbours alike by {self.alike_sigmas:.1f} σ"
        )


def _plain(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return [x if np.isfinite(x) else None for x in value.tolist()]
