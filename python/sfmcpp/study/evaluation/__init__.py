"""Trajectories measured against the truth: alignment, thesis eqs 5.24 and 5.25, APE and RPE."""

from sfmcpp.study.evaluation.align import Alignment, AlignmentRule, align
from sfmcpp.study.evaluation.associate import Matched, associate
from sfmcpp.study.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.study.evaluation.metrics import Statistics, ape, mean_3d_error, rpe, scale_ratios

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
