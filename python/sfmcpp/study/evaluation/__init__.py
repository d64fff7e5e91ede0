"""Trajectories and models against the truth: thesis eqs 5.24 and 5.25, APE and RPE; errors of images, AUC."""

from sfmcpp.study.evaluation.align import Alignment, AlignmentRule, align
from sfmcpp.study.evaluation.associate import Matched, associate
from sfmcpp.study.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.study.evaluation.image_poses import ImagePoses, read_image_poses
from sfmcpp.study.evaluation.metrics import (
    Statistics,
    ape,
    auc,
    mean_3d_error,
    relative_pose_errors_deg,
    rpe,
    scale_ratios,
)
from sfmcpp.study.evaluation.model import ModelEvaluation, evaluate_model, read_truth

__all__ = [
    "Alignment",
    "AlignmentRule",
    "Evaluation",
    "ImagePoses",
    "Matched",
    "ModelEvaluation",
    "Statistics",
    "align",
    "ape",
    "associate",
    "auc",
    "evaluate",
    "evaluate_model",
    "mean_3d_error",
    "read_image_poses",
    "read_truth",
    "relative_pose_errors_deg",
    "rpe",
    "scale_ratios",
]
