"""Positions whose axes are mirrored, or whose clock is off, are told by the end of a run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting, Turn, pose_stream_values
from sfmcpp.slam import Gps, Gyroscope, MotionSensor, Odometer, SlamResult, TrackSequence, run_slam
from sfmcpp.slam.check_positions import _dead_reckoned_path, check_positions
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.sources.synthetic import SyntheticDrive, vehicle_drive
from sfmcpp.study.evaluation import evaluate

TURNED = so3.exp(np.array([0.0, 0.0, 0.6]))


@cache
def drive() -> SyntheticDrive:
    return vehicle_drive(seed=511, frame_hz=5.0)


def mounting() -> Mounting:
    return Mounting(drive().camera_from_body, drive().lever_arm_m)


def gps(late_s: float = 0.0) -> Gps:
    body = pose_stream_values(mounting().body_poses(drive().truth.poses))[:, :3]
    fixes = body @ TURNED.T + np.random.default_rng(0).normal(size=body.shape)
    return Gps(SensorStream(drive().truth.t_s + late_s, fixes, "position"), mounting())


def mirrored() -> Gps:
    correct = gps()
    swapped = correct.stream.values[:, [1, 0, 2]]
    return replace(correct, stream=SensorStream(correct.stream.t_s, swapped, "position"))


def run(*sensors: MotionSensor) -> SlamResult:
    seen = drive()
    source = TrackSequence(seen.t_s, seen.frame_index, seen.track_index, seen.pixels, seen.intrinsics)
    return run_slam(source, sensors=sensors)


def of_motion() -> tuple[MotionSensor, ...]:
    assert drive().odometer is not None
    gyro = Gyroscope(drive().angular_rate, mounting())
    return Odometer(drive().odometer, mounting=mounting()), gyro


def error_m(result: SlamResult) -> float:
    return evaluate(result.trajectory(), drive().truth, with_scale=False).mean_3d_error_m


def test_the_path_without_images_goes_over_leaps_of_the_speed_by_inertia() -> None:
    odometer, gyro = of_motion()
    assert isinstance(odometer, Odometer)
    spoiled = odometer.stream.values.copy()
    spoiled[100:110] += 30.0
    leaps = replace(odometer, stream=replace(odometer.stream, values=spoiled))
    assert leaps.carried_stretches
    times = drive().t_s.tolist()
    sound, carried = (_dead_reckoned_path(times, SensorSuite([one, gyro])) for one in (odometer, leaps))
    assert sound is not None
    assert carried is not None
    assert len(carried) == len(sound)
    assert np.abs(carried.centres - sound.centres).max() < 0.5


def test_swapped_axes_are_named_and_correct_ones_are_not() -> None:
    assert any("turns to the other side" in warning for warning in run(mirrored()).warnings)
    assert not any("other side" in warning for warning in run(gps()).warnings)


def test_a_clock_that_is_off_is_told_and_set_right_beside_odometer_and_gyroscope() -> None:
    correct, late = run(gps(), *of_motion()), run(gps(1.0), *of_motion())
    assert not any("its clock" in warning for warning in correct.warnings)
    assert any("gps: its clock is" in warning for warning in late.warnings)
    assert "the run was begun again without what was wrong" in late.warnings
    # With that clock as it is 0.85 m, with the right one 0.14.
    assert error_m(late) < 0.3


def test_a_camera_that_turns_about_itself_says_nothing_of_swapped_axes() -> None:
    """As on a drone: its turns do not tell to which side the way bends."""
    _, gyro = of_motion()
    result = run(mirrored(), gyro)
    suite = SensorSuite([mirrored(), gyro])
    around = np.radians(np.linspace(0.0, 360.0, 40))
    ahead = [Turn(k, k + 1.0, np.eye(3), np.array([0.1, 0.0, 1.0])) for k in range(40)]
    spinning = [
        Turn(k, k + 1.0, np.eye(3), np.array([np.sin(a), 0.0, np.cos(a)])) for k, a in enumerate(around)
    ]
    suite.turns = ahead
    assert any("other side" in told for told in check_positions(result, suite))
    suite.turns = spinning
    assert not any("other side" in told for told in check_positions(result, suite))
