"""Sensors beside the camera: streams, and the motion that they measure between two images."""

from sfmcpp.model import Gap, SensorStream, Trajectory
from sfmcpp.sensors.agreement import require_agreement, require_overlap
from sfmcpp.sensors.counter_leaps import counter_leaps, describe_counter_leaps, without_counter_leaps
from sfmcpp.sensors.direction_check import DirectionClock, check_directions
from sfmcpp.sensors.gps import (
    earth_centred,
    east_north_up,
    geodetic_of,
    local_positions,
    position_at,
    smoothed_positions,
)
from sfmcpp.sensors.inertial import (
    orientations,
    pose_at,
    pose_stream_values,
    rotation_increment,
    sampling_variance,
)
from sfmcpp.sensors.mounting import Mounting, find_misalignment
from sfmcpp.sensors.odometer import (
    camera_displacement,
    carried_over,
    dead_stretches,
    travelled_distance,
)
from sfmcpp.sensors.position_check import BendCheck, PositionClock, check_bends, check_position_clock
from sfmcpp.sensors.position_jumps import (
    displaced_positions,
    longest_lost_fix,
    without_leaps,
    without_repeats,
)
from sfmcpp.sensors.rate_axes import RateAxes, find_rate_axes, with_axes
from sfmcpp.sensors.rate_bias import MOST_TURNS, RateBias, bias_at_rest, find_bias, without_bias
from sfmcpp.sensors.rate_spikes import describe_spikes, rate_spikes, without_spikes
from sfmcpp.sensors.registration import (
    Registration,
    register_by_distances,
    register_by_poses,
    register_by_positions,
)
from sfmcpp.sensors.rotation_check import RotationCheck, check_rotations, check_turns
from sfmcpp.sensors.slip import Slip, find_slip, is_easier_without, without_slip
from sfmcpp.sensors.speed_leaps import doubtful_stretches
from sfmcpp.sensors.stream import (
    describe_coverage,
    describe_gaps,
    interpolate_poses,
    interpolate_rotations,
    interpolate_vectors,
    measured_at,
    predict_pose,
)
from sfmcpp.sensors.turn import Turn

__all__ = [
    "MOST_TURNS",
    "BendCheck",
    "DirectionClock",
    "Gap",
    "Mounting",
    "PositionClock",
    "RateAxes",
    "RateBias",
    "Registration",
    "RotationCheck",
    "SensorStream",
    "Slip",
    "Trajectory",
    "Turn",
    "bias_at_rest",
    "camera_displacement",
    "carried_over",
    "check_bends",
    "check_directions",
    "check_position_clock",
    "check_rotations",
    "check_turns",
    "counter_leaps",
    "dead_stretches",
    "describe_counter_leaps",
    "describe_coverage",
    "describe_gaps",
    "describe_spikes",
    "displaced_positions",
    "doubtful_stretches",
    "earth_centred",
    "east_north_up",
    "find_bias",
    "find_misalignment",
    "find_rate_axes",
    "find_slip",
    "geodetic_of",
    "interpolate_poses",
    "interpolate_rotations",
    "interpolate_vectors",
    "is_easier_without",
    "local_positions",
    "longest_lost_fix",
    "measured_at",
    "orientations",
    "pose_at",
    "pose_stream_values",
    "position_at",
    "predict_pose",
    "rate_spikes",
    "register_by_distances",
    "register_by_poses",
    "register_by_positions",
    "require_agreement",
    "require_overlap",
    "rotation_increment",
    "sampling_variance",
    "smoothed_positions",
    "travelled_distance",
    "with_axes",
    "without_bias",
    "without_counter_leaps",
    "without_leaps",
    "without_repeats",
    "without_slip",
    "without_spikes",
]
