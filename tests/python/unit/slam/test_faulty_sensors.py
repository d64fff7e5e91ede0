"""A sensor that is wrong for a while gets small weights there, is named, and does little harm."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.model import Gap, SensorStream
from sfmcpp.sensors import Mounting
from sfmcpp.slam import (
    Gyroscope,
    Odometer,
    Slam,
    SlamResult,
    SlamSettings,
    run_slam,
    sensor_faults,
)
from sfmcpp.slam.sensor_faults import faults_so_far
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS
from winding import AT_CAMERA, sound_run, winding

# The map takes its scale from the odometer in the five seconds before.
LIE_S = (5.0, 8.8)
# What a sensor is given while it is wrong is gone from a run that is begun again.
ONCE = SlamSettings(hindsight=False)


def faulty(stream: SensorStream, factor: float = 1.0, yaw_rad_s: float = 0.0) -> SensorStream:
    values = stream.values.copy()
    during = (stream.t_s >= LIE_S[0]) & (stream.t_s < LIE_S[1])
    values[during] *= factor
    if yaw_rad_s:
        values[during, 1] += yaw_rad_s
    return SensorStream(stream.t_s, values, stream.kind, stream.name)


def during(result: SlamResult, name: str, what: str) -> list[float]:
    """Weights or conflicts of a sensor at the keyframes whose interval lies within the fault."""
    times = [record.t_s for record in result.records]
    within = [
        record
        for before, record in zip(times[:-1], result.records[1:], strict=True)
        if before > LIE_S[0] and record.t_s < LIE_S[1]
    ]
    return [getattr(record, what)[name] for record in within if name in getattr(record, what)]


@pytest.mark.parametrize("factor", [1.3, 0.7])
def test_an_odometer_that_leaps_is_carried_by_inertia_until_it_leaps_back(factor: float) -> None:
    drive = winding()
    wrong = Odometer(faulty(drive.odometer, factor))
    alone, correct = sound_run(), sound_run("odometer")
    disturbed = run_slam(drive.sequence, sensors=[wrong])
    assert len(during(disturbed, "odometer", "weights")) >= 3
    assert min(during(disturbed, "odometer", "weights")) > 0
    # What inertia says is less certain.
    assert max(during(disturbed, "odometer", "weights")) < max(during(correct, "odometer", "weights"))
    assert correct.warnings == []
    (told,) = disturbed.warnings
    assert "'odometer'" in told
    assert "jumps" in told
    assert "inertia" in told
    assert drive.errors(disturbed)[0] < 1.2 * drive.errors(alone)[0]
    assert drive.length_ratio(disturbed) == pytest.approx(1, abs=0.05)


def test_an_odometer_that_leaps_and_never_back_has_no_weight() -> None:
    drive = winding()
    values = np.where(drive.odometer.t_s[:, None] < LIE_S[0], 1.0, 1.3) * drive.odometer.values
    disturbed = run_slam(drive.sequence, sensors=[Odometer(replace(drive.odometer, values=values))])
    assert len(during(disturbed, "odometer", "weights")) >= 3
    assert set(during(disturbed, "odometer", "weights")) == {0.0}
    assert "gets no weight" in disturbed.warnings[0]


@pytest.mark.parametrize("since_s", [-1.0, 5.0])
@pytest.mark.parametrize("noise_m_s", [0.0, 0.002])
def test_an_odometer_that_dies_is_named_and_left_out_from_then_on(since_s: float, noise_m_s: float) -> None:
    drive = winding()
    rest = np.abs(np.random.default_rng(0).normal(0, noise_m_s, drive.odometer.values.shape))
    values = np.where(
        drive.odometer.t_s[:, None] < since_s, drive.odometer.values, rest if since_s > 0 else 0
    )
    dead = run_slam(drive.sequence, sensors=[Odometer(replace(drive.odometer, values=values))])
    assert "is it dead?" in " ".join(dead.warnings)
    assert "mounting" not in " ".join(dead.warnings).replace("clock, mounting, unit", "")
    assert drive.errors(dead)[0] < 1.2 * drive.errors(sound_run())[0]


def test_many_stretches_in_which_an_odometer_is_dead_are_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    suite = SensorSuite([Odometer(winding().odometer)])
    gaps = [Gap(10.0 * k, 10.0 * k + (3.0 if k == 2 else 1.0)) for k in range(5)]
    for count, sentences in ((3, 3), (5, 1)):
        monkeypatch.setattr(sensor_faults, "dead_stretches", lambda *_, n=count: tuple(gaps[:n]))
        told = faults_so_far(suite)
        assert len([text for text in told if "is it dead?" in text]) == sentences
    assert (
        "does not move in 5 stretches, first 1.000 s from 0.000 to 1.000 s, "
        "longest 3.000 s from 20.000 to 23.000 s, while"
    ) in told[0]


def test_many_jumps_of_a_speed_are_one_sentence() -> None:
    drive = winding()
    values = drive.odometer.values.copy()
    values[20:400:20] *= 3
    told = Slam(drive.sequence.intrinsics, sensors=[Odometer(replace(drive.odometer, values=values))])
    assert [w for w in told.result.warnings if "jumps" in w] == told.result.warnings
    assert len(told.result.warnings) == 1
    assert re.search(r"in \d\d stretches, first", told.result.warnings[0])


def test_a_faulty_gyro_is_in_conflict_and_its_weight_falls() -> None:
    drive = winding()
    wrong = faulty(drive.gyro, yaw_rad_s=float(np.radians(5)))
    alone, correct = sound_run(hindsight=False), sound_run("gyro", hindsight=False)
    disturbed = run_slam(drive.sequence, ONCE, [Gyroscope(wrong, AT_CAMERA)])
    assert np.median(during(disturbed, "gyro", "conflicts")) > CONFLICT_SIGMAS
    assert np.median(during(correct, "gyro", "conflicts")) < CONFLICT_SIGMAS
    correct_weight = np.median(during(correct, "gyro", "weights"))
    assert np.median(during(disturbed, "gyro", "weights")) < 0.5 * correct_weight
    assert drive.errors(disturbed)[0] < 1.2 * drive.errors(alone)[0]


@pytest.mark.parametrize("seed", range(3))
def test_a_gyro_with_a_bias_is_corrected_and_told(seed: int) -> None:
    """Before the start already: a turn that is off by degrees would be that of the map."""
    drive = winding(seed=seed)
    biased = replace(drive.gyro, values=drive.gyro.values + np.radians([0.0, 5.0, 0.0]))
    correct = sound_run("gyro", seed=seed)
    mended = run_slam(drive.sequence, sensors=[Gyroscope(biased, AT_CAMERA)])
    assert correct.warnings == []
    assert len(mended.poses) == len(correct.poses)
    told, begun_again = mended.warnings
    assert "begun again" in begun_again
    assert re.fullmatch(r"gyro: a bias of (4\.[5-9]|5\.[0-4])°/s is removed from its rates", told)
    assert drive.errors(mended)[1] < drive.errors(correct)[1] + np.radians(1.0)


def test_a_bias_is_not_removed_where_weights_have_no_bounds() -> None:
    drive = winding()
    biased = replace(drive.gyro, values=drive.gyro.values + np.radians([0.0, 5.0, 0.0]))
    plain = run_slam(drive.sequence, SlamSettings(weight_bounds="none"), [Gyroscope(biased, AT_CAMERA)])
    assert not any("bias" in warning for warning in plain.warnings)


def test_a_run_that_finds_a_sensor_wrong_for_a_while_is_begun_again_without_it_there() -> None:
    drive = winding()
    wrong = Gyroscope(faulty(drive.gyro, yaw_rad_s=float(np.radians(15))), AT_CAMERA)
    once, again = (run_slam(drive.sequence, settings, [wrong]) for settings in (ONCE, SlamSettings()))
    assert again.warnings == [*once.warnings, "the run was begun again without what was wrong"]
    assert len(during(once, "gyro", "weights")) >= 3
    assert during(again, "gyro", "weights") == []
    before, after = (
        [r for r in again.records if side(r.t_s)]
        for side in (lambda t_s: t_s < LIE_S[0] - 1, lambda t_s: t_s > LIE_S[1] + 1)
    )
    assert all("gyro" in record.weights for record in [*before, *after])


def test_a_correct_run_is_not_begun_again() -> None:
    once, again = (sound_run("odometer", "gyro", hindsight=hindsight) for hindsight in (False, True))
    assert again.warnings == once.warnings
    np.testing.assert_array_equal(again.trajectory().poses, once.trajectory().poses)


def test_what_does_not_explain_all_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where sensors disagree with the images again, it was the images that were wrong."""
    drive = winding()
    sensors = (Gyroscope(drive.gyro, AT_CAMERA),)
    once = sound_run("gyro", hindsight=False)
    monkeypatch.setattr(Slam, "in_hindsight", lambda self: (Odometer(drive.odometer),))
    kept = run_slam(drive.sequence, SlamSettings(), sensors)
    assert kept.warnings == [*once.warnings, "a run without what was wrong found more, and was not kept"]
    np.testing.assert_array_equal(kept.trajectory().poses, once.trajectory().poses)


def test_a_run_with_a_wrong_mounting_is_not_kept_beside_one_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even if the next run finds something wrong, too."""
    drive = winding()
    wrong = (on_a_turned_camera(drive.odometer, 90.0),)
    once = run_slam(drive.sequence, ONCE, wrong)
    in_hindsight = Slam.in_hindsight
    monkeypatch.setattr(Slam, "in_hindsight", lambda self: in_hindsight(self) or self._sensors.sensors)
    kept = run_slam(drive.sequence, SlamSettings(), wrong)
    assert kept.warnings == [
        *once.warnings,
        "the run was begun again without what was wrong",
        "a run without what was wrong found more, and was not kept",
    ]
    assert drive.errors(kept)[0] < 0.5 * drive.errors(once)[0]


def on_a_turned_camera(odometer: SensorStream, turned_deg: float = 5.0) -> Odometer:
    """Velocities, of a mounting that says so many degrees too much."""
    velocity = replace(odometer, values=odometer.values * [0.0, 0.0, 1.0], kind="velocity")
    turned = Mounting(Rotation.from_rotvec([0.0, np.radians(turned_deg), 0.0]).as_matrix(), np.zeros(3))
    return Odometer(velocity, mounting=turned)


def test_a_run_that_is_begun_again_is_heard_of_and_leaves_the_first_where_it_is_stopped() -> None:
    drive = winding()
    sensors = [on_a_turned_camera(drive.odometer)]
    once = run_slam(drive.sequence, ONCE, sensors)
    heard: list[int] = []

    def stop_in_the_second(frame: int, _: object) -> bool:
        heard.append(frame)
        return heard.count(5) != 2

    stopped = run_slam(drive.sequence, SlamSettings(), sensors, stop_in_the_second)
    assert heard == [*once.path.times, *range(6)]
    assert stopped.warnings == once.warnings
    np.testing.assert_array_equal(stopped.trajectory().poses, once.trajectory().poses)


def test_an_odometer_on_a_camera_that_is_turned_is_told_and_set_right() -> None:
    drive = winding()
    wrong = [on_a_turned_camera(drive.odometer)]
    # As the loop leaves it: beside an odometer the end mends a third of what a wrong mounting has done.
    as_left = replace(ONCE, final_adjustment="off")
    once, again = (run_slam(drive.sequence, settings, wrong) for settings in (as_left, SlamSettings()))
    told, begun_again = again.warnings
    degrees = re.fullmatch(
        r"odometer: its directions differ by (\d\.\d)° from those of .*declared mounting", told
    )
    assert degrees is not None
    assert float(degrees[1]) == pytest.approx(5.0, abs=1.0)
    assert "begun again" in begun_again
    assert drive.errors(again)[0] < 0.7 * drive.errors(once)[0]


@cache
def with_right_mounting() -> SlamResult:
    return run_slam(winding().sequence, sensors=[on_a_turned_camera(winding().odometer, 0.0)])


@pytest.mark.parametrize("turned_deg", [20.0, 90.0, 180.0])
def test_a_wrong_mounting_does_not_cost_the_odometer(turned_deg: float) -> None:
    """Images deny it because of the mounting: it is heard once that is right."""
    drive = winding()
    faultless = with_right_mounting()
    mended = run_slam(drive.sequence, sensors=[on_a_turned_camera(drive.odometer, turned_deg)])
    assert "check the declared mounting" in mended.warnings[0]
    assert "disagrees with the images" in mended.warnings[1]
    assert "begun again" in mended.warnings[-1]
    heard, mended_heard = (
        sum(record.weights.get("odometer", 0.0) > 0 for record in result.records)
        for result in (faultless, mended)
    )
    assert mended_heard > 0.9 * heard
    assert drive.errors(mended)[0] < 1.2 * drive.errors(faultless)[0]


def test_what_is_wrong_beside_a_wrong_mounting_is_taken_away_by_a_second_restart() -> None:
    drive = winding()
    odometer = on_a_turned_camera(drive.odometer, 20.0)
    gyro = Gyroscope(faulty(drive.gyro, yaw_rad_s=float(np.radians(15))), AT_CAMERA)
    result = run_slam(drive.sequence, sensors=[odometer, gyro])
    assert "check the declared mounting" in result.warnings[0]
    assert result.warnings[-1] == "the run was begun again without what was wrong"
    assert during(result, "gyro", "weights") == []
    assert len(during(result, "odometer", "weights")) >= 3


@pytest.mark.parametrize("axes", [np.diag([1.0, -1.0, 1.0]), -np.eye(3), np.eye(3)[[2, 0, 1]]])
def test_a_gyro_in_other_axes_is_told_and_read_rightly(axes: np.ndarray) -> None:
    drive = winding()
    gyro = replace(drive.gyro, values=drive.gyro.values @ axes.T)
    sound = sound_run("gyro")
    mended = run_slam(drive.sequence, sensors=[Gyroscope(gyro, AT_CAMERA)])
    assert any("gyro: its rates" in told for told in mended.warnings)
    assert mended.warnings[-1] == "the run was begun again without what was wrong"
    assert drive.errors(mended)[0] < 1.2 * drive.errors(sound)[0]


def test_an_odometer_whose_counter_wraps_is_told_and_counts_on() -> None:
    drive = winding()
    way_m = np.cumsum(drive.odometer.values[:, -1]) * np.median(np.diff(drive.odometer.t_s))
    streams = [SensorStream(drive.odometer.t_s, way, "distance", "wheel") for way in (way_m, way_m % 16.384)]
    sound, wrapped = (run_slam(drive.sequence, sensors=[Odometer(stream)]) for stream in streams)
    (told,) = wrapped.warnings
    assert "a counter that wraps?" in told
    assert drive.errors(wrapped)[0] < 1.2 * drive.errors(sound)[0]
