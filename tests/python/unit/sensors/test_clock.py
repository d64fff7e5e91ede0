"""Offsets of clocks found from rotations, and refused with what to do about them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_helpers import gyro, orientation_from
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.sensors import SensorStream, angular_rates, estimate_clock_offset, require_same_clock


def vision(
    rate_hz: float = 10.0, seconds: float = 12.0, noise_rad: float = 2e-4, seed: int = 0
) -> SensorStream:
    """A camera on the tumbling body, mounted askew, its rotations a little noisy."""
    t_s = np.arange(0.0, seconds, 1 / rate_hz)
    steps = [orientation_from(a, b, 2e-3) for a, b in pairwise(t_s)]
    turn, body = Rotation.identity(), [Rotation.identity()]
    for step in steps:
        turn = turn * step
        body.append(turn)
    rng = np.random.default_rng(seed)
    noise = Rotation.from_rotvec(rng.normal(0, noise_rad, (len(t_s), 3)))
    camera = Rotation.concatenate(body) * Rotation.from_rotvec([0.5, -1.2, 0.8]) * noise
    return angular_rates(
        Trajectory(t_s, np.concatenate([camera.as_matrix(), np.zeros((len(t_s), 3, 1))], axis=2))
    )


@pytest.mark.parametrize("offset_s", [-0.73, -0.1, 0.0, 0.0317, 0.4])
def test_the_offset_of_a_clock_is_found_to_a_few_milliseconds(offset_s: float) -> None:
    found = estimate_clock_offset(gyro(seconds=12.0).shifted(-offset_s), vision())
    assert found.offset_s == pytest.approx(offset_s, abs=0.005)
    assert found.correlation > 0.99
    assert found.rate_ratio == pytest.approx(1.0, abs=0.01)


def test_a_clock_that_is_off_is_refused_with_the_offset_to_give() -> None:
    late = gyro(seconds=12.0).shifted(-0.4)
    told = r"'gyro': its clock is 0\.\d+ s behind the camera's .* give clock_offset_s = 0\.(39|40)\d"
    with pytest.raises(InvalidArgument, match=told):
        require_same_clock(late, vision())
    with pytest.raises(InvalidArgument, match=r"0\.\d+ s ahead of the camera's .* = -0\.(39|40)\d"):
        require_same_clock(gyro(seconds=12.0).shifted(0.4), vision())
    assert abs(require_same_clock(late.shifted(0.4), vision()).offset_s) < 0.005


def test_slow_turns_given_in_degrees_are_noticed_beside_the_camera() -> None:
    slow = gyro(seconds=12.0)
    degrees = SensorStream(slow.t_s, np.rad2deg(slow.values) / 4, "angular_rate", "gyro")
    camera = vision()
    quarter = SensorStream(camera.t_s, camera.values / 4, "angular_rate", "vision")
    with pytest.raises(InvalidArgument, match=r"57\.\d times those seen by the camera.*degrees/s"):
        require_same_clock(degrees, quarter)


def test_without_turns_nothing_is_determined_and_nothing_refused() -> None:
    rng = np.random.default_rng(1)
    still = [
        SensorStream(t_s, rng.normal(0, 1e-3, (len(t_s), 3)), "angular_rate")
        for t_s in (np.arange(0, 12, 0.01), np.arange(0, 12, 0.1))
    ]
    assert not require_same_clock(*still).is_determined


def test_streams_of_different_days_are_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"fewer than 10 samples in common at any offset up to 1\.0 s"):
        estimate_clock_offset(gyro().shifted(86_400.0), vision())


@pytest.mark.parametrize("largest_offset_s", [0.0, -1.0, float("nan")])
def test_a_search_of_no_extent_is_refused(largest_offset_s: float) -> None:
    with pytest.raises(InvalidArgument, match="largest_offset_s"):
        estimate_clock_offset(gyro(), vision(), largest_offset_s)
