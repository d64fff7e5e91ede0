"""Drives with known answers: what a camera on a given path sees of given points."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.model import Problem
from sfmcpp.model.frames import View
from sfmcpp.slam import Frame, SlamResult, TrackSequence, WorldMap
from sfmcpp.sources.io.kitti_mat import KittiDrive
from sfmcpp.study.evaluation import evaluate

INTRINSICS = np.array([500.0, 1.0, 320.0, 240.0, 0.0])
STEP_S = 0.1


def sequence_of(problem: Problem) -> TrackSequence:
    """The observations of a synthetic scene as a drive: a frame every tenth of a second."""
    t_s = STEP_S * np.arange(problem.num_cameras)
    return TrackSequence(
        t_s, problem.camera_index, problem.point_index, problem.pixels, problem.intrinsics[0]
    )


def error_m(result: SlamResult, drive: KittiDrive) -> float:
    """Mean distance from the truth, in the world and the metres of the run."""
    return evaluate(result.trajectory(), drive.truth, with_scale=False).mean_3d_error_m


def project(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of world points (n, 3) seen from a pose ``[R | c]``, written out."""
    in_camera = (points - pose[:, 3]) @ pose[:, :3]
    return INTRINSICS[0] * in_camera[:, :2] / in_camera[:, 2:] + INTRINSICS[2:4]


def drive(poses: np.ndarray, sigma_px: float = 0.0, points: int = 300, seed: int = 0) -> TrackSequence:
    """What a camera on that path sees of a cloud of points some metres ahead of its start."""
    rng = np.random.default_rng(seed)
    cloud = rng.uniform([-4, -3, 6], [4, 3, 14], (points, 3))
    pixels = np.stack([project(pose, cloud) for pose in poses])
    noisy = pixels + rng.normal(0, sigma_px, pixels.shape)
    frames, tracks = (index.ravel() for index in np.indices((len(poses), points)))
    t_s = STEP_S * np.arange(len(poses))
    return TrackSequence(t_s, frames, tracks, noisy.reshape(-1, 2), INTRINSICS)


def path(centres: np.ndarray, rotation_vectors: np.ndarray) -> np.ndarray:
    """Poses (n, 3, 4)."""
    rotations = Rotation.from_rotvec(rotation_vectors).as_matrix()
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def small_map(tracks_seen: list[list[int]], unknown: tuple[int, ...] = ()) -> WorldMap:
    """A map whose keyframe k, a step aside from the one before, sees the tracks ``tracks_seen[k]``."""
    count = 1 + max(track for tracks in tracks_seen for track in tracks)
    points = np.random.default_rng(1).uniform([-2, -2, 6], [2, 2, 10], (count, 3))
    world = WorldMap(INTRINSICS)
    for k, tracks in enumerate(tracks_seen):
        pose = np.eye(3, 4)
        pose[0, 3] = 0.5 * k
        seen = np.array(tracks, dtype=np.int32)
        world.add(Frame(10 * k, STEP_S * k, View(seen, project(pose, points[seen]))), pose)
    world.points[:count] = points
    world.points[list(unknown)] = np.nan
    return world
