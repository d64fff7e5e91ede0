"""Frames between keyframes go where an adjustment has moved these."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.geometry import Similarity
from sfmcpp.slam import Path
from slam_helpers import STEP_S, small_map


def path_between(shares: list[float]) -> Path:
    """Two keyframes, of frames 0 and 10, and frames at those shares of the time between, or after."""
    world = small_map([[0, 1, 2], [0, 1, 2]])
    times = {0: 0.0, 10: STEP_S} | {int(10 * share): share * STEP_S for share in shares}
    poses = {}
    for share in shares:
        pose = np.eye(3, 4)
        pose[:, 3] = [0.5 * share, 0.1, -0.2]
        poses[int(10 * share)] = pose
    return Path(poses, times, world)


def test_a_map_that_moves_as_one_takes_its_frames_along() -> None:
    path = path_between([0.3, 0.7, 1.5])
    assert path.world is not None
    whole = Similarity(1.0, Rotation.from_rotvec([0.1, -0.4, 0.2]).as_matrix(), np.array([3.0, 1.0, -2.0]))
    expected = {frame: whole.apply_to_poses(pose) for frame, pose in path.between.items()}
    before = path.world.poses.copy()
    path.world.transform(whole)
    path.follow(before)
    for frame, pose in expected.items():
        np.testing.assert_allclose(path.between[frame], pose, atol=1e-12)


def test_a_keyframe_that_moves_alone_takes_along_by_time() -> None:
    path = path_between([0.25])
    assert path.world is not None
    before = path.world.poses.copy()
    start = path.between[2].copy()
    path.world.poses[1, :, 3] += [0.0, 0.8, 0.0]
    path.follow(before)
    np.testing.assert_allclose(
        path.between[2] - start, np.outer([0, 0.8 * 0.25, 0], [0, 0, 0, 1]), atol=1e-12
    )


def test_nothing_moves_before_the_first_keyframe_that_has_moved() -> None:
    path = path_between([0.5, 1.5])
    assert path.world is not None
    before = path.world.poses.copy()
    path.follow(before)
    np.testing.assert_array_equal(path.between[5][:, 3], [0.25, 0.1, -0.2])
