"""Geometry of several views: relative pose, resection, triangulation, similarities."""

from sfmcpp.geometry.agreeing_pairs import agreeing_pairs
from sfmcpp.geometry.focal_from_pairs import focal_from_pairs
from sfmcpp.geometry.focal_resection import FocalPoseEstimate, resection_with_focal
from sfmcpp.geometry.known_rotation import relative_pose_of_rotation, resection_of_rotation
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
from sfmcpp.geometry.robust_triangulation import robust_triangulation
from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.geometry.triangulation import (
    refine_points,
    triangulate_linear,
    triangulate_midpoint,
    triangulate_optimal,
)
from sfmcpp.geometry.two_view import TwoViewGeometry, two_view_geometry
from sfmcpp.geometry.two_view_matrices import (
    MatrixEstimate,
    fundamental_from_matches,
    fundamental_linear,
    homography_from_matches,
)

__all__ = [
    "FocalPoseEstimate",
    "MatrixEstimate",
    "PoseEstimate",
    "RelativePose",
    "Similarity",
    "TwoViewGeometry",
    "agreeing_pairs",
    "depths",
    "fit_pose_similarity",
    "fit_similarity",
    "focal_from_pairs",
    "fundamental_from_matches",
    "fundamental_linear",
    "homography_from_matches",
    "mean_reprojection_errors_px",
    "pose_inliers",
    "refine_points",
    "relative_pose",
    "relative_pose_of_rotation",
    "reliable_points",
    "reprojection_errors_px",
    "resection",
    "resection_of_rotation",
    "resection_with_focal",
    "robust_triangulation",
    "triangulate_linear",
    "triangulate_midpoint",
    "triangulate_optimal",
    "triangulation_angles_deg",
    "two_view_geometry",
]
