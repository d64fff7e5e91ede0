"""Geometry of several views: relative pose, resection, triangulation, alignment."""

from sfmcpp.mvg.alignment import Alignment, align_rigid, align_similarity
from sfmcpp.mvg.optimal_triangulation import correct_matches, triangulate_optimal
from sfmcpp.mvg.point_refinement import refine_points
from sfmcpp.mvg.point_tests import depths, reliable_points, reprojection_errors_px, triangulation_angles_deg
from sfmcpp.mvg.pose_estimate import PoseEstimate
from sfmcpp.mvg.relative_pose import RelativePose, relative_pose
from sfmcpp.mvg.resection import pose_inliers, resection
from sfmcpp.mvg.triangulation import triangulate_linear, triangulate_midpoint

__all__ = [
    "Alignment",
    "PoseEstimate",
    "RelativePose",
    "align_rigid",
    "align_similarity",
    "correct_matches",
    "depths",
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
