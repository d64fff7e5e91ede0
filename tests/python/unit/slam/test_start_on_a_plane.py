"""A map may start in front of a wall: of two poses that a plane leaves, frames between tell the right one."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry import so3
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import run_slam
from sfmcpp.sources.frames import TrackSequence

NUM_FRAMES, PERIOD_S = 30, 0.1
WALL_M = 6.0
INTRINSICS = np.array([500.0, 1.0, 320.0, 240.0, 0.0])


def along_a_wall(seed: int) -> tuple[TrackSequence, FloatArray]:
    """Tracks of points on a wall, and the poses (n, 3, 4) of a camera that moves before it."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-15, 15, 6000), rng.uniform(-10, 10, 6000), np.full(6000, WALL_M)])
    direction = rng.normal(size=3) * [1, 0.5, 0.6]
    direction /= np.linalg.norm(direction)
    tilt = so3.exp(rng.normal(size=3) * [0.2, 0.3, 0.05])
    poses, frames, tracks, pixels = [], [], [], []
    for k in range(NUM_FRAMES):
        rotation = tilt @ so3.exp(np.array([0.02 * np.sin(k / 9), 0.1 * np.sin(k / 15), 0]))
        centre = 0.05 * k * direction + [0, 0.05 * np.sin(k / 9), 0]
        in_camera = (points - centre) @ rotation
        px = 500 * in_camera[:, :2] / in_camera[:, 2:] + [320, 240]
        seen = np.flatnonzero((in_camera[:, 2] > 0.3) & (px > 0).all(axis=1) & (px < [640, 480]).all(axis=1))
        poses.append(np.column_stack([rotation, centre]))
        frames.append(np.full(len(seen), k))
        tracks.append(seen)
        pixels.append(px[seen] + rng.normal(0, 0.3, (len(seen), 2)))
    found = np.concatenate(frames), np.concatenate(tracks), np.concatenate(pixels)
    return TrackSequence(np.arange(NUM_FRAMES) * PERIOD_S, *found, INTRINSICS), np.array(poses)


def step(poses: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and direction (3,) from the first pose to the last, in the axes of the first."""
    first, last = poses[0], poses[-1]
    way = first[:, :3].T @ (last[:, 3] - first[:, 3])
    return first[:, :3].T @ last[:, :3], way / np.linalg.norm(way)


# Each of these began with the other pose, turned by 10 to 30° and moving 45 to 75° off the true way.
@pytest.mark.parametrize("seed", [11, 15, 19, 34])
def test_the_pose_that_sees_all_of_the_wall_is_taken(seed: int) -> None:
    sequence, truth = along_a_wall(seed)
    found = run_slam(sequence).trajectory()
    assert len(found.t_s) == NUM_FRAMES
    (turn, way), (true_turn, true_way) = step(found.poses), step(truth)
    assert np.degrees(so3.rotation_angle(true_turn.T @ turn)) < 1.0
    assert way @ true_way > np.cos(np.radians(5.0))
