"""The variance of observations over the stated one, from residuals under any loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.ba.linear_results import ConstraintRows
from sfmcpp.model import CONSTRAINT_KINDS, ConstraintGroup
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.residual_group import Group

# Lower bound of the mean slope of the influence function: it nears 0 where the scale of the loss is so small
# that nearly all observations are outliers.
_LEAST_SLOPE = 0.05


@dataclass(frozen=True)
class InfluenceSums:
    """What a loss leaves of M observations: Huber's asymptotic variance (`docs/equations.md`, §4).

    The influence of an observation is ``ψ = ρ′ r``, of mean square ``ρ′² s`` with s its squared residual.

    Attributes
    ----------
    squares : float
        Σ ρ′² s.
    weight, slope : float
        Means of ρ′ and of the slope ``d(s ρ′)/ds`` of the influence; one without robust loss.
    count : int
        Numbers observed, 2 M.
    """

    squares: float
    weight: float
    slope: float
    count: int

    @classmethod
    def of(cls, squared: FloatArray, weights: FloatArray, slopes: FloatArray) -> InfluenceSums:
        """Of squared residuals (M,), their ρ′ and slopes."""
        if not len(squared):
            return cls(0.0, 1.0, 1.0, 0)
        squares = float((weights**2 * squared).sum())
        return cls(squares, float(weights.mean()), max(float(slopes.mean()), _LEAST_SLOPE), 2 * len(squared))

    def redundancy(self, parameters: float) -> float:
        """Degrees of freedom beside so many parameters; what a loss has let go of adds none."""
        return self.count - parameters / self.slope

    def variance_in_cost(self, parameters: float) -> float:
        """Variance over the stated one, for weights of other terms of the cost."""
        return self.squares / max(self.redundancy(parameters), 1.0) / self.slope

    def variance_in_normal_matrix(self, parameters: float) -> float:
        """Variance over the stated one, for covariances by a normal matrix with the weights ρ′."""
        return self.variance_in_cost(parameters) * self.weight / self.slope

    def variance_factor(self, parameters: float, numbers: int, squares: float) -> float:
        """Variance over the stated one, with numbers and squared errors of groups; NaN without redundancy."""
        redundancy = self.redundancy(parameters) + numbers
        own = self.squares / self.slope * self.weight / self.slope
        return (own + squares) / redundancy if redundancy > 0 else np.nan


def independent_numbers(group: Group, rows: ConstraintRows) -> int:
    """How many numbers a group measures: three of a rotation, not nine; none without weight."""
    if rows.weight == 0:
        return 0
    if not isinstance(group, ConstraintGroup):
        return len(rows.errors)
    each = CONSTRAINT_KINDS[group.kind].freedom if group.member_weights.ndim == 1 else 1
    return each * int(np.count_nonzero(group.member_weights))
