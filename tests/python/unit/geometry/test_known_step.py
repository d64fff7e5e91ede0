"""Rotation between two images whose step is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from random_scenes import angle_deg, project
from sfmcpp import InvalidArgument
from sfmcpp.geometry import relative_pose
from sfmcpp.geometry.known_step import rotation_of_step

ROW = np.array([720.0, 1.0, 600.0, 180.0, 0.0])
STEP_M = np.array([0.05, 0.02, 1.5])


def scene(seed: int, count: int = 30, noise_px: float = 0.5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Images (n, 2) of points along a road before and after a step with a turn, and the turn (3, 3)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-15.0, -3.0, 8.0], [15.0, 3.0, 60.0], (count, 3))
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.01, 3)).as_matrix()
    cameras = np.eye(3, 4), np.column_stack([turn, STEP_M])
    before, after = (project(c, ROW, points) + rng.normal(0.0, noise_px, (count, 2)) for c in cameras)
    return before, after, turn


def guess(turn: np.ndarray, off_deg: float = 1.0) -> np.ndarray:
    """A second camera (3, 4) with the step of the scene, turned too far about all axes."""
    off = Rotation.from_rotvec(np.radians(off_deg) * np.ones(3) / np.sqrt(3)).as_matrix()
    return np.column_stack([off @ turn, STEP_M])


def test_the_rotation_is_nearer_than_without_the_step() -> None:
    with_step, without = [], []
    for seed in range(30):
        before, after, turn = scene(seed)
        free = relative_pose(before, after, ROW, min_parallax_px=0.3).camera[:, :3]
        with_step.append(angle_deg(rotation_of_step(before, after, ROW, guess(turn)), turn))
        without.append(angle_deg(free, turn))
    assert np.sqrt(np.mean(np.square(with_step))) < 0.6 * np.sqrt(np.mean(np.square(without)))


def test_exact_matches_give_the_exact_rotation_whatever_the_unit_of_the_step() -> None:
    before, after, turn = scene(0, noise_px=0.0)
    camera = guess(turn)
    camera[:, 3] *= 1e-3
    assert angle_deg(rotation_of_step(before, after, ROW, camera), turn) < 1e-4


def test_wrong_matches_do_not_count() -> None:
    before, after, turn = scene(1)
    after[:8] += np.random.default_rng(2).normal(0.0, 30.0, (8, 2))
    assert angle_deg(rotation_of_step(before, after, ROW, guess(turn)), turn) < 0.15


@pytest.mark.parametrize(("count", "step"), [(3, STEP_M), (30, np.zeros(3))])
def test_too_few_matches_and_no_step_leave_the_rotation(count: int, step: np.ndarray) -> None:
    before, after, turn = scene(3, count)
    camera = np.column_stack([guess(turn)[:, :3], step])
    np.testing.assert_array_equal(rotation_of_step(before, after, ROW, camera), camera[:, :3])


def test_matches_at_the_epipole_alone_leave_the_rotation() -> None:
    pixels = np.tile(np.asarray(ROW)[2:4], (10, 1))
    camera = np.column_stack([np.eye(3), [0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(rotation_of_step(pixels, pixels, ROW, camera), np.eye(3))


def test_a_matrix_that_is_no_rotation_is_refused() -> None:
    before, after, _ = scene(4)
    with pytest.raises(InvalidArgument, match=r"camera\[:, :3\]: must be orthonormal"):
        rotation_of_step(before, after, ROW, np.ones((3, 4)))
