"""A gyroscope whose samples are too far apart for a body that sways: how certain its rotations are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting, Turn, check_turns, find_bias, rotation_increment
from sfmcpp.slam import Gyroscope

SWAY_RAD_S = 7.0
SPANS_S = [(start_s, start_s + 0.3) for start_s in np.arange(2.03, 7.0, 0.07)]


def swaying(swings_rad: float, every_s: float) -> Gyroscope:
    """A body that turns to and fro about its vertical axis."""
    t_s = np.arange(0.0, 10.0, every_s)
    yaw_rate = swings_rad * SWAY_RAD_S * np.cos(SWAY_RAD_S * t_s)
    rates = SensorStream(t_s, np.column_stack([0 * t_s, 0 * t_s, yaw_rate]), "angular_rate")
    return Gyroscope(rates, Mounting.forward_looking())


def errors_and_sigmas(gyro: Gyroscope, swings_rad: float) -> tuple[np.ndarray, np.ndarray]:
    errors, sigmas = [], []
    for start_s, end_s in SPANS_S:
        turn = rotation_increment(gyro.stream, start_s, end_s)
        measured = gyro.measure(start_s, end_s, np.eye(3))
        assert turn is not None
        assert measured is not None
        true_rad = swings_rad * (np.sin(SWAY_RAD_S * end_s) - np.sin(SWAY_RAD_S * start_s))
        errors.append(np.arctan2(turn[1, 0], turn[0, 0]) - true_rad)
        sigmas.append(measured.sigma)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize("swings_rad", [0.05, 0.15])
def test_a_sway_sampled_coarsely_is_as_uncertain_as_it_is_wrong(swings_rad: float) -> None:
    """To a factor of three: the samples alone do not tell a sway from noise."""
    errors, sigmas = errors_and_sigmas(swaying(swings_rad, 0.1), swings_rad)
    wrong_rad = np.sqrt(np.mean(errors**2))
    assert wrong_rad > 0.002
    assert wrong_rad / 3 < np.median(sigmas) < 3 * wrong_rad


@pytest.mark.parametrize(("swings_rad", "every_s"), [(0.15, 0.005), (0.002, 0.1)])
def test_fine_samples_and_a_calm_body_leave_what_is_declared(swings_rad: float, every_s: float) -> None:
    errors, sigmas = errors_and_sigmas(swaying(swings_rad, every_s), swings_rad)
    assert np.abs(errors).max() < 0.001
    assert (sigmas == 0.001).all()


def winding_rates(every_s: float) -> SensorStream:
    """Bends of a road, which one sample a second leaves out in part."""
    t_s = np.arange(0.0, 60.0, every_s)
    yaw_rate = 0.3 * np.cos(2.0 * t_s) + 0.2 * np.cos(3.1 * t_s + 1.0)
    return SensorStream(t_s, np.column_stack([0 * t_s, 0 * t_s, yaw_rate]), "angular_rate")


def yaw_between(start_s: float, end_s: float) -> float:
    ends = np.array([start_s, end_s])
    return float(np.diff(0.15 * np.sin(2.0 * ends) + 0.2 / 3.1 * np.sin(3.1 * ends + 1.0))[0])


def test_one_sample_a_second_is_as_uncertain_as_it_is_wrong() -> None:
    """At least, and at most three times."""
    gyro = Gyroscope(winding_rates(1.0), Mounting.forward_looking())
    errors, sigmas = [], []
    for start_s in np.arange(2.03, 55.0, 0.13):
        turn, measured = gyro.between(start_s, start_s + 0.4), gyro.measure(start_s, start_s + 0.4, np.eye(3))
        assert turn is not None
        assert measured is not None
        # A turn to the left is one about −y of the camera.
        errors.append(np.arctan2(turn[2, 0], turn[0, 0]) - yaw_between(start_s, start_s + 0.4))
        sigmas.append(measured.sigma)
    wrong_rad = np.sqrt(np.mean(np.square(errors)))
    assert wrong_rad > 0.02
    assert wrong_rad < np.sqrt(np.mean(np.square(sigmas))) < 3 * wrong_rad


@pytest.mark.parametrize(("every_s", "told"), [(1.0, False), (0.1, True)])
def test_samples_that_leave_out_bends_tell_neither_clock_nor_bias(every_s: float, told: bool) -> None:
    mounting, axis = Mounting.forward_looking(), np.array([0.0, -1.0, 0.0])
    turns = [
        Turn(start_s, start_s + 0.4, so3.exp(yaw_between(start_s, start_s + 0.4) * axis))
        for start_s in np.arange(4.0, 14.0, 0.4)
    ]
    late = winding_rates(every_s).shifted(0.3)
    assert check_turns(late, mounting, turns, 1.0).is_determined == told
    rates = winding_rates(every_s)
    biased = replace(rates, values=rates.values + np.radians([0.0, 0.0, 5.0]))
    assert (find_bias(biased, mounting, turns) is not None) == told
