"""A camera that stands still tells the bias of a gyroscope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.frames import Frame, View
from sfmcpp.sensors import RateBias
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, TrackSequence, rate_biases, run_slam
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.standstill import Standstill, stands_still
from slam_helpers import INTRINSICS, STEP_S, project
from winding import AT_CAMERA, SENSOR_S, Winding, speed, winding, yaw_rate

BIAS_RAD_S = np.radians([0.2, 0.4, -0.2])
PAUSE = 15


def view(rotation: tuple[float, float, float] = (0, 0, 0), step: float = 0.0, seed: int = 0) -> View:
    """Eighty points, with half a pixel of noise, of a camera that has turned [mrad] and driven ahead [m]."""
    points = np.random.default_rng(9).uniform([-6, -4, 8], [6, 4, 30], (80, 3))
    turn = Rotation.from_rotvec(1e-3 * np.array(rotation)).as_matrix()
    pixels = project(np.column_stack([turn, [0.0, 0.0, step]]), points)
    return View(np.arange(80), pixels + np.random.default_rng(seed).normal(0, 0.5, pixels.shape))


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_is_no_motion(seed: int) -> None:
    assert stands_still(Frame(0, 0.0, view()), Frame(1, 1.0, view(seed=seed)))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("seed", range(1, 4))
def test_a_small_rotation_is_one(axis: int, seed: int) -> None:
    turned = [0.0, 0.0, 0.0]
    turned[axis] = 2.0 if axis < 2 else 4.0
    after = view((turned[0], turned[1], turned[2]), seed=seed)
    assert not stands_still(Frame(0, 0.0, view()), Frame(1, 1.0, after))


def test_a_step_is_one() -> None:
    assert not stands_still(Frame(0, 0.0, view()), Frame(1, 1.0, view(step=0.5, seed=1)))


def test_traffic_before_a_camera_that_stands_is_none() -> None:
    moved = view(seed=1)
    moved.pixels[:25] += np.random.default_rng(2).uniform(5, 30, (25, 2))
    assert stands_still(Frame(0, 0.0, view()), Frame(1, 1.0, moved))


def test_a_rest_ends_with_the_last_frame_that_stands() -> None:
    found = Standstill()
    frames = [view(seed=k) for k in range(12)] + [view((5 * k, 0, 0), seed=k) for k in range(1, 4)]
    rests = [found.take(Frame(k, 0.1 * k, seen)) for k, seen in enumerate(frames)]
    (rest,) = [rest for rest in rests if rest is not None]
    assert (rest.start_s, rest.end_s) == pytest.approx((0.0, 1.1))
    assert found.take(None) is None


def test_a_rest_goes_on_to_the_end() -> None:
    found = Standstill()
    assert [found.take(Frame(k, 0.2 * k, view(seed=k))) for k in range(8)] == [None] * 8
    rest = found.take(None)
    assert rest is not None
    assert rest.end_s == pytest.approx(1.4)


@cache
def with_pauses(*pauses: int) -> Winding:
    """The winding road, on which the vehicle stops dead for a second and a half at some frames."""
    drive = winding()
    frames = [k for frame in range(len(drive.truth)) for k in [frame] * (1 + PAUSE * (frame in pauses))]
    rng, source = np.random.default_rng(3), list(drive.sequence)
    tracks = [source[k].view.tracks for k in frames]
    seen = [source[k].view.pixels + rng.normal(0, 0.5, source[k].view.pixels.shape) for k in frames]
    t_s = STEP_S * np.arange(len(frames))
    number = np.repeat(np.arange(len(frames)), [len(t) for t in tracks])
    ticks = np.arange(0.0, t_s[-1] + SENSOR_S, SENSOR_S)
    on_road_s = np.interp(ticks, t_s, STEP_S * np.array(frames))
    goes = np.interp(ticks + SENSOR_S, t_s, STEP_S * np.array(frames)) > on_road_s
    turning = (goes * yaw_rate(on_road_s))[:, None] * [0.0, 1.0, 0.0]
    return Winding(
        TrackSequence(t_s, number, np.concatenate(tracks), np.concatenate(seen), INTRINSICS),
        drive.truth[frames],
        SensorStream(ticks, goes * speed(on_road_s), "speed", "odometer"),
        SensorStream(ticks, turning, "angular_rate", "gyro"),
    )


def biased(drive: Winding) -> list[MotionSensor]:
    return [Gyroscope(replace(drive.gyro, values=drive.gyro.values + BIAS_RAD_S), AT_CAMERA)]


@pytest.mark.parametrize("pauses", [(0,), (50,), (0, 99)])
def test_a_small_bias_is_removed_where_the_camera_stands(pauses: tuple[int, ...]) -> None:
    drive = with_pauses(*pauses)
    right = run_slam(drive.sequence, sensors=[Gyroscope(drive.gyro, AT_CAMERA)])
    mended = run_slam(drive.sequence, sensors=biased(drive))
    assert "gyro: a bias of 0.5°/s is removed from its rates" in mended.warnings
    assert not any("bias" in told for told in right.warnings)
    # Before the map began nothing can have been bent.
    assert ("the run was begun again without what was wrong" in mended.warnings) == (0 not in pauses)
    assert drive.errors(mended)[1] < drive.errors(right)[1] + np.radians(0.1)


def test_a_gyroscope_that_had_a_bias_is_less_certain() -> None:
    drive = with_pauses(0)
    suites = [SensorSuite(sensors) for sensors in (biased(drive), [Gyroscope(drive.gyro, AT_CAMERA)])]
    for frame in list(drive.sequence)[: PAUSE + 5]:
        for suite in suites:
            suite.rests_before(frame)
    with_bias, without = (suite.measure(0.0, 0.5, np.eye(3), metric=False) for suite in suites)
    assert without[0].sigma == pytest.approx(0.001)
    assert with_bias[0].sigma == pytest.approx(np.hypot(0.001, 0.004 * np.sqrt(0.5)))


def test_a_body_that_an_odometer_moves_does_not_rest() -> None:
    """Behind a lorry that fills the image."""
    drive = with_pauses(0)
    driving = replace(drive.odometer, values=drive.odometer.values + 3.0)
    for odometer, rests in ((driving, 0), (drive.odometer, 1)):
        suite = SensorSuite([Odometer(odometer), *biased(drive)])
        for frame in list(drive.sequence)[: PAUSE + 5]:
            suite.rests_before(frame)
        assert len(suite.biases.rests) == rests


def test_rests_are_looked_at_again_only_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not at each keyframe: a drive of an hour has stopped fifty times, and has as many samples as frames."""
    looks = []
    known = rate_biases.bias_at_rest

    def noted(stream: SensorStream, rests: Sequence[Gap]) -> RateBias | None:
        looks.append(len(rests))
        return known(stream, rests)

    monkeypatch.setattr(rate_biases, "bias_at_rest", noted)
    t_s = 0.01 * np.arange(1000)
    rates = SensorStream(t_s, np.tile(BIAS_RAD_S, (1000, 1)), "angular_rate")
    suite = SensorSuite([Gyroscope(rates, AT_CAMERA)])
    for keyframe in range(5):
        suite.remove_biases([], float(keyframe))
    assert looks == [0]
    suite.biases.rests.append(Gap(1.0, 3.0))
    for keyframe in range(5, 10):
        suite.remove_biases([], float(keyframe))
    assert looks == [0, 1, 1]  # once more for the rates without what it has found
    np.testing.assert_allclose(suite.biases.known["gyro"].rates_rad_s[0], BIAS_RAD_S)
