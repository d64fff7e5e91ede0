"""The linear model of an adjustment and the variance of its observations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from sfmcpp.ba.linearize import LinearModel, linearize
from sfmcpp.model import Problem
from sfmcpp.model.residual_group import Group

# What of the options of a solve a linear model takes.
_LINEAR = ("loss", "loss_scale_px", "gauge", "threads")
# Of a metric world: position, rotation and scale.
_GAUGE_FREEDOMS = 7


def linear_model(problem: Problem, groups: Iterable[Group], options: dict[str, Any]) -> LinearModel:
    """The linear model at a problem, by what it takes of the options of a solve."""
    known = {name: options[name] for name in _LINEAR if name in options}
    return linearize(problem, constraints=groups, **known)


def pixel_variance(model: LinearModel) -> float:
    """Variance of a coordinate of an observation, over that which it was taken to have."""
    squared = (model.residuals**2).sum(axis=1)
    # The images do not determine where the world is: columns of that explain nothing of them, unless the
    # gauge holds them (baselines of rigs tell the scale, one of the seven).
    held = np.count_nonzero(model.camera_columns[:, :6] < 0)
    redundancy = 2 * len(squared) - model.num_columns + max(_GAUGE_FREEDOMS - held, 0)
    return float((model.observation_weights * squared).sum() / max(redundancy, 1))
