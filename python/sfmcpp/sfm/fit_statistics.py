"""The linear model of an adjustment and the variance of its observations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sfmcpp.ba.linearize import LinearModel, linearize
from sfmcpp.model import Problem
from sfmcpp.model.residual_group import Group
from sfmcpp.weighting.statistics import redundancy_of_images

# What of the options of a solve a linear model takes.
_LINEAR = ("loss", "loss_scale_px", "gauge", "threads")


def linear_model(problem: Problem, groups: Iterable[Group], options: dict[str, Any]) -> LinearModel:
    """The linear model at a problem, by what it takes of the options of a solve."""
    known = {name: options[name] for name in _LINEAR if name in options}
    return linearize(problem, constraints=groups, **known)


def pixel_variance(model: LinearModel) -> float:
    """Variance of a coordinate of an observation, over that which it was taken to have."""
    squared = (model.residuals**2).sum(axis=1)
    return float((model.observation_weights * squared).sum() / max(redundancy_of_images(model), 1))
