"""The clock of an odometer by directions of travel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting, Turn, check_directions

MOUNTING = Mounting.forward_looking()
NOISE_RAD = np.radians(0.2)


def nodding(t_s: np.ndarray, strength_rad: float) -> np.ndarray:
    """Velocities (n, 3) of a body that nods and sways on its springs."""
    rng = np.random.default_rng(3)
    phases, rates = rng.uniform(0, 6, (2, 6)), rng.uniform(5, 12, (2, 6))
    side, up = (np.sin(rates[k] * t_s[:, None] + phases[k]).sum(axis=1) for k in (0, 1))
    return 10.0 * np.column_stack([np.ones_like(t_s), strength_rad * side, strength_rad * up])


def swaying(t_s: np.ndarray, strength_rad: float) -> np.ndarray:
    """Velocities (n, 3) of a body that sways with a period of 0.9 s and nothing else."""
    side = strength_rad * np.sin(2 * np.pi * t_s / 0.9)
    return 10.0 * np.column_stack([np.ones_like(t_s), side, np.zeros_like(t_s)])


def seen(
    strength_rad: float,
    seed: int = 0,
    misaligned_rad: float = 0.0,
    noise_rad: float = NOISE_RAD,
    motion: Callable[[np.ndarray, float], np.ndarray] = nodding,
) -> list[Turn]:
    """What images a tenth of a second apart tell, with noise and every tenth step wrong."""
    rng = np.random.default_rng(seed)
    start = np.arange(0.0, 10.0, 0.1)
    body = motion(start + 0.05, strength_rad)
    tilted = body @ MOUNTING.camera_from_body.T @ so3.exp(misaligned_rad * np.array([0.6, 0.8, 0.0])).T
    # Steps share the noise of the image between them.
    noisy = tilted / 10.0 + np.diff(rng.normal(0.0, noise_rad / np.sqrt(2), (len(tilted) + 1, 3)), axis=0)
    noisy[::10, 0] += 0.3
    directions = noisy / np.linalg.norm(noisy, axis=1, keepdims=True)
    covariance = NOISE_RAD**2 * np.diag([1.0, 1.0, 0.0])
    return [Turn(t, t + 0.1, np.eye(3), d, covariance) for t, d in zip(start, directions, strict=True)]


def odometer(strength_rad: float, late_s: float) -> SensorStream:
    t_s = np.arange(-2.0, 12.0, 0.05)
    return SensorStream(t_s + late_s, nodding(t_s, strength_rad), "velocity")


@pytest.mark.parametrize("late_s", [-0.5, -0.2, 0.3, 0.6])
def test_stamps_that_are_off_are_named_with_their_offset(late_s: float) -> None:
    clock = check_directions(odometer(0.003, late_s), MOUNTING, seen(0.003, misaligned_rad=0.05))
    assert clock.is_off
    assert clock.offset_s == pytest.approx(-late_s, abs=0.051)
    assert ("ahead of" if late_s > 0 else "behind") in clock.complaint


@pytest.mark.parametrize("strength_rad", [0.0, 0.0003, 0.003])
@pytest.mark.parametrize("seed", range(6))
def test_correct_stamps_are_not(strength_rad: float, seed: int) -> None:
    assert not check_directions(odometer(strength_rad, 0.0), MOUNTING, seen(strength_rad, seed)).is_off


@pytest.mark.parametrize(("bends_rad", "named"), [(0.0, True), (0.15, False)])
def test_directions_that_bends_turn_aside_tell_no_clock(bends_rad: float, named: bool) -> None:
    """A car ahead makes steps to the side of bends, and nods seem to come 0.2 s late."""
    turns = [
        replace(t, direction=so3.exp([0.0, aside, 0.0]) @ t.direction)
        for t in seen(0.003)
        for aside in [bends_rad * np.sin(0.5 * t.start_s)]
    ]
    clock = check_directions(odometer(0.003, 0.2), MOUNTING, turns)
    assert clock.is_off == named


@pytest.mark.parametrize("seed", [0, 3, 4])
def test_a_regular_sway_tells_no_clock(seed: int) -> None:
    """A period later it looks the same, and chance decides which offset fits best."""
    t_s, noise = np.arange(-2.0, 12.0, 0.1), np.random.default_rng(seed).normal(0.0, 0.05, (140, 3))
    stream = SensorStream(t_s, swaying(t_s, 0.01) + noise, "velocity")
    clock = check_directions(stream, MOUNTING, seen(0.01, seed, motion=swaying))
    assert abs(clock.offset_s) > 0.8
    assert not clock.is_off


@pytest.mark.parametrize("seed", [0, 1, 43])
def test_directions_that_are_off_by_ten_degrees_tell_no_clock(seed: int) -> None:
    """Steps of a slow drone, whose images claim the noise of pixels alone."""
    vague = seen(0.003, seed, noise_rad=np.radians(10.0))
    assert not check_directions(odometer(0.003, 0.0), MOUNTING, vague).is_off


def test_a_body_that_goes_straight_tells_no_clock() -> None:
    clocks = [check_directions(odometer(0.0, 0.5), MOUNTING, seen(0.0, seed)) for seed in range(6)]
    assert not any(clock.is_off for clock in clocks)


@pytest.mark.parametrize("late_s", [-1.05, 1.05])
def test_an_offset_beyond_those_tried_is_not_taken_for_the_last_of_them(late_s: float) -> None:
    assert not check_directions(odometer(0.003, late_s), MOUNTING, seen(0.003)).is_off


def test_a_few_steps_or_a_body_that_stands_tell_nothing() -> None:
    assert not check_directions(odometer(0.003, 0.5), MOUNTING, seen(0.003)[:30]).is_off
    standing = odometer(0.003, 0.5)
    still = SensorStream(standing.t_s, 0.0 * standing.values, "velocity")
    assert check_directions(still, MOUNTING, seen(0.003)).margin == 0.0


def test_steps_whose_direction_is_not_known_are_left_out() -> None:
    steps, stream = seen(0.003), odometer(0.003, 0.3)
    unknown = [Turn(turn.start_s, turn.end_s, turn.rotation) for turn in steps[::20]]
    assert check_directions(stream, MOUNTING, [*steps, *unknown]) == check_directions(stream, MOUNTING, steps)


def test_speeds_have_no_direction() -> None:
    t_s = np.arange(0.0, 3.0, 0.1)
    with pytest.raises(InvalidArgument, match="kind"):
        check_directions(SensorStream(t_s, np.ones_like(t_s), "speed"), MOUNTING, seen(0.003))
