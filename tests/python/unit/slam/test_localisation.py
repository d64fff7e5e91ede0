"""Poses without a map: going on as before."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.slam import TrackSequence
from sfmcpp.slam.localisation import predict, speed
from slam_helpers import INTRINSICS


def blind(*t_s: float) -> TrackSequence:
    """Frames at these times that see nothing."""
    return TrackSequence(t_s, [], [], np.empty((0, 2)), INTRINSICS)


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
    found = predict(blind(0.0, 0.1, 0.2, 0.3, 0.4, 0.5), poses, 5)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_straight_motion_goes_on_in_proportion_to_time() -> None:
    start, now = np.eye(3, 4), np.eye(3, 4)
    now[:, 3] = [0.1, 0.0, 0.4]
    found = predict(blind(1.0, 1.2, 1.9), {0: start, 1: now}, 2)
    np.testing.assert_allclose(found[:, 3], [0.45, 0.0, 1.8])
    np.testing.assert_allclose(found[:, :3], np.eye(3), atol=1e-15)


def test_a_single_pose_stays() -> None:
    pose = screw(1)[0]
    np.testing.assert_array_equal(predict(blind(0.0, 0.1), {0: pose}, 1), pose)


def test_the_speed_is_the_median_of_the_last_steps() -> None:
    centres = [0.0, 50.0, 51.0, 52.0, 53.0, 153.0, 154.0]
    poses = {k: np.column_stack([np.eye(3), [x, 0, 0]]) for k, x in enumerate(centres)}
    times = blind(*(0.5 * np.arange(7)))
    assert speed(times, poses) == pytest.approx(2.0)
    assert speed(times, {0: poses[0]}) == 0.0
