"""The bias of a gyroscope by its rates while the body rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Gap
from sfmcpp.sensors import SensorStream, bias_at_rest, without_bias

BIAS_RAD_S = np.radians([0.1, -0.2, 0.3])
NOISE_RAD_S = 0.002
RESTS = (Gap(0.0, 2.0), Gap(6.0, 8.0))


def gyro(rate_hz: float = 100.0, walk_rad_s: float = 0.0) -> SensorStream:
    """Ten seconds of a body that turns to and fro between two rests, with noise and a bias."""
    rng = np.random.default_rng(0)
    t_s = np.arange(0.0, 10.0, 1 / rate_hz)
    rests = np.any([(t_s >= rest.start_s) & (t_s <= rest.end_s) for rest in RESTS], axis=0)
    turning = np.where(rests, 0.0, 0.5 * np.sin(2 * t_s))[:, None] * [0.2, 0.5, 1.0]
    bias = BIAS_RAD_S + walk_rad_s * (t_s[:, None] / 10)
    noise = rng.normal(0, NOISE_RAD_S, (len(t_s), 3))
    return SensorStream(t_s, turning + bias + noise, "angular_rate")


def test_it_is_the_mean_of_the_rates() -> None:
    found = bias_at_rest(gyro(), RESTS[:1])
    assert found is not None
    # A second and a half of a hundred samples each.
    assert np.abs(found.rates_rad_s - BIAS_RAD_S).max() < 4 * NOISE_RAD_S / np.sqrt(150)
    rest = without_bias(gyro(), found)
    assert np.abs(rest.values[:200].mean(axis=0)).max() < 4 * NOISE_RAD_S / np.sqrt(150)


def test_between_rests_it_changes_evenly() -> None:
    stream = gyro(walk_rad_s=float(np.radians(0.5)))
    found = bias_at_rest(stream, RESTS)
    assert found is not None
    assert found.t_s.tolist() == [1.0, 7.0]
    expected = BIAS_RAD_S + np.radians(0.5) * np.array([1.0, 1.0, 4.0, 7.0, 7.0])[:, None] / 10
    assert np.abs(found.at(np.array([0.0, 1.0, 4.0, 7.0, 9.0])) - expected).max() < np.radians(0.05)
    assert "0.4 to 0.8°/s" in found.complaint


@pytest.mark.parametrize("late_s", [-0.2, 0.2])
def test_a_clock_that_is_off_by_less_than_the_margin_does_no_harm(late_s: float) -> None:
    found, right = bias_at_rest(gyro().shifted(late_s), RESTS), bias_at_rest(gyro(), RESTS)
    assert found is not None
    assert right is not None
    assert np.abs(found.rates_rad_s - right.rates_rad_s).max() < np.radians(0.05)


def test_a_body_that_turns_does_not_rest() -> None:
    """A camera that turns with all that it sees, as in a lift that fills the image."""
    assert bias_at_rest(gyro(), [Gap(2.5, 5.5)]) is None
    found = bias_at_rest(gyro(), [*RESTS[:1], Gap(2.5, 5.5)])
    assert found is not None
    assert found.t_s.tolist() == [1.0]


def test_one_rest_among_three_that_says_something_else_is_left_out() -> None:
    stream = gyro()
    turned = replace(stream, values=stream.values + (stream.t_s[:, None] > 8.1) * np.radians(3.0))
    still = np.where((stream.t_s > 8.1)[:, None], turned.values.mean(axis=0), turned.values)
    found = bias_at_rest(replace(stream, values=still), [*RESTS, Gap(8.2, 9.9)])
    assert found is not None
    assert found.t_s.tolist() == [1.0, 7.0]


def test_what_is_too_short_or_too_sparse_tells_nothing() -> None:
    assert bias_at_rest(gyro(), []) is None
    assert bias_at_rest(gyro(), [Gap(0.0, 0.9)]) is None
    assert bias_at_rest(gyro(rate_hz=2.0), [Gap(0.0, 2.0)]) is None
    assert bias_at_rest(gyro(), [Gap(20.0, 22.0)]) is None


def test_rates_in_another_unit_are_no_bias() -> None:
    stream = gyro()
    assert bias_at_rest(replace(stream, values=stream.values + 1.0), RESTS) is None


def test_only_rates_have_one() -> None:
    with pytest.raises(InvalidArgument, match="must be angular_rate"):
        bias_at_rest(SensorStream([0.0, 1.0], [0.0, 0.0], "speed"), RESTS)
