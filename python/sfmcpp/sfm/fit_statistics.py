"""The linear model of an adjustment and the variance of its observations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sfmcpp.ba.linearize import LinearModel, linearize
from sfmcpp.model import Problem
from sfmcpp.model.residual_group import Group
from sfmcpp.weighting.statistics import redundancy_of_images

# What of the options of a solve a linear model takes.
_LINEAR = ("loss", "gauge", "threads")


def linear_model(
    problem: Problem, groups: Iterable[Group], options: dict[str, Any], loss_scale_px: float
) -> LinearModel:
    """The linear model at the end of a solve with these options, at the scale of its loss there."""
    known = {name: options[name] for name in _LINEAR if name in options}
    return linearize(problem, constraints=groups, loss_scale_px=loss_scale_px, **known)


def pixel_variance(model: LinearModel) -> float:
    """Variance of a coordinate of an observation over the stated one, for covariances."""
    return model.influence_sums().variance_in_normal_matrix(_parameters_of_images(model))


def cost_variance(model: LinearModel) -> float:
    """Variance of a coordinate over the stated one, for weights of other terms of the cost."""
    return model.influence_sums().variance_in_cost(_parameters_of_images(model))


def _parameters_of_images(model: LinearModel) -> int:
    return 2 * len(model.residuals) - redundancy_of_images(model)
