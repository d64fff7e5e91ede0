"""A path that bends in space, and copies of it that drift."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.model import Trajectory


def path(count: int = 60, seed: int = 0, start_s: float = 100.0, step_s: float = 0.1) -> Trajectory:
    """A random walk of poses, about a metre a step."""
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0, 0.05, (count, 3)), axis=0)
    centres = np.cumsum(rng.normal([1, 0.3, 0.1], 0.3, (count, 3)), axis=0)
    rotations = Rotation.from_rotvec(turns).as_matrix()
    poses = np.concatenate([rotations, centres[:, :, None]], axis=2)
    return Trajectory(start_s + step_s * np.arange(count), poses)


def noisy(
    truth: Trajectory, seed: int = 1, position_m: float = 0.2, rotation_rad: float = 0.02
) -> Trajectory:
    """The same path with independent errors on every pose."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(rng.normal(0, rotation_rad, (len(truth), 3))).as_matrix()
    rotations = truth.rotations @ turns
    centres = truth.centres + rng.normal(0, position_m, (len(truth), 3))
    return truth.with_poses(np.concatenate([rotations, centres[:, :, None]], axis=2))
