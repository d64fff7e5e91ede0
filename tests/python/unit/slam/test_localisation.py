"""Poses without a map: going on as before."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.slam import Path


def path_of(poses: dict[int, np.ndarray], *t_s: float) -> Path:
    """A path with these poses, of frames at these times."""
    return Path(poses, dict(enumerate(t_s)))


def screw(count: int) -> dict[int, np.ndarray]:
    """Poses of a body that turns and advances by the same amount at every step, in its own axes."""
    turn, advance = Rotation.from_rotvec([0.05, -0.12, 0.3]), np.array([0.2, -0.1, 1.5])
    rotation, centre = Rotation.from_rotvec([0.4, 0.2, -1.0]), np.array([3.0, 2.0, -1.0])
    poses = {}
    for frame in range(count):
        poses[frame] = np.column_stack([rotation.as_matrix(), centre])
        centre = centre + rotation.apply(advance)
        rotation = rotation * turn
    return poses


def test_a_constant_motion_goes_on_exactly() -> None:
    poses = screw(6)
    expected = poses.pop(5)
    found = path_of(poses, 0.0, 0.1, 0.2, 0.3, 0.4).predict(0.5)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_straight_motion_goes_on_in_proportion_to_time() -> None:
    start, now = np.eye(3, 4), np.eye(3, 4)
    now[:, 3] = [0.1, 0.0, 0.4]
    found = path_of({0: start, 1: now}, 1.0, 1.2).predict(1.9)
    np.testing.assert_allclose(found[:, 3], [0.45, 0.0, 1.8])
    np.testing.assert_allclose(found[:, :3], np.eye(3), atol=1e-15)


def test_a_single_pose_stays() -> None:
    pose = screw(1)[0]
    np.testing.assert_array_equal(path_of({0: pose}, 0.0).predict(0.1), pose)


def test_the_speed_is_the_median_of_the_last_steps() -> None:
    centres = [0.0, 50.0, 51.0, 52.0, 53.0, 153.0, 154.0]
    poses = {k: np.column_stack([np.eye(3), [x, 0, 0]]) for k, x in enumerate(centres)}
    times = 0.5 * np.arange(7)
    assert path_of(poses, *times).speed() == pytest.approx(2.0)
    assert path_of(poses, *times).speed(without=[6]) == pytest.approx(2.0)
    assert path_of({0: poses[0]}, *times).speed() == 0.0
