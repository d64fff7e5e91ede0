"""Fusion of images with other sensors: weights of constraints, chosen from the data.

Weights are said in one way. Residuals r of N observations are over their standard deviations, and ε is the
mean squared error of a constraint: the squared error over its number of entries (thesis table 5.1).

- A group in a whole problem has the weight w, its members the member weights m: the solver minimises
  ``½ Σ ρ(‖r‖²) + ½ w Σ m ε``.
- The constraint of one pose has the weight λ: its fit minimises ``1/N Σ ‖r‖² + λ² ε`` (thesis eq. 5.1). In
  a sum over the same N observations it has ``w m = N λ²``.
- An error vector d in the unit of the sensor has ``ε = ‖d‖² / spread`` (:class:`ConstraintUnit`). Beside
  images of noise s, a weight amounts to the standard deviation ``σ = s √(spread / (w m))``.

:func:`select_weight` and :func:`select_weights` choose λ by one pose, ``solve(..., weight=...)`` w by a whole
problem; `WEIGHT_METHODS` says which method can do what. Both give a :class:`WeightSelection`, whose
:class:`ConflictReport` tells whether chance explains how far sensor and images are apart.
"""

from sfmcpp.model.weight_selection import ConflictReport, WeightSelection
from sfmcpp.weighting.bounds import WEIGHT_BOUNDS, WeightBounds, declared_bounds, declared_weight
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS, conflict
from sfmcpp.weighting.criteria import (
    admissible_weights,
    l_curve_scores,
    lowest,
    lowest_valley,
    ltn_scores,
    running_median,
    scaled_l_curve_scores,
)
from sfmcpp.weighting.methods import (
    POSE_METHODS,
    PROBLEM_METHODS,
    WEIGHT_METHODS,
    WeightMethod,
    selection_method,
)
from sfmcpp.weighting.orientation_filter import (
    FilteredOrientations,
    filter_orientations,
    filter_trajectory,
    with_orientations,
)
from sfmcpp.weighting.pose import equivalent_sigma, select_weight, select_weights
from sfmcpp.weighting.pose_inputs import PoseConstraint, PoseView
from sfmcpp.weighting.solve import solve
from sfmcpp.weighting.sweep import PoseFit, WeightSweep, refine_pose, sweep_weights, weight_grid
from sfmcpp.weighting.units import ConstraintUnit

__all__ = [
    "CONFLICT_SIGMAS",
    "POSE_METHODS",
    "PROBLEM_METHODS",
    "WEIGHT_BOUNDS",
    "WEIGHT_METHODS",
    "ConflictReport",
    "ConstraintUnit",
    "FilteredOrientations",
    "PoseConstraint",
    "PoseFit",
    "PoseView",
    "WeightBounds",
    "WeightMethod",
    "WeightSelection",
    "WeightSweep",
    "admissible_weights",
    "conflict",
    "declared_bounds",
    "declared_weight",
    "equivalent_sigma",
    "filter_orientations",
    "filter_trajectory",
    "l_curve_scores",
    "lowest",
    "lowest_valley",
    "ltn_scores",
    "refine_pose",
    "running_median",
    "scaled_l_curve_scores",
    "select_weight",
    "select_weights",
    "selection_method",
    "solve",
    "sweep_weights",
    "weight_grid",
    "with_orientations",
]
