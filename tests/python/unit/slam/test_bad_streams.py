"""The whole loop with streams that have gaps, start late, or tell of another motion than they say."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream, Trajectory, check_rotations
from sfmcpp.slam import (
    Gyroscope,
    MotionSensor,
    Odometer,
    Slam,
    SlamResult,
    SlamSettings,
    TrackSequence,
    run,
    run_slam,
    sensor_suite,
)
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.sources.drives import Drive, tracks_of_kitti
from sfmcpp.sources.io.kitti_mat import read_kitti_mat
from slam_helpers import STEP_S
from winding import AT_CAMERA, FRAMES, length, sound_run, winding, without

SEEDS = (0, 1)
SHORT_GAPS = ((4.0, 4.07), (6.0, 6.07))
LONG_GAP = (3.0, 6.0)
# A gap longer than is bridged touches every interval between keyframes.
GAPS_EVERYWHERE = tuple((start, start + 0.2) for start in np.arange(-0.1, 11.0, 0.3))
Spoiled = Callable[[SensorStream], SensorStream]


def with_odometer(seed: int, stream: SensorStream) -> SlamResult:
    return run_slam(winding(seed=seed).sequence, sensors=[Odometer(stream)])


def with_gyro(seed: int, stream: SensorStream, mounting: Mounting = AT_CAMERA) -> SlamResult:
    return run_slam(winding(seed=seed).sequence, sensors=[Gyroscope(stream, mounting)])


def require_all_frames(result: SlamResult) -> None:
    assert sorted(result.poses) == list(range(FRAMES))
    assert result.lost == []


def intervals(result: SlamResult) -> list[tuple[float, float]]:
    """From the keyframe before to each one that has a record."""
    assert result.world is not None
    return list(pairwise(keyframe.t_s for keyframe in result.world.keyframes))[-len(result.records) :]


def require_same_poses(one: SlamResult, other: SlamResult) -> None:
    np.testing.assert_array_equal(one.trajectory().poses, other.trajectory().poses)


@pytest.mark.parametrize("seed", SEEDS)
def test_short_gaps_are_bridged(seed: int) -> None:
    drive = winding(seed=seed)
    gappy, whole = with_gyro(seed, without(drive.gyro, *SHORT_GAPS)), sound_run("gyro", seed=seed)
    require_all_frames(gappy)
    assert all("gyro" in record.weights for record in gappy.records)
    assert drive.errors(gappy)[0] < 1.1 * drive.errors(whole)[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_long_gap_gives_no_constraint_and_costs_little(seed: int) -> None:
    """Less than a tenth more than the worse of two runs: without the sensor, and with all of it."""
    drive = winding(seed=seed)
    result = with_gyro(seed, without(drive.gyro, LONG_GAP))
    require_all_frames(result)
    touched = [start < LONG_GAP[1] and end > LONG_GAP[0] for start, end in intervals(result)]
    assert any(touched)
    assert ["gyro" not in record.weights for record in result.records] == touched
    worse = max(drive.errors(other)[0] for other in (sound_run(seed=seed), sound_run("gyro", seed=seed)))
    assert drive.errors(result)[0] < 1.1 * worse


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("gap", [(3.0, 4.0), (-1.0, 0.3), (8.0, 20.0)])
def test_an_odometer_with_a_gap_still_makes_the_map_metric(seed: int, gap: tuple[float, float]) -> None:
    drive = winding(seed=seed)
    result = with_odometer(seed, without(drive.odometer, gap))
    require_all_frames(result)
    assert result.metric
    assert drive.length_ratio(result) == pytest.approx(1.0, abs=0.015)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sensor_that_covers_no_interval_changes_no_bit(seed: int) -> None:
    drive = winding(seed=seed)
    # A counted way: over gaps of speeds it would interpolate.
    way = np.cumsum(np.linalg.norm(drive.odometer.values, axis=1)) * drive.odometer.period_s
    counted = SensorStream(drive.odometer.t_s, way, "distance")
    gaps, another_day = without(counted, *GAPS_EVERYWHERE), drive.gyro.shifted(86_400.0)
    sensors = [Odometer(gaps), Gyroscope(another_day, AT_CAMERA)]
    result = run_slam(drive.sequence, sensors=sensors)
    assert not result.metric
    assert all(record.weights == {} for record in result.records)
    require_same_poses(result, sound_run(seed=seed))


def test_a_rate_that_leaps_away_and_back_is_told_and_costs_nothing() -> None:
    drive = winding(seed=0)
    values = drive.gyro.values.copy()
    values[len(values) // 2] += [0.0, 3.0, 0.0]
    correct = sound_run("odometer", "gyro")
    spiked = Gyroscope(replace(drive.gyro, values=values), AT_CAMERA)
    result = run_slam(drive.sequence, sensors=[Odometer(drive.odometer), spiked])
    assert [w for w in result.warnings if "1 of" in w and "leap away and back within a sample" in w]
    assert drive.errors(result)[0] < 1.05 * drive.errors(correct)[0] + 0.01


@pytest.mark.parametrize(
    ("spoil", "mounting", "told"),
    [
        (lambda s: replace(s, values=np.rad2deg(s.values)), AT_CAMERA, "degrees declared as radians"),
        (lambda s: replace(s, values=np.deg2rad(s.values)), AT_CAMERA, "radians declared as degrees"),
        (lambda s: s, Mounting.forward_looking(), "check the declared axes, mounting and unit"),
    ],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_gyro_that_is_wrong_all_along_is_in_conflict_and_told(
    seed: int, spoil: Spoiled, mounting: Mounting, told: str
) -> None:
    drive = winding(seed=seed)
    stream = spoil(drive.gyro)
    result = run_slam(drive.sequence, SlamSettings(hindsight=False), [Gyroscope(stream, mounting)])
    require_all_frames(result)
    conflicts = [record.conflicts["gyro"] for record in result.records if "gyro" in record.conflicts]
    assert np.median(conflicts) > 10
    complaint = check_rotations(stream, mounting, result.trajectory()).complaint("imu")
    assert re.match(rf"imu: .*{told}", complaint)
    assert drive.errors(result)[0] < 0.02 * length(drive.truth)


CLOCKS = [(0.3, "ahead of"), (-0.6, "behind")]


def require_clock_set_right(result: SlamResult, seed: int, sensors: str, side: str) -> None:
    pattern = rf"{sensors}: its clock is 0\.\d\d ± 0\.0\d s {side} the camera's: -?0\.\d\d s are added"
    assert re.match(pattern, result.warnings[0])
    require_all_frames(result)
    drive = winding(seed=seed)
    assert drive.errors(result)[0] < 1.5 * drive.errors(sound_run("odometer", "gyro", seed=seed))[0]


@pytest.mark.parametrize(("late_s", "side"), CLOCKS)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_clock_that_is_wrong_is_set_right_and_told(seed: int, late_s: float, side: str) -> None:
    """The odometer, whose stamps are the gyroscope's, is moved with it."""
    drive = winding(seed=seed)
    late = [Odometer(drive.odometer.shifted(late_s)), Gyroscope(drive.gyro.shifted(late_s), AT_CAMERA)]
    require_clock_set_right(run_slam(drive.sequence, sensors=late), seed, "odometer and gyro", side)


@pytest.mark.parametrize(("seed", "late_s", "side"), [(seed, *CLOCKS[seed]) for seed in SEEDS])
def test_an_odometer_with_stamps_of_its_own_keeps_them(seed: int, late_s: float, side: str) -> None:
    drive = winding(seed=seed)
    own = Odometer(replace(drive.odometer, t_s=drive.odometer.t_s + 1e-4))
    late = Gyroscope(drive.gyro.shifted(late_s), AT_CAMERA)
    require_clock_set_right(run_slam(drive.sequence, sensors=[own, late]), seed, "gyro", side)


def test_a_clock_is_not_set_where_weights_have_no_bounds() -> None:
    drive = winding(seed=0)
    late = [Odometer(drive.odometer.shifted(0.3)), Gyroscope(drive.gyro.shifted(0.3), AT_CAMERA)]
    plain = run_slam(drive.sequence, SlamSettings(weight_bounds="none"), late)
    assert not any("are added" in warning for warning in plain.warnings)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_gyro_that_is_right_agrees_and_nothing_is_told(seed: int) -> None:
    drive = winding(seed=seed)
    result = sound_run("gyro", seed=seed)
    assert np.median([record.conflicts["gyro"] for record in result.records]) < 1
    check = check_rotations(drive.gyro, AT_CAMERA, result.trajectory())
    assert check.is_determined
    assert abs(check.offset_s) < 3 * check.sigma_s
    assert check.complaint("imu") == ""


def sequence_of(drive_path: Path) -> tuple[TrackSequence, SensorStream, Mounting]:
    drive = read_kitti_mat(drive_path)
    return tracks_of_kitti(drive), drive.angular_rate, Mounting(drive.camera_from_body, drive.lever_arm_m)


@pytest.mark.real
@pytest.mark.parametrize("name", ["0005", "0095"])
def test_the_clock_of_a_real_gyro_is_found_after_a_run_in_which_it_took_part(
    data_dir: Path, name: str
) -> None:
    """The gyro of these drives is 0.05 s late by its own truth: passed; 0.3 s more are told."""
    sequence, rate, mounting = sequence_of(data_dir / f"kitti_tracks/2011_09_26_drive_{name}_sync_KLT.mat")
    for lag_s, side in ((0.0, ""), (0.3, "s ahead of the camera's")):
        stream = rate.shifted(lag_s)
        sensors: list[MotionSensor] = [Gyroscope(stream, mounting)]
        result = run_slam(sequence, sensors=sensors)
        check = check_rotations(stream, mounting, result.seen_trajectory())
        assert check.is_determined
        assert check.offset_s == pytest.approx(-0.05 - lag_s, abs=0.02)
        assert bool(check.complaint("imu")) == bool(side)
        assert side in check.complaint("imu")
        assert any("are added to the stamps" in told for told in result.warnings) == bool(side)


def test_measurements_fed_as_they_come_give_the_same_map() -> None:
    drive = winding(seed=0)
    whole = drive.odometer
    known = sound_run("odometer")
    first = replace(whole, t_s=whole.t_s[:1], values=whole.values[:1])
    online, taken = Slam(drive.sequence.intrinsics, sensors=[Odometer(first)]), 1
    for frame in drive.sequence:
        now = int(np.searchsorted(whole.t_s, frame.t_s, side="right"))
        if now > taken:
            online.feed("odometer", whole.t_s[taken:now], whole.values[taken:now])
            taken = now
        online.step(frame)
    online.finish()
    require_same_poses(online.result, known)
    with pytest.raises(InvalidArgument, match="name = 'gyro': must be one of odometer"):
        online.feed("gyro", whole.t_s, whole.values)


def test_a_stream_is_corrected_where_it_is_asked_for_not_with_every_feed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After an hour of a gyroscope that takes longer than a frame."""
    drive, corrected = winding(seed=0), list[int]()
    gyro, wheel = drive.gyro, drive.odometer
    first = [replace(s, t_s=s.t_s[:2], values=s.values[:2]) for s in (wheel, gyro)]
    suite = SensorSuite([Odometer(first[0]), Gyroscope(first[1], AT_CAMERA)])
    sound = sensor_suite.without_spikes

    def noted(stream: SensorStream) -> SensorStream:
        corrected.append(len(stream))
        return sound(stream)

    monkeypatch.setattr(sensor_suite, "without_spikes", noted)
    for name, stream in (("odometer", wheel), ("gyro", gyro)):
        for k in range(2, 12):
            suite.feed(name, stream.t_s[k : k + 1], stream.values[k : k + 1])
    assert not corrected
    for _ in range(2):
        assert suite.rotation(*gyro.t_s[[2, 11]]) is not None
    assert corrected == [12]


def test_an_odometer_that_tells_no_motion_is_named() -> None:
    drive = winding(seed=0)
    dead = replace(drive.odometer, values=np.zeros_like(drive.odometer.values))
    result = run_slam(drive.sequence, sensors=[Odometer(dead)])
    assert not result.metric
    assert any(warning.startswith("odometer: measures too little motion") for warning in result.warnings)


def test_gyroscopes_with_the_same_stamps_have_one_clock_and_one_sentence() -> None:
    drive = winding(seed=0)
    late = replace(drive.gyro, t_s=drive.gyro.t_s + 0.3)
    suite = SensorSuite([Gyroscope(late, AT_CAMERA, name) for name in ("one", "other")])
    (told,) = suite.set_clocks(Trajectory(STEP_S * np.arange(FRAMES), drive.truth))
    assert told.startswith("one and other: its clock is 0.30 ± 0.00 s ahead")
    assert suite.moved_s == {name: pytest.approx(-0.3, abs=0.01) for name in ("one", "other")}


def test_a_sensor_of_ones_own_cannot_be_fed() -> None:
    class Own:
        name, stream = "own", SensorStream(np.arange(2.0), np.zeros(2), "speed")

        def measure(self, start_s: float, end_s: float, rotation: np.ndarray) -> None:
            return None

    drive = Slam(winding(seed=0).sequence.intrinsics, sensors=[Own()])
    with pytest.raises(InvalidArgument, match="name = 'own': must be one of no sensor"):
        drive.feed("own", np.array([3.0]), np.array([1.0]))


def test_a_rate_that_is_assumed_is_a_warning_of_a_run_with_sensors(tmp_path: Path) -> None:
    there = winding()
    short = there.sequence
    short.assumed_fps = 10.0
    drive = Drive(tmp_path / "images", short, streams={"speed": there.odometer})
    told = "10 frames per second assumed: neither times.txt nor --fps is given; where that is wrong, so are"

    def ends_at_once(frame: int, result: SlamResult) -> bool:
        return False

    warnings = run(drive, ["odometer"], callback=ends_at_once).result.warnings
    assert [warning for warning in warnings if warning.startswith(told)] == [
        f"{told} the scale and the clocks of the sensors"
    ]
    assert run(drive, callback=ends_at_once).result.warnings == []
    short.assumed_fps = None
    assert run(drive, ["odometer"], callback=ends_at_once).result.warnings == []
    late = Drive(tmp_path / "images", short, streams={"speed": there.odometer.shifted(1e6)})
    short.assumed_fps = 10.0
    with pytest.raises(DatasetError, match=r"must overlap; .*; but 10 frames per second assumed"):
        late.streams_of(["odometer"])
    short.assumed_fps = None
    with pytest.raises(DatasetError, match=r"lets them start together$"):
        late.streams_of(["odometer"])
