"""Clocks and biases of sensors, estimated from the rotations of images and corrected during a run.

A clock is not the camera's, a gyroscope has a bias: half a second or a few degrees per second bend a map
before the run is over, and no weight corrects it, because either the sensor or the images may be right. The
clocks and axes of positions are checked at the end of the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sfmcpp.geometry import relative_pose
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.model.rigs import composed
from sfmcpp.sensors import Turn, camera_displacement, check_bends, check_position_clock
from sfmcpp.sensors.stream import clock_text
from sfmcpp.slam.fusion import presumed_weights
from sfmcpp.slam.motion_sensors import Gps, Gyroscope, MotionSensor, Odometer
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap

# Keyframes after which all frames are asked for clocks, and how many of them at most.
_EVERY, _LOOK_BACK = 8, 128
# Offsets that are tried [s].
_LARGEST_OFFSET_S = 1.0
# Less parallax does not tell a motion from a turn [px].
_LEAST_PARALLAX_PX = 0.3


def calibrate(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Correct the clock and the bias of a gyroscope, and of streams with its stamps, as soon as images allow.

    What sensors have said of the keyframes so far they say again, with the weights of their declared σ.

    Parameters
    ----------
    result : SlamResult
        The run so far; its keyframes get new constraints, and `warnings` a sentence of a clock.
    sensors : SensorSuite
        Whose clocks and biases are corrected.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing.
    """
    world = result.world
    if world is None or not settings.trusts_declared:
        return
    has_changed = remove_biases(world.keyframes, world.intrinsics[0], sensors, settings)
    if not sensors.in_time:
        has_changed |= _set_clocks(result, sensors)
    if has_changed:
        _renew_constraints(result, sensors)


def _set_clocks(result: SlamResult, sensors: SensorSuite) -> bool:
    """Whether a clock was set: by pairs of images, and every few keyframes by all frames."""
    world = result.world
    assert world is not None
    warnings = sensors.set_clocks(None, _LARGEST_OFFSET_S)
    if not warnings and not sensors.in_time and len(world.keyframes) % _EVERY == 0:
        first = world.keyframes[-1].frame - _LOOK_BACK
        warnings = sensors.set_clocks(result.seen_trajectory(first), _LARGEST_OFFSET_S)
    result.warnings += warnings
    return bool(warnings)


def remove_biases(
    images: Sequence[Frame | Keyframe], intrinsics: FloatArray, sensors: SensorSuite, settings: SlamSettings
) -> bool:
    """Subtract from rates the bias that new images show.

    Parameters
    ----------
    images : sequence of Frame or Keyframe
        In the order of time.
    intrinsics : (5,) or (12,) float64
        Of the camera.
    sensors : SensorSuite
        Whose rates are corrected.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing.

    Returns
    -------
    bool
        Whether any rates have changed.
    """
    fresh = [image for image in images if image.t_s >= sensors.turns_until_s]
    if len(fresh) < 2 or not sensors.compares_pairs or not settings.trusts_declared:
        return False
    turns = [
        _rotation_between_images(before, after, intrinsics, settings) for before, after in pairwise(fresh)
    ]
    return sensors.remove_biases([turn for turn in turns if turn is not None], fresh[-1].t_s)


def _rotation_between_images(
    before: Frame | Keyframe, after: Frame | Keyframe, intrinsics: FloatArray, settings: SlamSettings
) -> Turn | None:
    """Relative motion of two images; None where it is undetermined or ambiguous."""
    in_before, in_after = common(before.view, after.view)
    found = relative_pose(
        before.view.pixels[in_before],
        after.view.pixels[in_after],
        intrinsics,
        min_parallax_px=_LEAST_PARALLAX_PX,
        max_iterations=1000,
        seed=settings.seed,
    )
    motion = found.camera[:, :3], found.camera[:, 3]
    return Turn(before.t_s, after.t_s, *motion) if found.success else None


def _renew_constraints(result: SlamResult, sensors: SensorSuite) -> None:
    """Measure all constraints of the keyframes again, with the corrected sensors."""
    world = result.world
    assert world is not None
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=result.metric)
        keyframe.constraints = presumed_weights(world, keyframe, before, measured)


def check_positions(result: SlamResult, sensors: SensorSuite) -> list[str]:
    """Find faults of positions as a whole, and correct their clocks.

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
    seen = _keyframe_rotations(world, sensors)
    path = _dead_reckoned_path(list(result.path.times.values()), sensors.sensors)
    return [doubt for gps in gpses for doubt in _position_faults(gps, seen, path, sensors)]


def _position_faults(gps: Gps, seen: Trajectory, path: Trajectory | None, sensors: SensorSuite) -> list[str]:
    bends = check_bends(gps.believed, seen, gps.up_in_camera, gps.likely_sigma_m)
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
    told = clock_text(clock.offset_s, clock.sigma_s, "that of odometer and gyroscope")
    return [f"{gps.name}: {told}: {clock.offset_s:.2f} s are to be added to its stamps"]


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


def _dead_reckoned_path(times: Sequence[float], sensors: Sequence[MotionSensor]) -> Trajectory | None:
    """Path of the camera by odometer and gyroscope, on the longest stretch with both; None without both."""
    odometer = next((s for s in sensors if isinstance(s, Odometer) and s.mounting is not None), None)
    gyro = next((s for s in sensors if isinstance(s, Gyroscope)), None)
    if odometer is None or gyro is None:
        return None
    steps = [_relative_pose(odometer, gyro, *span) for span in pairwise(times)]
    lost = [-1, *(k for k, step in enumerate(steps) if step is None), len(steps)]
    before, end = max(pairwise(lost), key=lambda span: span[1] - span[0])
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
    if turn is None or odometer.mounting is None or odometer.between(start_s, end_s) is None:
        return None
    step = camera_displacement(odometer.stream, start_s, end_s, odometer.mounting, turn)
    return None if step is None else np.column_stack([turn, step])
