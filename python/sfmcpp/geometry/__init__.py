"""Geometry of several views: relative pose, resection, triangulation, alignment."""

from sfmcpp.geometry.alignment import Alignment, align_rigid, align_similarity
from sfmcpp.geometry.optimal_triangulation import correct_matches, triangulate_optimal
from sfmcpp.geometry.point_refinement import refine_points
from sfmcpp.geometry.point_tests import (
    depths,
    mean_reprojection_errors_px,
    reliable_points,
    reprojection_errors_px,
    triangulation_angles_deg,
)
from sfmcpp.geometry.pose_estimate import PoseEstimate
from sfmcpp.geometry.relative_pose import RelativePose, relative_pose
from sfmcpp.geometry.resection import pose_inliers, resection
from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.geometry.triangulation import triangulate_linear, triangulate_midpoint

__all__ = [
    "Alignment",
    "PoseEstimate",
    "RelativePose",
    "Similarity",
    "align_rigid",
    "align_similarity",
    "correct_matches",
    "depths",
    "fit_pose_similarity",
    "fit_similarity",
    "mean_reprojection_errors_px",
    "pose_inliers",
    "refine_points",
    "relative_pose",
    "reliable_points",
    "reprojection_errors_px",
    "resection",
    "triangulate_linear",
    "triangulate_midpoint",
    "triangulate_optimal",
    "triangulation_angles_deg",
]
