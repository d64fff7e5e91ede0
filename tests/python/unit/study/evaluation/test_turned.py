"""Orientations of another body, or of quaternions in another order, are told as that."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import evaluate
from trajectory_helpers import noisy, path


def with_rotations(trajectory: Trajectory, rotations: np.ndarray) -> Trajectory:
    return trajectory.with_poses(np.concatenate([rotations, trajectory.centres[:, :, None]], axis=2))


def reordered(trajectory: Trajectory, roll: int) -> Trajectory:
    """As if the numbers of each quaternion, w x y z, stood so many places further on."""
    quaternions = np.roll(quaternion_from_rotation(trajectory.rotations), roll, axis=1)
    return with_rotations(trajectory, rotation_from_quaternion(quaternions))


@pytest.mark.parametrize(
    ("roll", "told"),
    [
        (1, "they are read as x y z w, the file seems to have w x y z"),
        (-1, "they are read as w x y z, the file seems to have x y z w"),
    ],
)
def test_quaternions_in_another_order_are_told(roll: int, told: str) -> None:
    truth = path(80)
    assert told in evaluate(reordered(noisy(truth), roll), truth).warning


def test_poses_of_another_body_are_told_with_how_they_are_turned() -> None:
    truth = path(80)
    turn = Rotation.from_rotvec([0.0, np.radians(90.0), 0.0]).as_matrix()
    found = evaluate(with_rotations(noisy(truth), noisy(truth).rotations @ turn), truth)
    assert (
        "all poses are turned by about 90° about axes of their own: they are of another body" in found.warning
    )


def test_sound_orientations_and_those_that_nothing_explains_are_not_spoken_of() -> None:
    truth = path(80)
    assert evaluate(noisy(truth), truth).warning == ""
    anyhow = Rotation.random(len(truth), random_state=0).as_matrix()
    assert evaluate(with_rotations(truth, anyhow), truth).warning == ""


def test_a_body_that_never_turns_does_not_tell_the_order_of_quaternions() -> None:
    truth = path(80)
    still = with_rotations(truth, np.tile(truth.rotations[:1], (80, 1, 1)))
    assert "quaternions" not in evaluate(reordered(still, 1), still).warning
