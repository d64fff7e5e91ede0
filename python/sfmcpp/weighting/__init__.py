"""Fusion of images with other sensors: weights of constraints, chosen from the data."""

from sfmcpp.weighting.conflict import ConflictReport, conflict
from sfmcpp.weighting.criteria import (
    admissible_weights,
    l_curve_scores,
    lowest,
    lowest_valley,
    ltn_scores,
    running_median,
    scaled_l_curve_scores,
)
from sfmcpp.weighting.method import METHODS, SelectionMethod, selection_method
from sfmcpp.weighting.orientation_filter import (
    FilteredOrientations,
    filter_orientations,
    filter_trajectory,
    with_orientations,
)
from sfmcpp.weighting.pose_constraint import CONSTRAINT_UNITS, ConstraintUnit, PoseConstraint
from sfmcpp.weighting.pose_view import PoseView
from sfmcpp.weighting.selection import WeightSelection, equivalent_sigma, select_weight, select_weights
from sfmcpp.weighting.solve import solve
from sfmcpp.weighting.sweep import PoseFit, WeightSweep, refine_pose, sweep_weights
from sfmcpp.weighting.weights import weight_grid
from sfmcpp.weighting.whole.selection import WEIGHT_METHODS

__all__ = [
    "CONSTRAINT_UNITS",
    "METHODS",
    "WEIGHT_METHODS",
    "ConflictReport",
    "ConstraintUnit",
    "FilteredOrientations",
    "PoseConstraint",
    "PoseFit",
    "PoseView",
    "SelectionMethod",
    "WeightSelection",
    "WeightSweep",
    "admissible_weights",
    "conflict",
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
