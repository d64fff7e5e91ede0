"""Rotations that a gyroscope tells, from the first frame on: taken where the images support them."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.frames import Frame
from sfmcpp.slam import Gyroscope, Odometer, SlamSettings, TrackSequence, WorldMap, run_slam
from sfmcpp.slam.initialisation import Initialiser
from sfmcpp.slam.localisation import expected_rotation, locate
from sfmcpp.slam.sensor_suite import SensorSuite
from slam_helpers import INTRINSICS, STEP_S, drive, path
from winding import AT_CAMERA, winding

FRAMES = 16
TURN_RAD_S = 0.05
FEW, MANY = 24, 200
STEP_M = 0.1


def tracks_of(count: int) -> TrackSequence:
    """A camera that goes aside and turns a little: of few tracks a turn alone explains almost as much."""
    aside = np.arange(FRAMES)[:, None] * [STEP_M if count == FEW else 3 * STEP_M, 0.0, 0.02]
    turns = np.arange(FRAMES)[:, None] * [0.0, TURN_RAD_S * STEP_S, 0.0]
    return drive(path(aside, turns), sigma_px=0.3, points=count, seed=3)


def gyro(bias_rad_s: float = 0.0) -> SensorSuite:
    t_s = np.arange(0.0, 3.0, STEP_S / 2)
    rates = np.tile([0.0, TURN_RAD_S + bias_rad_s, 0.0], (len(t_s), 1))
    return SensorSuite([Gyroscope(SensorStream(t_s, rates, "angular_rate"), AT_CAMERA)])


def started(sensors: SensorSuite, count: int = FEW) -> tuple[WorldMap | None, int, list[str]]:
    """The map, the frame that made it, and why there was none before."""
    initialiser = Initialiser(INTRINSICS, SlamSettings(), sensors)
    reasons = []
    frames = list(tracks_of(count))
    # Of many tracks none before a start can be made: what is not made then is the gyroscope's.
    for frame in frames if count == FEW else frames[:2] + frames[5:]:
        world = initialiser.try_frame(frame)
        if world is not None:
            return world, frame.number, reasons
        reasons.append(initialiser.reason)
    return None, FRAMES, reasons


def turn_error_rad(world: WorldMap) -> float:
    first, last = world.keyframes[0], world.keyframes[-1]
    true = so3.exp(np.array([0.0, TURN_RAD_S * (last.t_s - first.t_s), 0.0]))
    return float(so3.rotation_angle(true.T @ first.pose[:, :3].T @ last.pose[:, :3]))


def test_a_start_is_made_where_the_images_alone_see_a_turn() -> None:
    alone, late, _ = started(SensorSuite())
    world, early, _ = started(gyro())
    assert world is not None
    assert early < late
    assert turn_error_rad(world) < 0.004
    assert alone is None or turn_error_rad(world) < turn_error_rad(alone)
    assert all(k.constraints[0].measurement.sensor == "gyro" for k in world.keyframes[1:])


def test_a_start_against_a_gyroscope_waits_and_says_why_but_not_for_ever() -> None:
    alone, frame, _ = started(SensorSuite(), MANY)
    world, late, reasons = started(gyro(bias_rad_s=1.5), MANY)
    assert alone is not None
    assert world is not None
    assert late > frame
    assert any("from the gyroscope" in reason for reason in reasons)
    assert turn_error_rad(world) < 0.01
    assert not any(k.constraints for k in world.keyframes)


def test_a_turn_that_inliers_bear_but_their_errors_do_not_makes_no_start() -> None:
    """Where the view is narrow, a step aside stands for a turn of a degree within the threshold."""
    world, _, reasons = started(gyro(bias_rad_s=0.05), MANY)
    assert any("contradict the rotations" in reason for reason in reasons)
    assert world is not None
    assert turn_error_rad(world) < 0.002


@pytest.mark.parametrize(("bias_rad_s", "kept"), [(0.0, True), (0.5, False)])
def test_the_turn_of_a_gyroscope_is_kept_where_the_images_support_it(bias_rad_s: float, kept: bool) -> None:
    world, number, _ = started(gyro())
    assert world is not None
    frame = list(tracks_of(FEW))[number + 1]
    told = expected_rotation(world, gyro(bias_rad_s), frame.t_s)
    assert told is not None
    found = locate(world, frame.view, SlamSettings(), told)
    assert found is not None
    assert found.seen is not None
    assert np.array_equal(found.pose[:, :3], told) == kept
    assert np.array_equal(found.pose, found.seen) != kept


def test_exact_tracks_and_rates_start_a_map() -> None:
    """Of exact tracks any rotation but the very best raises the cost by many times what it is."""
    exact = winding(sigma_px=0.0)
    result = run_slam(exact.sequence, sensors=[Gyroscope(exact.gyro, AT_CAMERA)])
    assert sorted(result.poses) == list(range(len(exact.sequence)))
    assert exact.errors(result)[0] < 0.01


def test_a_run_without_a_map_is_begun_without_a_gyroscope(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drive, try_frame = winding(), Initialiser.try_frame

    def try_without_gyroscope(self: Initialiser, frame: Frame) -> WorldMap | None:
        return None if self._sensors.of_type(Gyroscope) else try_frame(self, frame)

    monkeypatch.setattr(Initialiser, "try_frame", try_without_gyroscope)
    sensors = [Gyroscope(drive.gyro, AT_CAMERA), Odometer(drive.odometer)]
    mended, alone = (run_slam(drive.sequence, sensors=some) for some in (sensors, sensors[1:]))
    assert mended.warnings == [
        "gyro: no map can be started with it, but without: check its axes, unit and clock",
        "the run was begun again without what was wrong",
    ]
    np.testing.assert_array_equal(mended.trajectory().poses, alone.trajectory().poses)
    once = run_slam(drive.sequence, SlamSettings(hindsight=False), sensors)
    assert once.world is None
    assert once.warnings == []
