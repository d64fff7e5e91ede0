"""Clock, unit and axes of a gyroscope beside the noisy keyframes of a camera."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_helpers import MOUNTING, gyro, orientation_from, rate_at
from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream, Trajectory, Turn, check_rotations, check_turns

SECONDS = 20.0
SLOW = 0.4


@cache
def body() -> tuple[np.ndarray, Rotation]:
    """Uneven times and the rotations of the body there."""
    t_s = np.cumsum(np.random.default_rng(9).uniform(0.2, 0.6, 45)) + 0.6
    turns = [Rotation.identity()]
    for start, end in pairwise(t_s):
        turns.append(turns[-1] * slow_turn(start, end))
    return t_s, Rotation.concatenate(turns)


def keyframes(noise_rad: float = 0.003, wild: float = 0.1, seed: int = 0) -> Trajectory:
    """Keyframes of a camera on a body that tumbles slowly; some of them are far off."""
    rng = np.random.default_rng(seed)
    t_s, turns = body()
    sigma = np.where(rng.uniform(size=len(t_s)) < wild, 0.1, noise_rad)
    noise = Rotation.from_rotvec(rng.normal(0, 1, (len(t_s), 3)) * sigma[:, None])
    camera = turns * Rotation.from_matrix(MOUNTING.camera_from_body).inv() * noise
    return Trajectory(t_s, np.concatenate([camera.as_matrix(), np.zeros((len(t_s), 3, 1))], axis=2))


def slow_turn(start: float, end: float) -> Rotation:
    """The tumbling of the helpers at less than half of its rates, in steps of a hundredth of a second."""
    edges = np.linspace(start, end, max(2, round((end - start) / 0.01)))
    turn = Rotation.identity()
    for step in Rotation.from_rotvec(SLOW * rate_at(0.5 * (edges[1:] + edges[:-1])) * (edges[1] - edges[0])):
        turn = turn * step
    return turn


def slow_gyro(factor: float = 1.0) -> SensorStream:
    stream = gyro(seconds=SECONDS)
    return replace(stream, values=factor * SLOW * stream.values)


@pytest.mark.parametrize("offset_s", [-0.37, 0.0, 0.21])
@pytest.mark.parametrize("seed", range(3))
def test_the_offset_is_found_to_what_it_says(offset_s: float, seed: int) -> None:
    found = check_rotations(slow_gyro().shifted(-offset_s), MOUNTING, keyframes(seed=seed))
    assert found.intervals > 35
    assert found.is_determined
    assert abs(found.offset_s - offset_s) < 3 * found.sigma_s
    assert found.error_rad < 0.5 * found.turned_rad
    told = found.complaint("imu")
    if offset_s:
        side = "behind" if offset_s > 0 else "ahead of"
        assert told.startswith(f"imu: its clock is {abs(found.offset_s):.2f} ± ")
        assert f"s {side} the camera's: add {found.offset_s:.2f} s to its stamps" in told
    else:
        assert told == ""


def test_pieces_of_offsets_give_the_bits_of_all_together(monkeypatch: pytest.MonkeyPatch) -> None:
    together = check_rotations(slow_gyro().shifted(0.2), MOUNTING, keyframes())
    monkeypatch.setattr("sfmcpp.sensors.rotation_check._MOST_TOGETHER", 1000)  # of some 8,000
    assert check_rotations(slow_gyro().shifted(0.2), MOUNTING, keyframes()) == together


def test_what_the_offset_may_be_off_is_no_less_than_it_scatters_by_and_not_much_more() -> None:
    found = [check_rotations(slow_gyro(), MOUNTING, keyframes(wild=0.0, seed=seed)) for seed in range(20)]
    scatter = np.sqrt(np.mean([check.offset_s**2 for check in found]))
    assert scatter < np.median([check.sigma_s for check in found]) < 3 * scatter


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (180 / np.pi, "57.3 times those of the camera: degrees declared as radians?"),
        (np.pi / 180, "0.0175 times those of the camera: radians declared as degrees?"),
    ],
)
def test_a_wrong_unit_is_named(factor: float, told: str) -> None:
    found = check_rotations(slow_gyro(factor), MOUNTING, keyframes())
    assert found.complaint("imu") == f"imu: its rates are {told}"


@pytest.mark.parametrize(
    "mounting",
    [Mounting(np.eye(3), np.zeros(3)), Mounting(MOUNTING.camera_from_body.T, np.zeros(3))],
)
def test_wrong_axes_are_named(mounting: Mounting) -> None:
    told = check_rotations(slow_gyro(), mounting, keyframes()).complaint("imu")
    assert told.startswith("imu: in the strongest turns its rotations differ by ")
    assert "check the declared axes, mounting and unit" in told


def test_a_constant_rate_tells_no_offset_and_raises_no_complaint() -> None:
    t_s = np.arange(0.0, SECONDS, 0.01)
    steady = SensorStream(t_s, np.tile([0.0, 0.0, 0.2], (len(t_s), 1)), "angular_rate")
    poses = keyframes()
    turns = Rotation.from_rotvec(poses.t_s[:, None] * [0.0, 0.0, 0.2])
    noise = Rotation.from_rotvec(np.random.default_rng(1).normal(0, 0.003, (len(poses), 3)))
    camera = turns * Rotation.from_matrix(MOUNTING.camera_from_body).inv() * noise
    poses = poses.with_poses(np.concatenate([camera.as_matrix(), np.zeros((len(poses), 3, 1))], axis=2))
    found = check_rotations(steady.shifted(0.3), MOUNTING, poses)
    assert not found.is_determined
    assert found.complaint("imu") == ""


def test_a_camera_that_does_not_turn_is_all_noise_and_no_complaint() -> None:
    rng = np.random.default_rng(2)
    poses = keyframes()
    noise = Rotation.from_rotvec(rng.normal(0, 0.003, (len(poses), 3))).as_matrix()
    still = poses.with_poses(np.concatenate([noise, np.zeros((len(poses), 3, 1))], axis=2))
    t_s = np.arange(0.0, SECONDS, 0.01)
    quiet = SensorStream(t_s, rng.normal(0, 1e-3, (len(t_s), 3)), "angular_rate")
    assert check_rotations(quiet, MOUNTING, still).complaint("imu") == ""


def test_orientations_are_checked_as_rates_are() -> None:
    t_s = np.arange(0.0, SECONDS, 0.02)
    turn, absolute = Rotation.identity(), [Rotation.identity()]
    for start, end in pairwise(t_s):
        turn = turn * slow_turn(start, end)
        absolute.append(turn)
    stream = SensorStream(t_s, Rotation.concatenate(absolute).as_rotvec(), "orientation")
    found = check_rotations(stream.shifted(-0.2), MOUNTING, keyframes())
    assert abs(found.offset_s - 0.2) < 3 * found.sigma_s
    assert found.is_determined


def test_gaps_are_left_out_and_too_little_in_common_tells_nothing() -> None:
    whole = slow_gyro()
    kept = (whole.t_s < 4.0) | (whole.t_s > 12.0)
    gappy = SensorStream(whole.t_s[kept], whole.values[kept], "angular_rate")
    some, every = (check_rotations(s, MOUNTING, keyframes()) for s in (gappy, whole))
    assert some.intervals < every.intervals - 15
    assert abs(some.offset_s) < 3 * some.sigma_s
    short = SensorStream(whole.t_s[:300], whole.values[:300], "angular_rate")
    nothing = check_rotations(short, MOUNTING, keyframes())
    assert (nothing.is_determined, nothing.complaint("imu")) == (False, "")


def test_the_rotations_of_a_finely_cut_body_are_those_of_the_helpers() -> None:
    """The two ways of integrating the tumbling agree, so that the tests above test the check."""
    rates = SLOW * rate_at(np.array([1.0]))[0]
    assert slow_turn(1.0, 1.01).as_rotvec() == pytest.approx(0.01 * rates, rel=0.02)
    assert orientation_from(1.0, 1.01).as_rotvec() == pytest.approx(0.01 * rates / SLOW, rel=0.02)


def test_other_kinds_and_no_reach_are_refused() -> None:
    speed = SensorStream(np.arange(3.0), np.ones(3), "speed")
    with pytest.raises(InvalidArgument, match="'speed' is of kind 'speed'"):
        check_rotations(speed, MOUNTING, keyframes())
    with pytest.raises(InvalidArgument, match="largest_offset_s = 0"):
        check_rotations(slow_gyro(), MOUNTING, keyframes(), 0.0)


def pairs(vision: Trajectory, count: int) -> list[Turn]:
    """What pairs of the poses tell."""
    turns = np.swapaxes(vision.rotations[:-1], 1, 2) @ vision.rotations[1:]
    spans = pairwise(vision.t_s.tolist())
    return [Turn(*span, turn) for span, turn in zip(spans, turns, strict=True)][4 : 4 + count]


@pytest.mark.parametrize("offset_s", [-0.37, 0.0, 0.21])
@pytest.mark.parametrize("seed", range(3))
def test_few_pairs_of_images_tell_a_clock_to_what_they_say(offset_s: float, seed: int) -> None:
    late = slow_gyro().shifted(-offset_s)
    found = check_turns(late, MOUNTING, pairs(keyframes(0.001, seed=seed), 12))
    assert found.intervals == 12
    assert found.is_determined
    assert found.agrees
    assert abs(found.offset_s - offset_s) < 4 * found.sigma_s + 0.01


def test_fewer_than_six_pairs_tell_no_clock() -> None:
    turns = pairs(keyframes(0.001, wild=0.0), 6)
    assert check_turns(slow_gyro(), MOUNTING, turns).is_determined
    assert not check_turns(slow_gyro(), MOUNTING, turns[:5]).is_determined
    assert not check_turns(slow_gyro(), MOUNTING, []).is_determined
