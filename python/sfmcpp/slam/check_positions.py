"""Positions checked at the end of a run: mirrored axes, and the clock."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.rigs import composed
from sfmcpp.sensors import Turn, check_bends, check_position_clock
from sfmcpp.sensors.stream import clock_text
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WorldMap

# Directions of travel in the camera's axes are alike if their mean is so long: about that of 40° of scatter.
_LEAST_STEADY = 0.75


def check_positions(result: SlamResult, sensors: SensorSuite) -> list[str]:
    """Find positions with mirrored axes, or else on another clock, which is set.

    The map has followed the positions and cannot judge them. Their bends are compared with the rotations
    between pairs of images, their times with the path by odometer and gyroscope.

    Parameters
    ----------
    result : SlamResult
        The run, over all frames.
    sensors : SensorSuite
        Its sensors at the end; the stamps of positions are moved where their clock is off.

    Returns
    -------
    list of str
        A sentence for each fault.
    """
    world = result.world
    gpses = sensors.of_type(Gps)
    if world is None or not gpses:
        return []
    seen = _keyframe_rotations(world, sensors)
    path = _dead_reckoned_path(list(result.path.times.values()), sensors)
    return [doubt for gps in gpses for doubt in _position_faults(gps, seen, path, sensors)]


def _position_faults(gps: Gps, seen: Trajectory, path: Trajectory | None, sensors: SensorSuite) -> list[str]:
    bends = check_bends(gps.believed, seen, gps.up_in_camera, gps.likely_sigma_m)
    if bends.is_mirrored and _turns_with_its_way(gps, sensors.turns):
        return [
            f"{gps.name}: where its positions bend most, by {np.degrees(bends.told_rad):.0f}°, the camera "
            f"turns to the other side, by {np.degrees(bends.seen_rad):.0f}°: are x and y, or latitude and "
            "longitude, swapped (x is east, y north), or does z point down?"
        ]
    if path is None:
        return []
    antenna = path if gps.mounting is None else Trajectory(path.t_s, gps.mounting.body_poses(path.poses))
    clock = check_position_clock(gps.believed, antenna)
    if not clock.is_off:
        return []
    sensors.move_stamps([gps.name], clock.offset_s)
    told = clock_text(clock.offset_s, clock.sigma_s, "that of odometer and gyroscope")
    return [f"{gps.name}: {told}: {clock.offset_s:.2f} s are to be added to its stamps"]


def _turns_with_its_way(gps: Gps, turns: Sequence[Turn]) -> bool:
    """Whether the camera looks the same way along its path throughout, or this is not known.

    One on a drone turns about itself, and one that goes to and fro does not: its turns say nothing of bends.
    """
    known = [turn.direction for turn in turns if not np.isnan(turn.direction).any()]
    if not known:
        return True
    mean = np.mean(known, axis=0)
    level = mean - (mean @ gps.up_in_camera) * gps.up_in_camera
    return bool(np.linalg.norm(level) >= _LEAST_STEADY)


def _keyframe_rotations(world: WorldMap, sensors: SensorSuite) -> Trajectory:
    """Rotations of the keyframes by pairs of images, else by a gyroscope, else by the map."""
    rotations = {(turn.start_s, turn.end_s): turn.rotation for turn in sensors.turns}
    steps = []
    for before, after in pairwise(world.keyframes):
        turn = rotations.get((before.t_s, after.t_s))
        if turn is None:
            turn = sensors.rotation(before.t_s, after.t_s)
        mapped = before.pose[:, :3].T @ after.pose[:, :3]
        steps.append(np.column_stack([mapped if turn is None else turn, np.zeros(3)]))
    return Trajectory(np.array([keyframe.t_s for keyframe in world.keyframes]), _poses_of_steps(steps))


def _dead_reckoned_path(times: Sequence[float], sensors: SensorSuite) -> Trajectory | None:
    """Path of the camera by odometer and gyroscope, on the longest stretch with both; None without both."""
    odometer = next((s for s in sensors.of_type(Odometer) if s.mounting is not None), None)
    gyro = next(iter(sensors.of_type(Gyroscope)), None)
    if odometer is None or gyro is None:
        return None
    steps = [_relative_pose(odometer, gyro, *span) for span in pairwise(times)]
    missing = [-1, *(k for k, step in enumerate(steps) if step is None), len(steps)]
    before, end = max(pairwise(missing), key=lambda span: span[1] - span[0])
    poses = _poses_of_steps([step for step in steps[before + 1 : end] if step is not None])
    return Trajectory(np.array(times[before + 1 : end + 1]), poses)


def _poses_of_steps(steps: Sequence[FloatArray]) -> FloatArray:
    """Poses (n + 1, 3, 4) along steps (3, 4), each in the axes of the pose before it."""
    poses = [np.eye(3, 4)[None]]
    for step in steps:
        poses.append(composed(poses[-1], step[None]))
    return np.concatenate(poses)


def _relative_pose(odometer: Odometer, gyro: Gyroscope, start_s: float, end_s: float) -> FloatArray | None:
    """Pose (3, 4) start_from_end of the camera; None where either measurement is missing or doubtful."""
    turn = gyro.between(start_s, end_s)
    if turn is None or odometer.between(start_s, end_s) is None:
        return None
    step = odometer.step(start_s, end_s, turn)
    return None if step is None else np.column_stack([turn, step])
