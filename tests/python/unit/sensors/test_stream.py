"""What a stream refuses, what it bridges, and what it answers where it measured nothing."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model.sensor_stream import SENSOR_KINDS, Gap
from sfmcpp.sensors import (
    SensorStream,
    describe_coverage,
    describe_gaps,
    measured_at,
    travelled_distance,
)
from sfmcpp.sensors.stream import interpolate_rotations, local_medians

T = np.arange(0.0, 2.01, 0.1)


def speeds(t_s: np.ndarray = T, **options: float) -> SensorStream:
    return SensorStream(t_s, np.full(len(t_s), 10.0), "speed", "wheel", **options)


def replaced(row: int, value: float) -> np.ndarray:
    t_s = T.copy()
    t_s[row] = value
    return t_s


@pytest.mark.parametrize(
    ("t_s", "told"),
    [
        (replaced(7, T[6]), r"stream 'wheel': t_s\[7\] = 0.6.* is a duplicate"),
        (replaced(7, 0.1), r"stream 'wheel': t_s\[7\] = 0.1 s is earlier than 0.6"),
        (replaced(7, np.nan), r"stream 'wheel': t_s\[7\] = nan"),
        (np.empty(0), "stream 'wheel': t_s: there is no sample"),
    ],
)
def test_stamps_that_cannot_be_are_named_with_their_sample_and_time(t_s: np.ndarray, told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        speeds(t_s)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_value_that_is_no_number_is_named_with_its_time(bad: float) -> None:
    values = np.full(len(T), 10.0)
    values[[4, 9]] = bad
    with pytest.raises(InvalidArgument, match=r"sample 4, at 0\.4\d* s, is (nan|inf).*2 of 21 samples"):
        SensorStream(T, values, "speed")


@pytest.mark.parametrize(
    ("kind", "value", "told"),
    [
        ("speed", [300.0], r"speed of 300 m/s at sample 3, at 0.3.* at most 100 m/s; .*km/h"),
        ("velocity", [0.0, -300.0, 0.0], "speed of 300 m/s"),
        ("angular_rate", [0.0, 0.0, 40.0], r"angular rate of 40 rad/s.*degrees/s"),
        ("orientation", [0.0, 90.0, 0.0], r"rotation vector of 90 rad.*degrees"),
        ("geodetic", [100.0, 8.0, 120.0], "latitude of 100 deg"),
    ],
)
def test_a_unit_that_cannot_be_right_is_named_with_the_likely_one(
    kind: str, value: list[float], told: str
) -> None:
    values = np.zeros((len(T), len(value)))
    values[3] = value
    with pytest.raises(InvalidArgument, match=told):
        SensorStream(T, values, kind)


@pytest.mark.parametrize("kind", ["distance", "position", "pose"])
def test_positions_in_millimetres_are_noticed_and_one_leap_is_not_a_unit(kind: str) -> None:
    values = np.zeros((len(T), len(SENSOR_KINDS[kind].columns)))
    values[:, 0] = 10.0 * T
    values[8, 0] += 500.0
    assert len(SensorStream(T, values, kind)) == len(T)
    values[:, :3] *= 1000.0
    with pytest.raises(InvalidArgument, match=r"median speed .* of 10000 m/s.*mm"):
        SensorStream(T, values, kind)


@pytest.mark.parametrize(
    ("values", "kind", "told"),
    [
        (np.zeros((len(T), 2)), "velocity", r"values: shape \(21, 2\), must be \(21, 3\)"),
        (np.zeros(5), "speed", r"values: shape \(5, 1\), must be \(21, 1\)"),
        (np.zeros(len(T)), "velocity", "values: shape"),
        (np.zeros(len(T)), "sonar", "kind = 'sonar': must be one of speed"),
    ],
)
def test_values_of_the_wrong_shape_or_kind_are_refused(values: np.ndarray, kind: str, told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        SensorStream(T, values, kind)


def without(start_s: float, end_s: float) -> np.ndarray:
    """All stamps but those strictly between the two."""
    inside = np.logical_and(start_s + 1e-9 < T, end_s - 1e-9 > T)
    return T[~inside]


def test_a_short_gap_is_bridged() -> None:
    stream = speeds(without(0.5, 0.9))
    assert stream.gaps() == ()
    assert travelled_distance(stream, 0.2, 1.6) == pytest.approx(14.0)


def test_a_long_gap_gives_no_measurement_to_any_interval_that_touches_it() -> None:
    stream = speeds(without(0.5, 1.5))
    (gap,) = stream.gaps()
    assert (gap.start_s, gap.end_s) == (pytest.approx(0.5), pytest.approx(1.5))
    assert describe_gaps([stream]) == [
        "stream 'wheel': gap of 1.000 s from 0.500 to 1.500 s, longer than 0.500 s: no measurements in it"
    ]
    for start_s, end_s in [(0.4, 0.6), (0.7, 0.9), (1.4, 1.6), (0.1, 1.9)]:
        assert travelled_distance(stream, start_s, end_s) is None
    assert travelled_distance(stream, 0.1, 0.5) == pytest.approx(4.0)
    assert travelled_distance(stream, gap.end_s, 1.9) == pytest.approx(4.0)


def test_the_longest_gap_that_is_bridged_is_the_callers() -> None:
    t_s = without(0.5, 1.5)
    assert speeds(t_s, max_gap_s=1.1).gaps() == ()
    assert len(speeds(without(0.5, 0.9), max_gap_s=0.3).gaps()) == 1
    with pytest.raises(InvalidArgument, match="max_gap_s = -1"):
        speeds(max_gap_s=-1.0)


@pytest.mark.parametrize("start_s", [0.0, 5.0, 100.123, 1_317_384_506.4, 1.7e9])
@pytest.mark.parametrize("rate_hz", [10, 20, 25, 50, 100, 200])
def test_four_missing_samples_are_bridged_and_five_are_not_whatever_the_clock_is(
    rate_hz: int, start_s: float
) -> None:
    t_s = start_s + np.arange(400) / rate_hz
    for first in range(20, 380, 7):
        four, five = (speeds(np.delete(t_s, np.arange(first, first + count))) for count in (4, 5))
        assert four.gaps() == ()
        assert four.covers(t_s[first - 1], t_s[first + 4])
        assert len(five.gaps()) == 1
    given = speeds(np.delete(t_s, np.arange(200, 204)), max_gap_s=5 / rate_hz)
    assert given.gaps() == ()
    assert given.covers(t_s[-1], t_s[-1] + 5 / rate_hz)


def test_beyond_its_ends_a_stream_predicts_up_to_its_longest_gap() -> None:
    stream = speeds()
    assert travelled_distance(stream, 1.9, 2.4) == pytest.approx(5.0)
    assert travelled_distance(stream, -0.4, 0.1) == pytest.approx(5.0)
    assert travelled_distance(stream, 1.9, 2.6) is None
    assert travelled_distance(stream, -0.6, 0.1) is None


def test_an_interval_that_runs_backwards_is_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"start_s = 1.0, end_s = 0.5"):
        travelled_distance(speeds(), 1.0, 0.5)


def test_a_shift_of_the_clock_moves_every_measurement() -> None:
    stream = SensorStream(T, 10.0 * T, "speed")
    assert measured_at(stream.shifted(0.25), np.array([1.25]))[0, 0] == pytest.approx(10.0)
    with pytest.raises(InvalidArgument, match="clock_offset_s = nan"):
        stream.shifted(np.nan)


def test_distances_go_on_at_their_speed_where_speeds_stay_as_they_are() -> None:
    later = np.array([2.3])
    assert measured_at(SensorStream(T, 5.0 * T, "distance"), later)[0, 0] == pytest.approx(11.5)
    assert measured_at(SensorStream(T, 5.0 * T, "speed"), later)[0, 0] == pytest.approx(10.0)


def test_a_single_sample_measures_its_own_moment_alone() -> None:
    stream = SensorStream(np.array([1.0]), np.array([5.0]), "speed")
    assert stream.covers(1.0, 1.0)
    assert not stream.covers(1.0, 1.001)


def test_a_stream_that_does_not_last_as_long_as_the_images_is_told() -> None:
    assert describe_coverage([speeds()], -0.4, 2.4) == []
    assert describe_coverage([speeds()], -1.0, 5.0) == [
        "stream 'wheel': begins at 0.000 s, 1.000 s after the images: no measurements before",
        "stream 'wheel': ends at 2.000 s, 3.000 s before the images: no measurements after",
    ]


def test_rates_and_positions_that_are_too_far_apart_are_told_and_distances_are_not() -> None:
    slow = 1000 * T
    (told,) = describe_coverage([speeds(slow)], 0.0, 2.0)
    assert "samples are 100 s apart, too sparse to determine a motion" in told
    (told,) = describe_coverage([SensorStream(slow, np.zeros((len(T), 3)), "position")], 0.0, 2.0)
    assert "samples are 100 s apart, and between them the way is taken for straight" in told
    assert describe_coverage([SensorStream(slow, slow, "distance")], 0.0, 2.0) == []


def test_a_wrong_unit_of_positions_is_told_from_noise_between_samples() -> None:
    t_s = np.arange(0.0, 3.0, 0.0005)
    places = np.outer(10 * t_s, [1.0, 0.0, 0.0])
    noisy = places + 0.1 * np.random.default_rng(0).standard_normal(places.shape)
    SensorStream(t_s, noisy, "position")
    with pytest.raises(InvalidArgument, match=r"median speed over a second of .* was it given in mm, cm, km"):
        SensorStream(t_s, 100 * places, "position")
    with pytest.raises(InvalidArgument, match="median speed over a second of 1000 m/s"):
        SensorStream(t_s[:10], 100 * places[:10], "position")


def test_positions_beyond_numbers_are_told_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    with pytest.raises(InvalidArgument, match="median speed over a second of inf m/s"):
        SensorStream(T, 1e300 * np.outer(T, [1.0, -1.0, 0.0]), "position")
    assert not recwarn


@pytest.mark.parametrize("offset_s", [0.1, 1.7e9 + 0.3])
def test_a_shifted_stream_that_grows_bridges_what_the_whole_one_does(offset_s: float) -> None:
    stream = SensorStream(0.1 * np.arange(10), np.ones(10), "speed").shifted(offset_s)
    later_s = offset_s + 0.5 * np.arange(4, 40)
    assert stream.extended(later_s, np.ones(36)).max_gap_s == pytest.approx(2.5, abs=1e-5)
    given = SensorStream(0.1 * np.arange(10), np.ones(10), "speed", max_gap_s=0.7).shifted(offset_s)
    assert given.extended(later_s, np.ones(36)).max_gap_s == 0.7


@pytest.mark.parametrize("first", [1, 2, 10])
def test_a_stream_that_grows_becomes_the_whole_one(first: int) -> None:
    whole = speeds()
    grown = SensorStream(T[:first], np.full(first, 10.0), "speed").extended(
        T[first:], np.full(len(T) - first, 10.0)
    )
    np.testing.assert_array_equal(grown.t_s, whole.t_s)
    np.testing.assert_array_equal(grown.values, whole.values)
    assert grown.max_gap_s == whole.max_gap_s
    assert speeds(max_gap_s=0.3).extended(np.array([9.0]), np.array([1.0])).max_gap_s == 0.3
    with pytest.raises(InvalidArgument, match="earlier than"):
        whole.extended(np.array([0.5]), np.array([1.0]))


@pytest.mark.parametrize("shape", [(3,), (40,), (5, 3), (40, 3)])
@pytest.mark.parametrize("reach", [1, 2, 5])
def test_a_local_median_is_that_of_the_rows_about_each(shape: tuple[int, ...], reach: int) -> None:
    rows = np.random.default_rng(0).normal(size=shape)
    expected = [np.median(rows[max(0, k - reach) : k + reach + 1], axis=0) for k in range(len(rows))]
    np.testing.assert_array_equal(local_medians(rows, reach), expected)


def test_stamps_in_nanoseconds_raise_no_warning_of_numpy() -> None:
    stamps = 1.6e18 + 1e8 * np.arange(5)  # a second later is the same number
    assert len(SensorStream(stamps, 0.01 * np.arange(5.0), "distance")) == 5


def test_a_gap_from_a_little_before_zero_begins_at_zero() -> None:
    assert str(Gap(-1e-9, 0.05)) == "0.050 s from 0.000 to 0.050 s"
    assert str(Gap(-0.5, 1.0)) == "1.500 s from -0.500 to 1.000 s"


def test_a_long_stream_is_searched_for_gaps_once() -> None:
    stream = speeds(without(0.5, 1.5))
    assert stream.gaps() is stream.gaps()
    assert speeds().extended([2.1], [10.0]).gaps() == ()


@pytest.mark.parametrize("kind", ["orientation", "pose"])
def test_only_the_samples_beside_a_time_are_looked_at(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).uniform(-1, 1, (len(T), 3 if kind == "orientation" else 6))
    stream, rows = SensorStream(T, values, kind), []
    exact = so3.exp

    def noted(vectors: np.ndarray) -> np.ndarray:
        rows.append(len(vectors))
        return exact(vectors)

    monkeypatch.setattr(so3, "exp", noted)
    found = measured_at(stream, np.array([0.73]))
    assert max(rows) == 1
    monkeypatch.undo()
    between = interpolate_rotations(T, so3.exp(values[:, -3:]), np.array([0.73]))
    np.testing.assert_array_equal(found[:, -3:], so3.log(between))


def test_many_gaps_are_told_in_one_sentence() -> None:
    t_s = 2.0 * np.arange(40)[:, None] + np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    (told,) = describe_gaps([speeds(t_s.ravel())])
    assert told == (
        "stream 'wheel': 39 gaps longer than 0.500 s, 58.5 s together, first 1.500 s from 0.500 to 2.000 s: "
        "no measurements in them"
    )
