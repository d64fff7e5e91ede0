"""Rates in other axes or another unit are read as the rotations of images say, and no other fault is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bends import T_S, rates, stream_of, turns
from sensor_helpers import MOUNTING
from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream, find_rate_axes, with_axes

DEGREES = 180 / np.pi
# What is given, of true rates (n, 3), and what is said of it.
MISREAD = {
    "its rates about z have the opposite sign": rates() * [1, 1, -1],
    "its rates about y and z have the opposite sign": rates() * [1, -1, -1],
    "its rates have the opposite sign of the camera's: are turns to the right positive?": -rates(),
    "its rates wx, wy, wz are those about −y, −z, x of the body": rates()[:, [1, 2, 0]] * [-1, -1, 1],
    "its rates are 57.3 times those of the camera: degrees declared as radians?": rates() * DEGREES,
    "its rates are 0.0175 times those of the camera: radians declared as degrees?": rates() / DEGREES,
    "degrees declared as radians? and its rates have the opposite sign": -rates() * DEGREES,
}


@pytest.mark.parametrize("told", MISREAD)
@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_rates_are_read_as_they_were_meant(told: str, late_s: float) -> None:
    stream = stream_of(MISREAD[told]).shifted(-late_s)
    found = find_rate_axes(stream, MOUNTING, turns())
    assert found is not None
    assert told in found.complaint
    rest = with_axes(stream, found)
    np.testing.assert_allclose(rest.values, rates(), atol=1e-12)
    assert find_rate_axes(rest, MOUNTING, turns()) is None


@pytest.mark.parametrize("seed", range(3))
def test_other_faults_and_none_are_no_other_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sound = stream_of(rates())
    noise = stream_of(rng.normal(0, 0.3, (len(T_S), 3)))
    biased = stream_of(rates() + np.radians(5) * np.array([0.3, -0.4, 0.866]))
    others = [sound, sound.shifted(0.5), sound.shifted(-0.5), biased, noise, stream_of(0 * rates())]
    assert [find_rate_axes(stream, MOUNTING, turns(seed=seed)) for stream in others] == [None] * len(others)


def test_a_mounting_that_is_turned_a_little_is_no_order_of_axes() -> None:
    for angle in np.radians([-15.0, 15.0]):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        turned = Mounting(MOUNTING.camera_from_body @ turn, np.zeros(3))
        assert find_rate_axes(stream_of(rates()), turned, turns()) is None


def test_few_turns_tell_nothing() -> None:
    reversed_rates = stream_of(-rates())
    assert find_rate_axes(reversed_rates, MOUNTING, turns()[2:7]) is None
    assert find_rate_axes(replace(reversed_rates, t_s=T_S + 100.0), MOUNTING, turns()) is None


def test_other_kinds_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="must be angular_rate"):
        find_rate_axes(SensorStream(T_S, T_S, "speed"), MOUNTING, turns())
