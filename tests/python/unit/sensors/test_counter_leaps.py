"""Ways that are counted from another origin after a leap."""

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.sensors import counter_leaps, describe_counter_leaps, without_counter_leaps

T_S = np.arange(0.0, 20.0, 0.1)
WAY_M = 8.0 * T_S - 20.0 * np.cos(0.2 * T_S)


def _distance(way_m: np.ndarray, t_s: np.ndarray = T_S) -> SensorStream:
    return SensorStream(t_s, way_m, "distance", "wheel")


def test_a_counter_that_wraps_counts_on() -> None:
    wrapped = np.floor(1e3 * (WAY_M - WAY_M[0])) % 65536 / 1e3
    stream = _distance(wrapped)
    assert counter_leaps(stream).sum() == 2
    # each leap is replaced by the usual step, which differs by the acceleration over two samples
    found = without_counter_leaps(stream).values[:, 0]
    np.testing.assert_allclose(found, WAY_M - WAY_M[0], atol=0.01)
    (told,) = describe_counter_leaps(stream)
    assert told.startswith("stream 'wheel': the way leaps 2 times, first by -64.4 m at 6.400 s")


def test_a_counter_that_is_reset_counts_on() -> None:
    reset = np.where(T_S < 7.05, WAY_M, WAY_M - WAY_M[71])
    stream = _distance(reset)
    assert np.flatnonzero(counter_leaps(stream)).tolist() == [70]
    np.testing.assert_allclose(without_counter_leaps(stream).values[:, 0], WAY_M, atol=0.005)


@pytest.mark.parametrize("held", [1, 10])
def test_sound_ways_have_no_leaps(held: int) -> None:
    """A value that is repeated ten times, ticks, a stop, heavy braking, a gap."""
    t_s = np.arange(0.0, 30.0, 0.01)
    speed = np.interp(t_s, [0, 8, 10, 14, 15, 30], [15, 15, 0, 0, 6, -3])
    way = np.floor(np.cumsum(speed) * 0.01 / 0.02) * 0.02
    kept = (t_s < 5) | (t_s > 7)
    stream = _distance(np.repeat(way[::held], held)[kept], t_s[kept])
    assert not counter_leaps(stream).any()
    assert without_counter_leaps(stream) is stream
    assert describe_counter_leaps(stream) == []


def test_short_streams_have_no_leaps() -> None:
    assert not counter_leaps(_distance(np.array([0.0, 60.0, 1.0]), T_S[:3])).any()
    assert not counter_leaps(_distance(np.zeros(20), T_S[:20])).any()


def test_other_kinds_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="kind 'speed': must be distance"):
        counter_leaps(SensorStream(T_S, T_S, "speed"))
