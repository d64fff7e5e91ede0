"""Speeds that leap are found, and nothing else is doubted."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Turn, carried_over, dead_stretches, doubtful_stretches, travelled_distance


def speeds(t_s: np.ndarray) -> np.ndarray:
    """A drive that speeds up and brakes, 5 to 15 m/s, 3 m/s² at most."""
    return 10.0 + 5.0 * np.sin(0.6 * t_s)


def stream_of(t_s: np.ndarray, values: np.ndarray, kind: str = "speed") -> SensorStream:
    return SensorStream(t_s, values, kind)


def odometer(t_s: np.ndarray, speeds_m_s: np.ndarray, kind: str) -> SensorStream:
    """What shows these speeds: as they are, as velocities in one direction, or as the way since the start."""
    along = speeds_m_s[:, None] * np.array([0.6, 0.8, 0.0])
    ways = np.cumsum((t_s[1] - t_s[0]) * speeds_m_s)
    return stream_of(t_s, {"speed": speeds_m_s, "velocity": along, "distance": ways}[kind], kind)


@pytest.mark.parametrize(("rate_hz", "sigma"), [(10, 0.0), (10, 0.1), (100, 0.0), (100, 0.3)])
def test_a_correct_drive_is_not_doubted(rate_hz: int, sigma: float) -> None:
    t_s = np.arange(0, 60, 1 / rate_hz)
    noise = sigma * np.random.default_rng(0).normal(size=len(t_s))
    assert doubtful_stretches(stream_of(t_s, speeds(t_s) + noise)) == ()


RATES_HZ = [10, 20, 50, 100]


def stop_and_go(t_s: np.ndarray) -> np.ndarray:
    """A drive that stands, drives at 8 m/s and stands again, at most 2 m/s² in between."""
    return np.interp(t_s, [5, 9, 25, 30, 35, 39, 55, 59], [0, 8, 8, 0, 0, 6, 6, 0])


def quantised(values: np.ndarray, step: float) -> np.ndarray:
    return np.floor(values / step + 1e-9) * step


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("step", [1 / 3.6, 0.1, 0.1 / 3.6])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_speeds_in_steps_are_not_doubted_and_their_faults_are(
    rate_hz: int, step: float, sigma: float
) -> None:
    t_s = np.arange(0, 60, 1 / rate_hz)
    true = stop_and_go(t_s) + sigma * np.random.default_rng(0).normal(size=len(t_s))
    assert doubtful_stretches(stream_of(t_s, quantised(np.abs(true), step))) == ()
    rounded = np.round(quantised(np.abs(true), step), 3)
    assert doubtful_stretches(stream_of(t_s, rounded)) == ()
    slipping = np.abs(true) * np.where((t_s > 12) & (t_s < 20), 0.6, 1.0)
    (found,) = doubtful_stretches(stream_of(t_s, quantised(slipping, step)))
    assert (found.start_s, found.end_s) == pytest.approx((12, 20), abs=0.2)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_speeds_in_whole_knots_are_not_doubted(rate_hz: int) -> None:
    t_s = np.arange(0, 60, 1 / rate_hz)
    assert doubtful_stretches(stream_of(t_s, quantised(stop_and_go(t_s), 1852 / 3600))) == ()


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("tick_m", [0.05, 0.02, 0.005, 0.001])
def test_ticks_of_a_wheel_are_not_doubted(rate_hz: int, tick_m: float) -> None:
    t_s = np.arange(0, 60, 1 / rate_hz)
    distance = np.cumsum(stop_and_go(t_s)) / rate_hz
    assert doubtful_stretches(stream_of(t_s, quantised(distance, tick_m), "distance")) == ()


def test_a_slip_among_ticks_is_doubted() -> None:
    t_s = np.arange(0, 60, 0.1)
    slipping = stop_and_go(t_s) * np.where((t_s > 12) & (t_s < 20), 0.6, 1.0)
    ticks = quantised(np.cumsum(slipping) / 10, 0.01)
    (found,) = doubtful_stretches(stream_of(t_s, ticks, "distance"))
    assert (found.start_s, found.end_s) == pytest.approx((12, 20), abs=0.2)


@pytest.mark.parametrize("repeats", [2, 5, 10])
@pytest.mark.parametrize("sigma", [0.0, 0.02])
def test_speeds_that_a_logger_repeats_are_not_doubted_and_their_faults_are(
    repeats: int, sigma: float
) -> None:
    t_s = np.arange(0, 60, 0.02)
    true = stop_and_go(t_s) + sigma * np.random.default_rng(0).normal(size=len(t_s))
    held = np.arange(len(t_s)) // repeats * repeats
    assert doubtful_stretches(stream_of(t_s, true[held])) == ()
    blocking = np.where((t_s > 12) & (t_s < 14), 0.0, true)
    (found,) = doubtful_stretches(stream_of(t_s, blocking[held]))
    assert (found.start_s, found.end_s) == pytest.approx((12, 14), abs=0.3)


@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_stamps_that_are_late_by_less_than_a_period_are_not_doubted(rate_hz: int) -> None:
    rng = np.random.default_rng(0)
    t_s = np.arange(0, 60, 1 / rate_hz)
    late_s = rng.uniform(0, 0.8 / rate_hz, len(t_s))
    noisy = stop_and_go(t_s) + 0.02 * rng.normal(size=len(t_s))
    assert doubtful_stretches(stream_of(t_s + late_s, noisy)) == ()


@pytest.mark.parametrize("factor", [1.1, 0.9, 1.3, 0.7, 2.0])
@pytest.mark.parametrize("kind", ["speed", "velocity", "distance"])
def test_a_factor_that_comes_and_goes_is_doubted_while_it_lasts(factor: float, kind: str) -> None:
    t_s = np.arange(0, 60, 0.1)
    faulty = (t_s >= 20) & (t_s < 30)
    wrong = speeds(t_s) * np.where(faulty, factor, 1.0)
    (found,) = doubtful_stretches(odometer(t_s, wrong, kind))
    assert found.start_s == pytest.approx(20, abs=0.25)
    assert found.end_s == pytest.approx(30, abs=0.25)


@pytest.mark.parametrize("factor", [1.1, 0.9])
@pytest.mark.parametrize("slow_m_s", [(2.5, 6.0), (6.0, 2.5)])
def test_a_leap_that_is_faint_for_low_speed_is_known_by_the_other(
    factor: float, slow_m_s: tuple[float, float]
) -> None:
    t_s = np.arange(0, 30, 0.1)
    true = np.interp(t_s, [0, 8, 14, 30], [slow_m_s[0], slow_m_s[0], slow_m_s[1], slow_m_s[1]])
    noisy = true + 1e-3 * np.random.default_rng(0).normal(size=len(t_s))
    faulty = (t_s >= 6) & (t_s < 16)
    (found,) = doubtful_stretches(stream_of(t_s, noisy * np.where(faulty, factor, 1.0)))
    assert found.start_s == pytest.approx(6, abs=0.25)
    assert found.end_s == pytest.approx(16, abs=0.25)


def test_a_leap_that_is_not_taken_back_lasts_until_the_body_stands() -> None:
    t_s = np.arange(0, 40, 0.1)
    values = np.where(t_s < 10, 10.0, 13.0)
    (open_ended,) = doubtful_stretches(stream_of(t_s, values))
    assert open_ended.end_s >= t_s[-1]
    braking = np.where(t_s < 20, values, np.maximum(13.0 - 3.0 * (t_s - 20), 0.0))
    (until_stop,) = doubtful_stretches(stream_of(t_s, braking))
    assert until_stop.end_s == pytest.approx(24.3, abs=0.3)


def test_two_faults_are_two_stretches() -> None:
    t_s = np.arange(0, 60, 0.1)
    faulty = ((t_s >= 10) & (t_s < 20)) | ((t_s >= 40) & (t_s < 45))
    found = doubtful_stretches(stream_of(t_s, speeds(t_s) * np.where(faulty, 1.4, 1.0)))
    assert [round(gap.start_s) for gap in found] == [10, 40]
    assert [round(gap.end_s) for gap in found] == [20, 45]


@pytest.mark.parametrize("kind", ["speed", "velocity", "distance"])
@pytest.mark.parametrize("later", [[], [200], [200, 350]])
def test_a_spike_in_the_first_sample_is_as_any_other(later: list[int], kind: str) -> None:
    t_s = np.arange(0, 60, 0.1)
    wrong = speeds(t_s)
    wrong[[0, *later]] = 60.0
    stream = odometer(t_s, wrong, kind)
    if kind == "distance":  # the way from the first sample on has its spike
        stream = stream_of(t_s, np.append(0.0, stream.values[:-1]), kind)
    found = doubtful_stretches(stream)
    assert [gap.end_s for gap in found] == pytest.approx(
        [t_s[k] for k in [1, *[k + 1 for k in later]]], abs=0.11
    )
    assert all(gap.end_s - gap.start_s < 0.31 for gap in found)
    if kind == "speed":
        np.testing.assert_allclose(carried_over(stream, found).values[:, 0], speeds(t_s), rtol=0.01)


def test_a_fault_from_the_second_sample_on_is_doubted() -> None:
    t_s = np.arange(0, 60, 0.1)
    faulty = (t_s > 0) & (t_s < 10)
    (found,) = doubtful_stretches(stream_of(t_s, speeds(t_s) * np.where(faulty, 2.0, 1.0)))
    assert (found.start_s, found.end_s) == pytest.approx((0, 10), abs=0.25)


@pytest.mark.parametrize("kind", ["speed", "velocity", "distance"])
@pytest.mark.parametrize("noise_m_s", [0.0, 0.02])
def test_a_wheel_that_blocks_is_doubted_until_it_turns_again(noise_m_s: float, kind: str) -> None:
    t_s = np.arange(0, 60, 0.1)
    blocked = (t_s >= 20) & (t_s < 23)
    noise = noise_m_s * np.random.default_rng(0).normal(size=len(t_s))
    wrong = np.abs(np.where(blocked, 0.0, speeds(t_s)) + noise)
    (found,) = doubtful_stretches(odometer(t_s, wrong, kind))
    assert found.start_s == pytest.approx(20, abs=0.25)
    assert found.end_s == pytest.approx(23, abs=0.25)


@pytest.mark.parametrize("seed", range(4))
def test_a_wheel_that_blocks_from_the_second_sample_on_is_doubted_as_long(seed: int) -> None:
    t_s = np.arange(0, 60, 0.1)
    noise = 0.02 * np.random.default_rng(seed).normal(size=len(t_s))
    blocked = (t_s > 0) & (t_s < 10)
    (found,) = doubtful_stretches(stream_of(t_s, np.abs(np.where(blocked, 0.0, speeds(t_s)) + noise)))
    assert (found.start_s, found.end_s) == pytest.approx((0, 10), abs=0.25)


def test_a_stop_that_low_speeds_are_missing_from_is_not_doubted() -> None:
    """An odometer that shows nothing below 1 m/s leaps to zero and back around a stop of twenty seconds."""
    t_s = np.arange(0, 60, 0.1)
    true = np.clip(np.abs(t_s - 30) - 10, 0, 5)
    found = doubtful_stretches(stream_of(t_s, np.where(true < 1, 0.0, true)))
    assert all(gap.end_s - gap.start_s < 0.31 for gap in found)


@pytest.mark.parametrize("kind", ["speed", "velocity", "distance"])
@pytest.mark.parametrize("rate_hz", [10, 20])
@pytest.mark.parametrize("least_m_s", [0.5, 1.0, 2.0])
def test_a_start_out_of_low_speeds_that_are_not_shown_is_doubted_for_a_moment(
    least_m_s: float, rate_hz: int, kind: str
) -> None:
    """A vehicle that stops every forty seconds; its odometer shows nothing below a least speed."""
    t_s = np.arange(0, 120, 1 / rate_hz)
    true = np.clip(1.5 * (np.abs((t_s + 20) % 40 - 20) - 6), 0, 10)
    shown = np.where(true < least_m_s, 0.0, true)
    found = doubtful_stretches(odometer(t_s, shown, kind))
    assert all(gap.end_s - gap.start_s < 0.31 for gap in found)


def test_a_leap_out_of_a_stand_to_a_speed_that_odometers_show_is_doubted() -> None:
    t_s = np.arange(0, 30, 0.1)
    (found,) = doubtful_stretches(stream_of(t_s, np.where(t_s < 10, 0.0, 8.0)))
    assert found.start_s == pytest.approx(10, abs=0.25)
    assert found.end_s >= t_s[-1]


def test_two_samples_tell_nothing() -> None:
    assert doubtful_stretches(stream_of(np.array([0.0, 0.1]), np.array([1.0, 30.0]))) == ()


def test_inertia_carries_a_speed_over_what_is_doubted() -> None:
    t_s = np.arange(0, 60, 0.1)
    faulty = (t_s >= 20) & (t_s < 22)
    stream = stream_of(t_s, speeds(t_s) * np.where(faulty, 0.6, 1.0))
    carried = carried_over(stream, doubtful_stretches(stream))
    correct = stream_of(t_s, speeds(t_s))
    np.testing.assert_array_equal(carried.values[~faulty], stream.values[~faulty])
    found, true, told = (travelled_distance(s, 20.0, 22.0) for s in (carried, correct, stream))
    assert found == pytest.approx(true, rel=0.06)
    assert told != pytest.approx(true, rel=0.3)


def test_an_odometer_that_rocks_between_images_or_is_asked_over_unlike_times_is_not_dead() -> None:
    t_s = np.arange(0, 40, 0.1)
    rocking = np.where(t_s < 20, np.where(np.arange(len(t_s)) % 2, -1.0, 1.0), 10.0)
    steps = [Turn(a, a + 0.2, np.eye(3)) for a in np.arange(0, 39, 0.2)]
    assert dead_stretches(stream_of(t_s, rocking), steps) == ()
    short = [Turn(a, a + 0.01, np.eye(3)) for a in np.arange(0, 10, 0.1)]
    long = [Turn(a, a + 1.0, np.eye(3)) for a in np.arange(11.0, 30.0)]
    assert dead_stretches(stream_of(t_s, np.full(len(t_s), 10.0)), [*short, *long]) == ()


def test_an_odometer_of_a_body_that_stands_or_hovers_is_not_dead() -> None:
    """Images of a camera that stands show the parallax of their noise, now and then as a step."""
    t_s = np.arange(0, 40, 0.1)
    speeds = np.where((t_s > 15) & (t_s < 25), 0.01, 4.0)

    def steps(resting_px: float) -> list[Turn]:
        parallax = [resting_px if 15 <= a < 25 else 9.0 for a in range(39)]
        return [Turn(a, a + 1.0, np.eye(3), parallax_px=px) for a, px in enumerate(parallax)]

    assert dead_stretches(stream_of(t_s, speeds), steps(0.5)) == ()
    (dead,) = dead_stretches(stream_of(t_s, speeds), steps(5.0))
    assert dead.end_s - dead.start_s == pytest.approx(10.0, abs=0.3)


def test_an_odometer_of_a_body_that_turns_on_the_spot_is_not_dead() -> None:
    """A camera before the axis moves aside then, and its images show steps; in a bend it moves ahead."""
    t_s = np.arange(0, 40, 0.1)
    speeds = np.where((t_s > 15) & (t_s < 25), 0.0, 0.5)
    turn = so3.exp(np.radians([0.0, 20.0, 0.0]))
    ahead, aside = np.array([0.0, 0.0, 1.0]), turn[:, 2] - [0.0, 0.0, 1.0]

    def steps(direction: np.ndarray) -> list[Turn]:
        straight = [Turn(a, a + 1.0, np.eye(3), ahead, parallax_px=9.0) for a in range(39)]
        turned = [Turn(a, a + 1.0, turn, direction, parallax_px=9.0) for a in range(39)]
        return straight[:15] + turned[15:25] + straight[25:]

    assert dead_stretches(stream_of(t_s, speeds), steps(aside / np.linalg.norm(aside))) == ()
    assert len(dead_stretches(stream_of(t_s, speeds), steps(ahead))) == 1


def test_distances_are_not_carried() -> None:
    with pytest.raises(InvalidArgument, match="distance"):
        carried_over(stream_of(np.arange(3.0), np.arange(3.0), "distance"), [])
