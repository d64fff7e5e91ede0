"""Gaps of seconds in the stream of an odometer: interpolated, the less certain the farther from a sample."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream
from sfmcpp.sensors.bridged_gaps import bridgeable_gaps, with_gaps_bridged
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.sensor_faults import faults_of_streams
from sfmcpp.slam.sensor_suite import SensorSuite

T_S = np.arange(0.0, 30.0, 0.1)
COLUMNS = {"speed": 1, "distance": 1, "velocity": 3}


def stream_with_gap(start_s: float, end_s: float, kind: str = "velocity") -> SensorStream:
    """A car that speeds up by 0.5 m/s², without the samples in between."""
    kept = (start_s >= T_S) | (end_s <= T_S)
    along = 5.0 * T_S + 0.25 * T_S**2 if kind == "distance" else 5.0 + 0.5 * T_S
    values = along[:, None] * np.eye(3)[:1, : COLUMNS[kind]]
    return SensorStream(T_S[kept], values[kept], kind)


@pytest.mark.parametrize("kind", ["speed", "velocity"])
def test_a_gap_of_seconds_is_bridged_and_told(kind: str) -> None:
    stream = stream_with_gap(10.0, 12.0, kind)
    odometer = Odometer(stream)
    assert odometer.bridged_gaps == stream.gaps() == bridgeable_gaps(stream)
    assert odometer.between(10.5, 11.5) == pytest.approx(10.5, rel=1e-9)
    told = faults_of_streams(SensorSuite([odometer]))
    assert any("gap of 2.000 s" in sentence for sentence in told)
    assert any("interpolated over gaps of at most 5 s" in sentence for sentence in told)


def test_the_standard_deviation_grows_from_either_end_of_a_gap() -> None:
    odometer = Odometer(stream_with_gap(10.0, 14.0), mounting=Mounting.forward_looking())
    sigmas = []
    for start_s in (9.0, 10.0, 11.0, 12.0, 13.0, 14.0):
        measured = odometer.measure(start_s, start_s + 0.5, np.eye(3), np.eye(3))
        assert measured is not None
        assert measured.kind == "displacement-pose"
        way = float(np.linalg.norm(np.asarray(measured.value)[:, 3]))
        sigmas.append((measured.sigma or 0.0) ** 2 - 0.02**2 - (0.03 * way) ** 2)
    away_s = np.array([0.0, 0.25, 1.25, 1.75, 0.75, 0.0])
    np.testing.assert_allclose(sigmas, (0.5 * away_s * 0.5) ** 2, atol=1e-12)


def test_longer_gaps_and_counted_ways_are_not_bridged() -> None:
    for stream in (stream_with_gap(10.0, 15.2), stream_with_gap(10.0, 12.0, "distance")):
        assert stream.gaps()
        assert not bridgeable_gaps(stream)
        assert Odometer(stream).between(10.5, 11.5) is None


def test_samples_beside_gaps_stay_as_they_are() -> None:
    stream = stream_with_gap(10.0, 12.0, "speed")
    bridged = with_gaps_bridged(stream, bridgeable_gaps(stream))
    assert not bridged.gaps()
    assert with_gaps_bridged(stream, []) is stream
    same = np.isin(bridged.t_s, stream.t_s)
    np.testing.assert_array_equal(bridged.t_s[same], stream.t_s)
    np.testing.assert_array_equal(bridged.values[same], stream.values)


def test_a_way_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="distance"):
        with_gaps_bridged(stream_with_gap(10.0, 12.0, "distance"), [])
