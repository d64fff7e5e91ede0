"""Motions beyond the ends of a stream: how far off they may be, beside a body that accelerates there."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting, rotation_increment, travelled_distance
from sfmcpp.sensors.stream import prediction_sigma
from sfmcpp.slam import Gyroscope, Odometer

FIRST_S, LAST_S = 2.0, 5.0
SPANS_S = [(4.8, 5.4), (5.1, 5.45), (1.7, 2.2), (1.6, 1.9), (3.0, 4.0), (1.8, 5.2)]


def change(acceleration: float, start_s: float, end_s: float) -> float:
    """Integral over a span of a rate that leaves its value at each end of the stream, numerically."""
    t_s = start_s + (end_s - start_s) * (np.arange(20_000) + 0.5) / 20_000
    away_s = np.maximum(t_s - LAST_S, 0.0) + np.maximum(FIRST_S - t_s, 0.0)
    return float(acceleration * away_s.mean() * (end_s - start_s))


def stream_of(kind: str, row: list[float]) -> SensorStream:
    t_s = np.arange(FIRST_S, LAST_S + 0.05, 0.1)
    return SensorStream(t_s, np.tile(row, (len(t_s), 1)), kind)


@pytest.mark.parametrize("span_s", SPANS_S)
def test_a_rotation_is_off_by_what_a_changing_rate_adds(span_s: tuple[float, float]) -> None:
    rates = stream_of("angular_rate", [0.0, 0.0, 0.2])
    turn = rotation_increment(rates, *span_s)
    assert turn is not None
    true_rad = 0.2 * (span_s[1] - span_s[0]) + change(0.3, *span_s)
    told_rad = np.arctan2(turn[1, 0], turn[0, 0])
    assert prediction_sigma(rates, *span_s) == pytest.approx(true_rad - told_rad, abs=1e-7)


@pytest.mark.parametrize("span_s", SPANS_S)
def test_a_distance_is_off_by_what_a_changing_speed_adds(span_s: tuple[float, float]) -> None:
    speeds = stream_of("speed", [8.0])
    true_m = 8.0 * (span_s[1] - span_s[0]) + change(1.0, *span_s)
    told_m = travelled_distance(speeds, *span_s)
    assert told_m is not None
    assert prediction_sigma(speeds, *span_s) == pytest.approx(true_m - told_m, abs=1e-6)


def test_sensors_are_less_certain_there_and_nowhere_else() -> None:
    gyro = Gyroscope(stream_of("angular_rate", [0.0, 0.0, 0.2]), Mounting.forward_looking())
    odometer = Odometer(stream_of("speed", [8.0]), relative_sigma=0.0)
    for sensor, declared in ((gyro, gyro.sigma_rad), (odometer, odometer.sigma_m)):
        within = sensor.measure(4.4, 5.0, np.eye(3))
        beyond = sensor.measure(4.8, 5.4, np.eye(3))
        assert within is not None
        assert within.sigma == declared
        assert beyond is not None
        assert beyond.sigma is not None
        assert beyond.sigma > 3 * declared
