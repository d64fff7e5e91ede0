"""Fusion of images with other sensors: weights of constraints, chosen from the data."""

from sfmcpp.fusion.conflict import ConflictReport, conflict
from sfmcpp.fusion.criteria import (
    admissible_weights,
    l_curve_scores,
    lowest,
    lowest_valley,
    ltn_scores,
    running_median,
    scaled_l_curve_scores,
)
from sfmcpp.fusion.method import METHODS, SelectionMethod, selection_method
from sfmcpp.fusion.orientation_filter import (
    FilteredOrientations,
    filter_orientations,
    filter_trajectory,
    with_orientations,
)
from sfmcpp.fusion.pose_constraint import CONSTRAINT_UNITS, ConstraintUnit, PoseConstraint
from sfmcpp.fusion.pose_view import PoseView
from sfmcpp.fusion.selection import WeightSelection, equivalent_sigma, select_weight, select_weights
from sfmcpp.fusion.sweep import PoseFit, WeightSweep, refine_pose, sweep_weights
from sfmcpp.fusion.weights import weight_grid

__all__ = [
    "CONSTRAINT_UNITS",
    "METHODS",
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
    "sweep_weights",
    "weight_grid",
    "with_orientations",
]
