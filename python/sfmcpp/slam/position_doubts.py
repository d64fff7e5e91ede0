"""What a whole run tells of its positions: mirrored axes, and another clock, which is set right."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.rigs import composed
from sfmcpp.sensors import camera_displacement, check_bends, check_position_clock
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensing import Gps, Gyroscope, MotionSensor, Odometer
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WorldMap


def doubt_positions(result: SlamResult, sensors: SensorSuite) -> list[str]:
    """Tell what is wrong with positions as a whole, and set their clocks.

    Bends are judged by the rotations of pairs of images, and the clock by an odometer and a gyroscope, as
    the map has followed the positions.

    Parameters
    ----------
    result : SlamResult
        The run, over all frames.
    sensors : SensorSuite
        Its sensors as they are at its end; stamps of positions that are off are moved.

    Returns
    -------
    list of str
        A sentence for each fault.
    """
    world = result.world
    gpses = [sensor for sensor in sensors.sensors if isinstance(sensor, Gps)]
    if world is None or not gpses:
        return []
    seen = _seen(world, sensors)
    path = _reckoned(list(result.path.times.values()), sensors.sensors)
    return [doubt for gps in gpses for doubt in _doubts(gps, seen, path, sensors)]


def _doubts(gps: Gps, seen: Trajectory, path: Trajectory | None, sensors: SensorSuite) -> list[str]:
    bends = check_bends(gps.believed, seen, gps.up_in_camera, gps.sigma_m or 1.0)
    if bends.is_mirrored:
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
    side = "behind" if clock.offset_s > 0 else "ahead of"
    return [
        f"{gps.name}: its clock is {abs(clock.offset_s):.2f} ± {clock.sigma_s:.2f} s {side} that of odometer "
        f"and gyroscope: {clock.offset_s:.2f} s are to be added to its stamps"
    ]


def _seen(world: WorldMap, sensors: SensorSuite) -> Trajectory:
    """Rotations of the keyframes by pairs of images, else by a gyroscope, else by the map."""
    told = {(turn.start_s, turn.end_s): turn.rotation for turn in sensors.turns}
    steps = []
    for before, after in pairwise(world.keyframes):
        turn = told.get((before.t_s, after.t_s))
        if turn is None:
            turn = sensors.rotation(before.t_s, after.t_s)
        mapped = before.pose[:, :3].T @ after.pose[:, :3]
        steps.append(np.column_stack([mapped if turn is None else turn, np.zeros(3)]))
    return Trajectory(np.array([keyframe.t_s for keyframe in world.keyframes]), _chained(steps))


def _reckoned(times: Sequence[float], sensors: Sequence[MotionSensor]) -> Trajectory | None:
    """The camera's way by odometer and gyroscope, the longest stretch that both tell; None without both."""
    odometer = next((s for s in sensors if isinstance(s, Odometer) and s.mounting is not None), None)
    gyro = next((s for s in sensors if isinstance(s, Gyroscope)), None)
    if odometer is None or gyro is None:
        return None
    steps = [_step(odometer, gyro, *span) for span in pairwise(times)]
    lost = [-1, *(k for k, step in enumerate(steps) if step is None), len(steps)]
    before, end = max(pairwise(lost), key=lambda span: span[1] - span[0])
    poses = _chained([step for step in steps[before + 1 : end] if step is not None])
    return Trajectory(np.array(times[before + 1 : end + 1]), poses)


def _chained(steps: Sequence[FloatArray]) -> FloatArray:
    """Poses (n + 1, 3, 4) along steps (3, 4), each in the axes of the pose before it."""
    poses = [np.eye(3, 4)[None]]
    for step in steps:
        poses.append(composed(poses[-1], step[None]))
    return np.concatenate(poses)


def _step(odometer: Odometer, gyro: Gyroscope, start_s: float, end_s: float) -> FloatArray | None:
    """Pose (3, 4) start_from_end of the camera; None where one of them tells nothing, or nothing certain."""
    turn = gyro.between(start_s, end_s)
    if turn is None or odometer.mounting is None or odometer.between(start_s, end_s) is None:
        return None
    step = camera_displacement(odometer.stream, start_s, end_s, odometer.mounting, turn)
    return None if step is None else np.column_stack([turn, step])
