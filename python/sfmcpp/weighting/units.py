"""Units of the errors of constraint kinds, and σ from weights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sfmcpp.model import Problem, ResidualGroup, constraint_kind
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.residual_group import Group


@dataclass(frozen=True)
class ConstraintUnit:
    """How the mean squared error of a kind relates to errors in the unit of the sensor.

    Attributes
    ----------
    name : str
        The unit.
    spread : float
        An error vector d in that unit has the mean squared error ``‖d‖² / spread``, to first order.
    freedom : int
        Independent numbers in one measurement: nine entries of a rotation are three.
    """

    name: str
    spread: float
    freedom: int


def unit_of(kind: str, points: Sequence[FloatArray]) -> ConstraintUnit:
    """Unit, spread and freedom of a kind.

    Parameters
    ----------
    kind : str
        One of `CONSTRAINT_KINDS`.
    points : sequence of (k, 3) float64
        Frozen points of each member, of kinds that compare images: their mean number is the spread.

    Returns
    -------
    ConstraintUnit
        With a spread that is a number.
    """
    facts = constraint_kind(kind)
    spread = facts.spread
    if spread is None:
        spread = sum(len(x) for x in points) / max(len(points), 1)
    return ConstraintUnit(facts.unit, spread, facts.freedom)


def unit_of_group(group: Group, problem: Problem) -> ConstraintUnit:
    """Unit, spread and freedom of a group's kind; residuals by a function have the unit of the function."""
    if isinstance(group, ResidualGroup):
        return ConstraintUnit("units of r", 1.0, group.residuals_at(problem).shape[1])
    return unit_of(group.kind, group.points)


def sigma_of_weight(unit: ConstraintUnit, weight: float, image_sigma: float) -> float:
    """Standard deviation that a weight w of a group amounts to.

    ``Σ‖r‖² + w ‖d‖²/spread`` is, up to a factor, the log-likelihood ``Σ‖r‖²/s² + ‖d‖²/σ²`` with
    ``σ = s √(spread / w)``.

    Parameters
    ----------
    unit : ConstraintUnit
        Of the constraint.
    weight : float
        The weight w.
    image_sigma : float
        Standard deviation s of the images, in the units of their errors.

    Returns
    -------
    float
        Standard deviation of each component, in the constraint's unit; infinite without weight.
    """
    return image_sigma * math.sqrt(unit.spread / weight) if weight > 0 else math.inf
