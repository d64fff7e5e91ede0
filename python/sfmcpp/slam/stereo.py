"""Right images of a pair with common axes: additional views, tied to their left cameras by the baseline."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sfmcpp.geometry.epipolar import inverse_depths
from sfmcpp.geometry.pinhole import to_normalised
from sfmcpp.map import LocalProblem
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import BoolArray, IndexArray
from sfmcpp.slam.world_map import WorldMap

RIGID = "stereo"
# Standard deviation of the pose of a right camera relative to its left one [m and rad]: smaller than that by
# images. With damping proportional to the diagonal of JᵀJ, pairs ten times as stiff hardly move in ten steps.
_RIGID_SIGMA = 1e-4
# Fewest points that determine the scale of a map.
_FEWEST = 10


@dataclass(frozen=True, eq=False)
class StereoProblem:
    """Part of a map with what right images see of it.

    Attributes
    ----------
    world : WorldMap
        The map.
    local : LocalProblem
        The part, with the left images alone.
    problem : Problem
        The same with the right cameras and their observations behind the left ones; where there are none, the
        problem of `local` itself.
    rows : (m,) int
        Keypoint of the left image that belongs to each observation of a right one.
    rigid : list of ConstraintGroup
        What holds each right camera beside its left one.
    """

    world: WorldMap
    local: LocalProblem
    problem: Problem
    rows: IndexArray = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    rigid: list[ConstraintGroup] = field(default_factory=list)

    def take(self) -> None:
        """Let the map take over what has moved."""
        left = self.local.problem
        left.cameras[:] = self.problem.cameras[: left.num_cameras]
        left.points[:] = self.problem.points
        self.world.take(self.local)

    def drop(self, outliers: BoolArray, min_views: int) -> None:
        """Forget the observations `outliers` (M,), and where points with too few views of both sides are."""
        num_left = len(self.local.rows)
        self.world.right_px[self.rows[outliers[num_left:]]] = np.nan
        self.world.forget(self.local.rows[outliers[:num_left]])
        views = np.bincount(self.problem.point_index[~outliers], minlength=self.problem.num_points)
        self.world.points[self.local.points[views < min_views]] = np.nan


def with_right_views(world: WorldMap, local: LocalProblem) -> StereoProblem:
    """Add the right images of a part of a map; none before the map is in metres."""
    left = local.problem
    seen = np.isfinite(world.right_px[local.rows, 0])
    if world.right_centre_m is None or not world.stereo or not seen.any():
        return StereoProblem(world, local, left)
    pairs, camera_index = np.unique(left.camera_index[seen], return_inverse=True)
    beside = np.column_stack([np.eye(3), world.right_centre_m])
    right = left.cameras[pairs]
    right[:, :, 3] += right[:, :, :3] @ world.right_centre_m
    rows = local.rows[seen]
    problem = Problem(
        left.camera_model,
        np.concatenate([left.cameras, right]),
        left.intrinsics,
        left.points,
        np.concatenate([left.camera_index, left.num_cameras + camera_index]).astype(np.int32),
        np.concatenate([left.point_index, left.point_index[seen]]),
        np.concatenate([left.pixels, world.right_px[rows]]),
        intrinsics_index=np.concatenate([left.intrinsics_index, left.intrinsics_index[pairs]]),
        fixed_cameras=np.concatenate([left.fixed_cameras, left.fixed_cameras[pairs]]),
        fixed_intrinsics=left.fixed_intrinsics,
    )
    tied = np.flatnonzero(~left.fixed_cameras[pairs])
    cameras = np.column_stack([pairs[tied], left.num_cameras + tied]).astype(np.int32)
    values, weight = np.tile(beside, (len(tied), 1, 1)), beside.size / _RIGID_SIGMA**2
    rigid = ConstraintGroup("displacement-pose", cameras, values, weight=weight, name=RIGID)
    return StereoProblem(world, local, problem, rows, [rigid])


def metres_per_unit(world: WorldMap) -> float | None:
    """Length of the unit of a map in metres: 1 where it is in metres, else by the right images."""
    return 1.0 if world.metric else metres_by_right_images(world)


def metres_by_right_images(world: WorldMap) -> float | None:
    """Length of the unit of a map in metres by its right images; None where they determine too little.

    Each point of the map gives one, by its depth in metres: of a right camera at (b, 0, 0) that is b over the
    normalised disparity. The median of the nearer half is taken, nearer in the map: a choice by disparity
    would be biased by its noise.
    """
    if world.right_centre_m is None:
        return None
    points = world.keypoint_points
    rows = np.flatnonzero((points >= 0) & np.isfinite(world.right_px[:, 0]))
    rows = rows[world.known[points[rows]]]
    if len(rows) < _FEWEST:
        return None
    poses = world.poses[world.keypoint_images[rows]]
    depth = np.einsum("ni,ni->n", world.points[points[rows]] - poses[:, :, 3], poses[:, :, 2])
    intrinsics = world.intrinsics[0]
    left, right = (to_normalised(px[rows], intrinsics) for px in (world.keypoints, world.right_px))
    near = depth <= np.median(depth)
    inverse = float(np.median((inverse_depths(left, right, world.right_centre_m) * depth)[near]))
    return 1 / inverse if inverse > 0 else None
