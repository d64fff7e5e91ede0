"""The bias of a gyroscope beside rotations of pairs of images, some of which are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_helpers import MOUNTING, gyro, orientation_from
from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream, Turn, find_bias, without_bias

BIAS_RAD_S = np.radians([0.5, -2.0, 4.5])
STEP_S = 0.4


def turns(count: int = 16, noise_rad: float = 0.002, seed: int = 0) -> list[Turn]:
    """What a camera on the body of the helpers sees, every fifth time wrongly."""
    rng = np.random.default_rng(seed)
    to_camera = Rotation.from_matrix(MOUNTING.camera_from_body)
    made = []
    for k in range(count):
        start_s = 1.0 + STEP_S * k
        seen = to_camera * orientation_from(start_s, start_s + STEP_S, 0.01) * to_camera.inv()
        sigma = 0.1 if k % 5 == 3 else noise_rad
        noise = Rotation.from_rotvec(rng.normal(0, sigma, 3))
        made.append(Turn(start_s, start_s + STEP_S, (seen * noise).as_matrix()))
    return made


def biased(since_s: float = -np.inf, share: float = 1.0) -> SensorStream:
    stream = gyro(seconds=9.0)
    return replace(stream, values=stream.values + share * (stream.t_s[:, None] >= since_s) * BIAS_RAD_S)


@pytest.mark.parametrize("seed", range(3))
def test_a_bias_is_found_and_taken_from_the_stream(seed: int) -> None:
    found = find_bias(biased(), MOUNTING, turns(seed=seed))
    assert found is not None
    assert np.linalg.norm(found - BIAS_RAD_S) < np.radians(0.5)
    rest = without_bias(biased(), found)
    assert np.abs(rest.values - gyro(seconds=9.0).values).max() < np.radians(0.5)
    assert find_bias(rest, MOUNTING, turns(seed=seed)) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_correct_gyroscope_has_none(seed: int) -> None:
    assert find_bias(gyro(seconds=9.0), MOUNTING, turns(seed=seed)) is None
    assert find_bias(biased(share=0.1), MOUNTING, turns(seed=seed)) is None


@pytest.mark.parametrize("seed", range(3))
def test_what_is_wrong_for_a_while_is_no_bias(seed: int) -> None:
    assert find_bias(biased(since_s=5.0), MOUNTING, turns(seed=seed)) is None


@pytest.mark.parametrize("late_s", [-0.5, -0.3, 0.3, 0.5])
def test_a_wrong_clock_is_no_bias(late_s: float) -> None:
    for count in range(6, 17):
        assert find_bias(gyro(seconds=9.0).shifted(late_s), MOUNTING, turns(count)) is None


@pytest.mark.parametrize("end_s", [2.7, 3.0, 9.0])
def test_a_late_clock_in_a_bend_that_tightens_is_no_bias_before_its_samples_have_come(end_s: float) -> None:
    stamps = np.arange(0.0, 9.0, 0.01)
    rates = np.outer(0.3 * stamps, [0.0, 0.0, 1.0])
    late = SensorStream(stamps + 0.5, rates, "angular_rate")
    step_s = 0.1
    begins = 2.0 + step_s * np.arange(7)
    angles = 0.15 * ((begins + step_s) ** 2 - begins**2)
    seen = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()
    pairs = [Turn(start, start + step_s, turn) for start, turn in zip(begins.tolist(), seen, strict=True)]
    known = late.only(late.t_s <= end_s)
    assert find_bias(known, Mounting(np.eye(3), np.zeros(3)), pairs) is None


@pytest.mark.parametrize("factor", [1 / 57.3, -1.0])
def test_a_wrong_unit_or_axis_is_no_bias(factor: float) -> None:
    stream = gyro(seconds=9.0)
    for count in range(6, 17):
        assert find_bias(replace(stream, values=factor * stream.values), MOUNTING, turns(count)) is None


def in_an_even_bend(count: int, rate_rad_s: float) -> list[Turn]:
    """What a camera sees that turns evenly with the body about its z axis, with noise of 2 mrad."""
    rng, to_camera = np.random.default_rng(0), Rotation.from_matrix(MOUNTING.camera_from_body)
    seen = to_camera * Rotation.from_rotvec([0.0, 0.0, rate_rad_s * STEP_S]) * to_camera.inv()
    noisy = [(seen * Rotation.from_rotvec(rng.normal(0, 0.002, 3))).as_matrix() for _ in range(count)]
    return [Turn(1 + STEP_S * k, 1 + STEP_S * (k + 1), turn) for k, turn in enumerate(noisy)]


EVEN_RAD_S = np.radians(8.0)


@pytest.mark.parametrize("count", [6, 8, 12])
def test_a_bias_shows_in_an_even_bend_as_axes_do_not_change_the_rate(count: int) -> None:
    bias, stamps = np.radians([0.0, 0.0, 2.5]), np.arange(0.0, 9.0, 0.01)
    rate = bias + np.array([0.0, 0.0, EVEN_RAD_S])
    stream = SensorStream(stamps, np.tile(rate, (len(stamps), 1)), "angular_rate")
    found = find_bias(stream, MOUNTING, in_an_even_bend(count, EVEN_RAD_S))
    assert found is not None
    assert np.linalg.norm(found - bias) < np.radians(0.5)


@pytest.mark.parametrize(
    "axis", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [0.6, 0, 0.8], [0, 0, 0.02], [0, 0, 0]]
)
def test_wrong_axes_or_a_dead_stream_in_an_even_bend_are_no_bias(axis: list[float]) -> None:
    stamps = np.arange(0.0, 9.0, 0.01)
    stream = SensorStream(stamps, np.tile(EVEN_RAD_S * np.array(axis), (len(stamps), 1)), "angular_rate")
    for count in range(6, 17):
        assert find_bias(stream, MOUNTING, in_an_even_bend(count, EVEN_RAD_S)) is None


# Pairs of images that are each off by as much as a small bias turns the camera in a step.
MANY, NOISE_RAD = 64, 0.002
LASTING = gyro(seconds=30.0)


@pytest.mark.parametrize("seed", range(3))
def test_many_pairs_show_a_bias_that_hides_in_the_noise_of_each(seed: int) -> None:
    small = np.radians([0.2, -0.4, 0.4])
    stream = replace(LASTING, values=LASTING.values + small)
    found = find_bias(stream, MOUNTING, turns(MANY, NOISE_RAD, seed))
    assert found is not None
    assert np.linalg.norm(found - small) < np.radians(0.2)
    assert find_bias(LASTING, MOUNTING, turns(MANY, NOISE_RAD, seed)) is None


@pytest.mark.parametrize("wrong", ["late", "early", "reversed", "rad as deg"])
def test_many_pairs_do_not_take_another_fault_for_a_bias(wrong: str) -> None:
    stream = {
        "late": LASTING.shifted(0.5),
        "early": LASTING.shifted(-0.5),
        "reversed": replace(LASTING, values=-LASTING.values),
        "rad as deg": replace(LASTING, values=LASTING.values / 57.3),
    }[wrong]
    for count in range(32, MANY + 1, 4):
        assert find_bias(stream, MOUNTING, turns(count, NOISE_RAD)) is None


def test_few_turns_tell_none() -> None:
    assert find_bias(biased(), MOUNTING, turns(6)) is not None
    assert find_bias(biased(), MOUNTING, turns(5)) is None
    assert find_bias(biased(), MOUNTING, []) is None


def test_streams_of_other_kinds_are_refused() -> None:
    speeds = SensorStream(np.arange(5.0), np.ones((5, 1)), "speed")
    with pytest.raises(InvalidArgument, match="angular_rate"):
        find_bias(speeds, MOUNTING, turns())
