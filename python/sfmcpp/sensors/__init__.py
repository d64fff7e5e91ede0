"""Sensors beside the camera: streams of measurements, and what they say of the motion between two images."""

from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.model import Gap, SensorStream, Trajectory
from sfmcpp.sensors.agreement import require_agreement, require_overlap
from sfmcpp.sensors.clock import ClockOffset, angular_rates, estimate_clock_offset, require_same_clock
from sfmcpp.sensors.gps import earth_centred, east_north_up, local_positions, position_at
from sfmcpp.sensors.imu import bias_at_rest, orientations, rotation_increment, without_bias
from sfmcpp.sensors.ins import displacement_between, pose_at, pose_stream_values
from sfmcpp.sensors.leaps import doubtful_stretches
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.odometer import displacement, speed_along, travelled_distance
from sfmcpp.sensors.prediction import (
    interpolate_poses,
    interpolate_rotations,
    interpolate_vectors,
    predict_pose,
)
from sfmcpp.sensors.registration import (
    Registration,
    register_by_distances,
    register_by_poses,
    register_by_positions,
)
from sfmcpp.sensors.rotation_check import RotationCheck, check_rotations
from sfmcpp.sensors.stream import describe_gaps, measured_at

__all__ = [
    "ClockOffset",
    "Gap",
    "Mounting",
    "Registration",
    "RotationCheck",
    "SensorStream",
    "Similarity",
    "Trajectory",
    "angular_rates",
    "bias_at_rest",
    "check_rotations",
    "describe_gaps",
    "displacement",
    "displacement_between",
    "doubtful_stretches",
    "earth_centred",
    "east_north_up",
    "estimate_clock_offset",
    "fit_pose_similarity",
    "fit_similarity",
    "interpolate_poses",
    "interpolate_rotations",
    "interpolate_vectors",
    "local_positions",
    "measured_at",
    "orientations",
    "pose_at",
    "pose_stream_values",
    "position_at",
    "predict_pose",
    "register_by_distances",
    "register_by_poses",
    "register_by_positions",
    "require_agreement",
    "require_overlap",
    "require_same_clock",
    "rotation_increment",
    "speed_along",
    "travelled_distance",
    "without_bias",
]
