"""The hand of the axes and the clock of positions, told beside a camera and a reckoned way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import Mounting, SensorStream, Trajectory, check_bends, check_position_clock

T_S = np.arange(0.0, 60.0, 0.1)
AHEAD = Mounting.forward_looking()


def drive(bend_rad: float = 1.2) -> Trajectory:
    """A camera on a car that winds to and fro and changes its speed."""
    heading = 0.4 + bend_rad * np.sin(0.35 * T_S) + 0.5 * bend_rad * np.sin(0.11 * T_S)
    speed = 8 + 2 * np.sin(0.2 * T_S)
    steps = 0.1 * speed[:, None] * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    body = Rotation.from_rotvec(np.outer(heading, [0, 0, 1])).as_matrix()
    return Trajectory(
        T_S, AHEAD.camera_poses(np.concatenate([body, np.cumsum(steps, 0)[:, :, None]], axis=2))
    )


def fixes(camera: Trajectory, seed: int = 0, late_s: float = 0.0) -> SensorStream:
    places = camera.centres + np.random.default_rng(seed).normal(size=(len(camera), 3))
    return SensorStream(camera.t_s + late_s, places, "position")


def with_values(stream: SensorStream, values: np.ndarray) -> SensorStream:
    return SensorStream(stream.t_s, values, "position")


@pytest.mark.parametrize("seed", range(3))
def test_swapped_axes_bend_to_the_other_side(seed: int) -> None:
    correct = fixes(drive(), seed)
    found = check_bends(correct, drive())
    assert not found.is_mirrored
    assert found.error_rad < 0.5 * found.mirrored_error_rad
    swapped = check_bends(with_values(correct, correct.values[:, [1, 0, 2]]), drive())
    assert swapped.is_mirrored
    assert swapped.mirrored_error_rad == pytest.approx(found.error_rad, abs=1e-9)


def test_where_the_map_lies_does_not_matter() -> None:
    turn, camera = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), drive()
    turned = Trajectory(T_S, np.concatenate([turn @ camera.rotations, np.zeros((len(T_S), 3, 1))], axis=2))
    here, there = check_bends(fixes(camera), camera), check_bends(fixes(camera), turned)
    assert here.error_rad == pytest.approx(there.error_rad, abs=1e-9)


def test_up_is_a_direction_of_any_length() -> None:
    camera = drive()
    unit, long = (check_bends(fixes(camera), camera, [0.0, -length, 0.0]) for length in (1.0, 8.0))
    assert long == unit
    with pytest.raises(InvalidArgument, match="up_in_camera: is zero"):
        check_bends(fixes(camera), camera, np.zeros(3))


def test_a_straight_way_and_one_of_few_metres_tell_no_side() -> None:
    straight = fixes(drive(bend_rad=0.02))
    assert not check_bends(with_values(straight, straight.values[:, [1, 0, 2]]), drive(0.02)).is_mirrored
    assert check_bends(fixes(drive()), drive(), sigma_m=60.0).bends == 0


@pytest.mark.parametrize("late_s", [-1.0, 0.0, 0.7])
@pytest.mark.parametrize("seed", range(3))
def test_the_clock_is_found_to_what_it_says(late_s: float, seed: int) -> None:
    found = check_position_clock(fixes(drive(), seed, late_s), drive())
    assert found.offset_s == pytest.approx(-late_s, abs=3 * found.sigma_s)
    assert 0.005 < found.sigma_s < 0.1
    assert found.is_off == (late_s != 0)


def test_a_way_of_another_scale_that_drifts_tells_the_clock_still() -> None:
    camera = drive()
    turn = Rotation.from_rotvec(np.outer(0.004 * T_S, [0, 0, 1])).as_matrix()
    steps = 1.3 * np.einsum("nij,nj->ni", turn, np.diff(camera.centres, axis=0, prepend=0))
    drifted = Trajectory(T_S, np.concatenate([camera.rotations, np.cumsum(steps, 0)[:, :, None]], axis=2))
    found = check_position_clock(fixes(camera, late_s=1.0), drifted)
    assert found.is_off
    assert found.offset_s == pytest.approx(-1.0, abs=0.2)


def test_an_even_straight_way_and_a_stand_tell_no_clock() -> None:
    centres = np.outer(T_S, [5.0, 1.0, 0.0])
    even = Trajectory(T_S, np.concatenate([drive().rotations, centres[:, :, None]], axis=2))
    assert not check_position_clock(fixes(even, late_s=1.0), even).is_off
    still = Trajectory(T_S, np.concatenate([drive().rotations, np.zeros((len(T_S), 3, 1))], axis=2))
    assert check_position_clock(fixes(still), still).sigma_s == np.inf
    assert check_position_clock(fixes(drive()), Trajectory(T_S[:20], drive().poses[:20])).sigma_s == np.inf


def test_other_kinds_and_no_sigma_are_refused() -> None:
    speed = SensorStream(T_S, np.ones((len(T_S), 1)), "speed")
    with pytest.raises(InvalidArgument, match="position"):
        check_bends(speed, drive())
    with pytest.raises(InvalidArgument, match="position"):
        check_position_clock(speed, drive())
    with pytest.raises(InvalidArgument, match="sigma_m"):
        check_bends(fixes(drive()), drive(), sigma_m=0.0)
