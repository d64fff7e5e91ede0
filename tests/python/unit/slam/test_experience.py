"""What a run learns of its sensors: σ where none is declared, and conflicts that chance does not explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.model import Gap
from sfmcpp.slam import Odometer, SlamSettings, run_slam
from sfmcpp.slam.experience import KEYFRAMES_OF_SIGMA, Experience, informed
from sfmcpp.slam.measurement import Measurement
from sfmcpp.weighting import ConflictReport
from winding import sound_run, winding

STEP = Gap(0.0, 1.0)


def report(sigmas: float = 0.5, **more: float | None) -> ConflictReport:
    told = {"observations": 40} | more
    return ConflictReport("odometer", 0.01, "m", sigmas**2, 1, sigmas, sigmas > 3, **told)  # type: ignore[arg-type]


def test_sigma_is_what_is_apart_less_what_the_images_make_of_it() -> None:
    rng = np.random.default_rng(0)
    sigma, images = 0.05, 0.03
    found = []
    for _ in range(200):
        known = Experience()
        for _ in range(KEYFRAMES_OF_SIGMA):
            apart = abs(np.hypot(sigma, images) * rng.normal())
            known.add(replace(report(images_sigma=images), discrepancy=apart), STEP)
        assert known.sigma is not None
        found.append(known.sigma)
    assert np.median(found) == pytest.approx(sigma, rel=0.2)


def test_sigma_is_not_known_before_enough_keyframes_and_stays_then() -> None:
    known = Experience()
    for k in range(KEYFRAMES_OF_SIGMA):
        assert known.sigma is None
        known.add(replace(report(), discrepancy=0.01 * (k + 1)), STEP)
    first = known.sigma
    known.add(replace(report(), discrepancy=5.0), STEP)
    assert known.sigma == first
    (told,) = known.describe("odometer")
    assert "no standard deviation is declared" in told


def test_a_declared_sigma_is_not_estimated() -> None:
    known = Experience()
    for _ in range(2 * KEYFRAMES_OF_SIGMA):
        known.add(report(sensor_sigma=0.02), STEP)
    assert known.sigma is None
    assert known.describe("odometer") == []


@pytest.mark.parametrize(("in_a_row", "named"), [(5, False), (6, True)])
def test_only_conflicts_in_a_row_are_named(in_a_row: int, named: bool) -> None:
    known = Experience()
    for k in range(40):
        wrong = k in (3, 4, 5, 7, 9) or 20 <= k < 20 + in_a_row
        known.add(report(3.5 if wrong else 0.5, sensor_sigma=0.02), STEP)
    told = known.describe("odometer")
    assert bool(told) == named
    if named:
        assert "disagrees with the images at 6 consecutive keyframes" in told[0]


def test_what_leads_to_a_conflict_belongs_to_it() -> None:
    known = Experience()
    for k in range(40):
        sigmas = 3.5 if 20 <= k < 26 else 1.6 if k in (18, 19, 26) else 0.5
        known.add(report(sigmas, sensor_sigma=0.02), Gap(k - 1.0, k))
    assert known.denied == Gap(16.5, 26.5)
    assert Experience().denied is None


@pytest.mark.parametrize(("others", "named"), [(0.5, True), (2.9, False)])
def test_one_strong_conflict_is_named_where_it_is_not_usual(others: float, named: bool) -> None:
    known = Experience()
    for k in range(20):
        known.add(report(9.0 if k == 7 else others, sensor_sigma=0.02), STEP)
    told = known.describe("odometer")
    assert bool(told) == named
    if named:
        assert "disagrees with the images at 1 keyframe, by up to 9 σ" in told[0]


def test_a_fault_that_lasts_for_half_of_a_run_is_named() -> None:
    known = Experience()
    for k in range(9):
        known.add(report(100.0 if k > 3 else 0.5, sensor_sigma=0.02), STEP)
    (told,) = known.describe("odometer")
    assert "disagrees with the images at 5 consecutive keyframes, by up to 100 σ" in told


@pytest.mark.parametrize(("points", "named"), [(21, False), (22, True)])
def test_few_points_say_nothing_against_a_sensor(points: int, named: bool) -> None:
    known = Experience()
    for k in range(20):
        strange = {"observations": points} if 7 <= k < 14 else {}
        known.add(report(9.0 if strange else 0.5, sensor_sigma=0.02, **strange), STEP)
    assert bool(known.describe("odometer")) == named


@pytest.mark.parametrize(
    ("unit", "points", "after", "named"),
    [("m", 9, 3, False), ("m", 9, 4, True), ("m", 10, 0, True), ("rad", 9, 0, True)],
)
def test_points_after_a_lost_map_have_lost_their_scale(
    unit: str, points: int, after: int, named: bool
) -> None:
    """As behind a stop at which the tracks have died: that says nothing against an odometer."""
    known = Experience()
    for k in range(20):
        few = {"observations": points} if k == 7 else {}
        wrong = report(16.0 if k == 8 + after else 0.5, sensor_sigma=0.02, **few)
        known.add(replace(wrong, unit=unit), STEP)
    assert bool(known.describe("odometer")) == named


@pytest.mark.parametrize(
    ("silent_s", "unit", "named"), [(0.0, "m", True), (6.0, "m", False), (6.0, "rad", True)]
)
def test_a_map_without_its_odometer_for_a_while_does_not_hold_the_scale(
    silent_s: float, unit: str, named: bool
) -> None:
    """On a drive images alone had changed it by half within two seconds."""
    known = Experience()
    for k in range(12):
        start_s = k + (silent_s if k >= 8 else 0.0)
        told = replace(report(14.0 if k in (8, 9) else 0.5, sensor_sigma=0.02), unit=unit)
        known.add(told, Gap(start_s, start_s + 1.0))
    assert bool(known.describe("sensor")) == named
    assert (known.denied is not None) == named


@pytest.mark.parametrize(
    ("count", "in_a_row", "named"), [(100, 6, True), (1700, 10, False), (1700, 11, True)]
)
def test_more_keyframes_need_a_longer_conflict(count: int, in_a_row: int, named: bool) -> None:
    known = Experience()
    for k in range(count):
        known.add(report(3.1 if 50 <= k < 50 + in_a_row else 0.5, sensor_sigma=10.0), STEP)
    assert bool(known.describe("odometer")) == named


@pytest.mark.parametrize(
    ("count", "sigmas", "named"), [(100, 8.1, True), (1700, 9.0, False), (1700, 10.0, True)]
)
def test_more_keyframes_need_a_stronger_conflict(count: int, sigmas: float, named: bool) -> None:
    known = Experience()
    for k in range(count):
        known.add(report(sigmas if k == 50 else 0.5, sensor_sigma=0.02), STEP)
    assert bool(known.describe("odometer")) == named


def test_conflicts_that_end_as_the_map_is_moved_are_told_as_such_and_after_others() -> None:
    """A map drifts off positions by itself: these are seldom wrong."""
    known = Experience()
    for k in range(40):
        known.add(report(9.0 if 10 <= k < 20 else 0.5, sensor_sigma=1.0), STEP)
        if k == 19:
            known.explain()
    (told,) = known.describe("gps")
    assert "10 consecutive keyframes, by up to 9 σ" in told
    assert told.endswith("the images drifted, or it is wrong; the map was moved to it")
    for k in range(10):
        known.add(report(3.5 if k < 7 else 0.5, sensor_sigma=1.0), STEP)
    (told,) = known.describe("gps")
    assert "7 consecutive keyframes" in told
    assert told.endswith("one of them is wrong")


def test_a_run_estimates_what_is_not_declared_and_says_so() -> None:
    drive = winding(seed=1)
    result = run_slam(drive.sequence, sensors=[Odometer(drive.odometer, sigma_m=None)])
    (told,) = result.warnings
    assert told.startswith("odometer: no standard deviation is declared")
    weights = [record.weights["odometer"] for record in result.records if "odometer" in record.weights]
    assert set(weights[:KEYFRAMES_OF_SIGMA]) == {0.0}
    assert min(weights[KEYFRAMES_OF_SIGMA:]) > 0


def test_correct_sensors_are_not_complained_of() -> None:
    assert sound_run("odometer", "gyro").warnings == []


def test_at_no_weight_the_map_is_that_of_the_images_but_for_its_unit() -> None:
    """The gauge does not depend on whether there is a sensor."""
    drive = winding()
    settings = SlamSettings(weights="fixed:0", correct_drift=False)
    alone = sound_run()
    beside = run_slam(drive.sequence, settings, [Odometer(drive.odometer)])
    assert beside.metric
    assert drive.errors(beside) == pytest.approx(drive.errors(alone), rel=0.02)
    assert beside.world is not None
    assert not any(c.weight for keyframe in beside.world.keyframes for c in keyframe.constraints)


def test_distances_reach_the_keyframes_before_the_map_had_metres() -> None:
    result = sound_run("odometer")
    assert result.world is not None
    unconstrained, *others = result.world.keyframes
    assert unconstrained.constraints == []
    assert all([c.measurement.sensor for c in k.constraints] == ["odometer"] for k in others)
    assert min(c.weight for k in others for c in k.constraints) > 0


@pytest.mark.parametrize(
    ("conflicts", "denied"),
    [([4.0], False), ([4.0] * 3, False), ([3.1] * 6, True), ([9.0], True), ([4.0] * 6 + [0.5], False)],
)
def test_a_sensor_is_denied_by_conflicts_that_last_or_are_strong_to_the_latest_keyframe(
    conflicts: list[float], denied: bool
) -> None:
    known = Experience()
    for sigmas in [0.5] * 20 + conflicts:
        known.add(report(sigmas), STEP)
    assert known.is_denied == denied


def reach(known: Experience, start_s: float, end_s: float, kind: str = "scale") -> float:
    return informed(Measurement("odometer", kind, 1.0, 0.02), known, start_s, end_s).reach


def test_an_odometer_that_agreed_is_off_by_no_more_than_inertia_allows() -> None:
    known = Experience()
    assert reach(known, 0.0, 1.0) == np.inf
    known.add(report(), Gap(0.0, 0.5))  # off by 0.01 m in half a second
    # A speed error that grows by 8 m/s², integrated in small steps.
    for start_s, end_s in [(0.5, 1.0), (1.5, 2.0)]:
        t_s = np.linspace(0.5, end_s, 100_001)
        off_m_s = 0.02 + 8.0 * (t_s - 0.5)
        within = t_s >= start_s
        expected = off_m_s[within].mean() * (end_s - start_s)
        assert reach(known, start_s, end_s) == pytest.approx(expected, rel=1e-3)
    assert reach(known, 0.5, 1.0, "position") == np.inf
    assert reach(known, 0.5, 1.0, "displacement-rotation-log") == np.inf


@pytest.mark.parametrize(("refuted", "expected"), [(False, np.inf), (True, 0.0)])
def test_a_conflict_goes_on_as_it_began(refuted: bool, expected: float) -> None:
    known = Experience()
    known.add(report(), STEP)
    known.add(report(20.0), Gap(1.0, 2.0), refuted=refuted)
    assert reach(known, 2.0, 3.0) == expected
    known.add(report(), Gap(2.0, 3.0))
    assert 4.0 < reach(known, 3.0, 4.0) < 4.1


def test_wrong_images_say_nothing_against_a_sensor() -> None:
    for refuted in (False, True):
        known = Experience()
        for k in range(20):
            told = report(20.0 if k == 19 else 0.5, sensor_sigma=0.02)
            known.add(told, Gap(k, k + 1.0), refuted=refuted and k == 19)
        assert known.is_denied != refuted
        assert bool(known.describe("odometer")) != refuted
        assert (known.denied is None) == refuted
