"""Positions that jump away and back are found, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.model.sensor_stream import FASTEST_M_S
from sfmcpp.sensors import (
    displaced_positions,
    longest_lost_fix,
    position_jumps,
    without_leaps,
    without_repeats,
)
from sfmcpp.slam import Gps

ASIDE = np.array([9.0, -12.0, 0.0])  # 15 m


def winding_way(period_s: float = 0.1, seconds: float = 30.0) -> tuple[np.ndarray, np.ndarray]:
    """A car that winds at 10 m/s, with up to 4 m/s² across."""
    t_s = np.arange(0.0, seconds, period_s)
    heading = 0.8 * np.sin(0.5 * t_s)
    steps = 10 * period_s * np.stack([np.cos(heading), np.sin(heading), 0 * t_s], axis=1)
    return t_s, np.cumsum(steps, axis=0)


def found(t_s: np.ndarray, places: np.ndarray, seed: int, sigma_m: float = 1.0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, sigma_m, places.shape)
    return displaced_positions(SensorStream(t_s, places + noise, "position"), sigma_m)


@pytest.mark.parametrize("period_s", [0.05, 0.1, 0.25, 1.0])
@pytest.mark.parametrize("sigma_m", [0.02, 1.0])
def test_correct_positions_are_all_kept(period_s: float, sigma_m: float) -> None:
    t_s, places = winding_way(period_s, 120.0)
    assert not any(found(t_s, places, seed, sigma_m).any() for seed in range(20))


@pytest.mark.parametrize("seed", range(10))
def test_a_stretch_that_is_displaced_is_found_to_within_two_positions(seed: int) -> None:
    t_s, places = winding_way()
    displaced = (t_s >= 12) & (t_s < 18)
    marked = found(t_s, places + np.outer(displaced, ASIDE), seed)
    assert np.count_nonzero(marked != displaced) <= 2


@pytest.mark.parametrize("seed", range(10))
def test_positions_between_two_displaced_stretches_are_kept(seed: int) -> None:
    t_s, places = winding_way()
    displaced = ((t_s >= 8) & (t_s < 11)) | ((t_s >= 16) & (t_s < 19))
    marked = found(t_s, places + np.outer(displaced, ASIDE), seed)
    assert np.count_nonzero(marked != displaced) <= 4


@pytest.mark.parametrize("seed", range(10))
def test_single_positions_that_are_off_are_found(seed: int) -> None:
    t_s, places = winding_way()
    rows = np.random.default_rng(100 + seed).choice(len(t_s), 12, replace=False)
    places[rows] += 1.3 * ASIDE
    np.testing.assert_array_equal(np.flatnonzero(found(t_s, places, seed)), np.sort(rows))


def test_noise_that_was_not_declared_is_not_taken_for_jumps_of_most() -> None:
    t_s, places = winding_way()
    noisy = places + np.random.default_rng(0).normal(0, 4.0, places.shape)
    marked = displaced_positions(SensorStream(t_s, noisy, "position"), 1.0)
    assert 2 * np.count_nonzero(marked) <= len(t_s)


def test_nothing_is_said_of_a_jump_without_return_nor_of_few_positions() -> None:
    t_s, places = winding_way()
    assert not found(t_s, places + np.outer(t_s > 20, ASIDE), 0).any()
    assert not found(t_s[:7], places[:7] + np.outer(t_s[:7] == t_s[3], ASIDE), 0).any()


def test_a_gap_is_no_jump() -> None:
    t_s, places = winding_way()
    kept = (t_s < 10) | (t_s > 16)
    assert not any(found(t_s[kept], places[kept], seed).any() for seed in range(10))


def test_other_streams_and_no_sigma_are_refused() -> None:
    t_s, places = winding_way()
    with pytest.raises(InvalidArgument, match="kind"):
        displaced_positions(SensorStream(t_s, np.ones((len(t_s), 1)), "speed"))
    with pytest.raises(InvalidArgument, match="sigma_m"):
        displaced_positions(SensorStream(t_s, places, "position"), 0.0)


def positions(count: int = 60, sigma_m: float = 0.0) -> SensorStream:
    """Ten metres a second eastwards, ten times a second."""
    places = np.zeros((count, 3))
    places[:, 0] = np.arange(count)
    places += sigma_m * np.random.default_rng(0).standard_normal(places.shape)
    return SensorStream(0.1 * np.arange(count), places, "position")


@pytest.mark.parametrize("sigma_m", [0.0, 1.0, 5.0, 20.0])
def test_noise_is_no_leap(sigma_m: float) -> None:
    stream = positions(sigma_m=sigma_m)
    assert without_leaps(stream, sigma_m) is stream


@pytest.mark.parametrize(
    "lost",
    [[0], [59], [30], [20, 40], [0, 1, 2, 30, 31, 57, 58, 59], [*range(10, 30)], [*range(40, 60)]],
)
def test_positions_far_from_where_they_can_be_are_left_out(lost: list[int]) -> None:
    stream = positions()
    stream.values[lost] = -6e6
    kept = without_leaps(stream)
    np.testing.assert_array_equal(kept.t_s, np.delete(stream.t_s, lost))
    assert kept.max_gap_s == stream.max_gap_s


@pytest.mark.parametrize(("share", "is_left_out"), [(0.9, False), (1.2, True)])
def test_what_a_vehicle_can_drive_in_the_time_is_no_leap(share: float, is_left_out: bool) -> None:
    t_s, places = 0.1 * np.arange(60), np.zeros((60, 3))
    places[30, 0] = share * (0.1 * FASTEST_M_S + position_jumps._NOISE_SIGMAS * position_jumps._LEAST_SIGMA_M)
    kept = without_leaps(SensorStream(t_s, places, "position")).t_s
    np.testing.assert_array_equal(kept, np.delete(t_s, 30) if is_left_out else t_s)


def test_of_two_places_that_cannot_both_be_the_one_with_more_positions_is_believed() -> None:
    stream = positions()
    stream.values[25:, 1] += 1e4
    np.testing.assert_array_equal(without_leaps(stream).t_s, stream.t_s[25:])


@pytest.mark.parametrize("aside_m", [20.0, 25.0, 30.0, 32.0])
@pytest.mark.parametrize("seed", range(5))
def test_correct_positions_stay_where_only_one_edge_of_a_jump_is_a_leap(aside_m: float, seed: int) -> None:
    t_s = np.arange(0.0, 16.0, 0.2)
    places = np.stack([0 * t_s, 5 * t_s, 0 * t_s], axis=1)
    places += np.random.default_rng(seed).normal(0, 0.5, places.shape)
    displaced = (t_s > 6.4) & (t_s < 9.6)
    places[displaced, 0] += aside_m
    kept = np.isin(t_s, without_leaps(SensorStream(t_s, places, "position"), 1.0).t_s)
    assert np.count_nonzero(~displaced & ~kept) <= 2


def test_leaps_are_those_of_positions() -> None:
    with pytest.raises(InvalidArgument, match="kind"):
        without_leaps(SensorStream(np.arange(3.0), np.zeros(3), "speed"))


@pytest.mark.parametrize("sigma_m", [np.nan, np.inf, -1.0])
def test_a_sigma_of_leaps_is_a_length(sigma_m: float) -> None:
    """With one that is no number, a single position was left of all."""
    stream = positions()
    stream.values[20] = -6e6
    with pytest.raises(InvalidArgument, match="sigma_m"):
        without_leaps(stream, sigma_m)


@pytest.mark.parametrize("start_s", [37.7, 100.123, 1_317_384_506.4, 1.7e9])
def test_the_same_positions_are_displaced_whatever_the_clock_is(start_s: float) -> None:
    rng = np.random.default_rng(0)
    for seed in range(40):
        t_s, places = winding_way()
        first = int(rng.integers(20, 250))
        places[first : first + int(rng.integers(3, 18))] += 4 * rng.normal(size=3)
        np.testing.assert_array_equal(
            found(start_s + t_s, places, seed, 0.5), found(t_s, places, seed, 0.5), err_msg=str(seed)
        )


def frozen(begin_s: float, end_s: float) -> SensorStream:
    """A way on which one fix is repeated for a while."""
    t_s, places = winding_way()
    held = (t_s > begin_s) & (t_s <= end_s)
    places[held] = places[np.flatnonzero(held)[0] - 1]
    return SensorStream(t_s, places, "position")


def test_repeats_of_a_fix_are_left_out_and_told_where_it_was_lost() -> None:
    stream = frozen(12.0, 16.0)
    left = without_repeats(stream)
    assert len(left) == len(stream) - 40
    assert not ((left.t_s > 12.05) & (left.t_s < 16.05)).any()
    start_s, length_s = longest_lost_fix(stream, 1.0) or (0.0, 0.0)
    assert (start_s, length_s) == (pytest.approx(12.0), pytest.approx(4.0))
    assert longest_lost_fix(frozen(12.0, 13.0), 1.0) is None
    gps = Gps(stream)
    (remark,) = gps.remarks()
    assert remark.startswith("stream 'position': one position is repeated for 4.0 s from 12.000 s on")
    assert gps.at(14.0, np.eye(3)) is None
    assert gps.at(11.0, np.eye(3)) is not None


def test_a_slow_receiver_of_a_fast_logger_does_not_jump() -> None:
    t_s, places = winding_way()
    noise = np.random.default_rng(0).normal(0, 0.05, places.shape)
    logged = (places + noise)[np.arange(len(t_s)) // 10 * 10]
    gps = Gps(SensorStream(t_s, logged, "position"), sigma_m=0.05)
    assert gps.remarks() == []
    assert len(gps.believed) == len(t_s) // 10


def test_a_receiver_that_stands_keeps_its_position() -> None:
    stream = SensorStream(np.arange(50) / 10.0, np.ones((50, 3)), "position")
    assert without_repeats(stream) is stream
    assert longest_lost_fix(stream, 1.0) is None
