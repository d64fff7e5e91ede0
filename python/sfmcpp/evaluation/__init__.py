"""Trajectories measured against the truth: alignment, thesis eqs 5.24 and 5.25, APE and RPE."""

from sfmcpp.evaluation.align import Alignment, AlignmentRule, align
from sfmcpp.evaluation.associate import Matched, associate
from sfmcpp.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.evaluation.metrics import Statistics, ape, mean_3d_error, rpe, scale_ratios

__all__ = [
    "Alignment",
    "AlignmentRule",
    "Evaluation",
    "Matched",
    "Statistics",
    "align",
    "ape",
    "associate",
    "evaluate",
    "mean_3d_error",
    "rpe",
    "scale_ratios",
]
