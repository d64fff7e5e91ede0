"""The first three keyframes (thesis §3.3.2) of a map, and of a new part of it after the images had lost it.

Relative pose, triangulation, resection, adjustment; then, for a new part, its place in the map.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sfmcpp.geometry import relative_pose
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.slam.fusing import usual_weights
from sfmcpp.slam.localisation import Follower, locate
from sfmcpp.slam.mapping import drop_outliers, triangulate_new
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import solve

# Tracks run out when fewer than this many times the inliers of a pose are left.
_RUNNING_OUT = 3
# Frames kept while the camera stands: the oldest are given up beyond.
_PATIENCE = 1000


class Initialiser:
    """Looks for a frame that, with the first one, fixes the scene up to scale.

    Parameters
    ----------
    intrinsics : (5,) float64
        Of the camera.
    settings : SlamSettings
        Thresholds and seed.

    Attributes
    ----------
    frames : list of Frame
        Those offered, from the one that would be the first keyframe.
    reason : str
        Why there is no map yet.
    """

    def __init__(self, intrinsics: FloatArray, settings: SlamSettings) -> None:
        self._intrinsics, self._settings = intrinsics, settings
        self.frames: list[Frame] = []
        self.reason = "no frame yet"

    def try_frame(self, frame: Frame) -> WorldMap | None:
        """Offer the next frame; the map of the first three keyframes once there is one."""
        self.frames = [*self.frames[-_PATIENCE:], frame]
        if len(self.frames) == 1:
            self.reason = f"frame {frame.number} is alone"
            return None
        first = self.frames[0]
        in_first, in_last = common(first.view, frame.view)
        if len(in_first) < 2 * self._settings.min_inliers:
            self.reason = f"frames {first.number} and {frame.number} share {len(in_first)} tracks only"
            self.frames = [frame]
            return None
        before, after = first.view.pixels[in_first], frame.view.pixels[in_last]
        moved_px = np.median(np.linalg.norm(after - before, axis=1))
        if len(self.frames) < 3 or moved_px < self._parallax_px(len(in_first)):
            self.reason = f"the image moves {moved_px:.3g} px from frame {first.number} to {frame.number}"
            return None
        return self._map_of(before, after)

    def _parallax_px(self, shared: int) -> float:
        """Parallax to wait for: half of it will do once tracks run out, before there are none left."""
        share = 0.5 if shared < _RUNNING_OUT * self._settings.min_inliers else 1.0
        return share * self._settings.start_parallax_px

    def _map_of(self, before: FloatArray, after: FloatArray) -> WorldMap | None:
        settings, first, last = self._settings, self.frames[0], self.frames[-1]
        found = relative_pose(
            before,
            after,
            self._intrinsics,
            min_parallax_px=settings.start_parallax_px / 2,
            max_iterations=1000,
            seed=settings.seed,
        )
        if not found.success:
            self.reason = f"frames {first.number} and {last.number}: {found.message}"
            return None
        pair = self._map([(first, np.eye(3, 4)), (last, found.camera)])
        triangulate_new(pair, settings)
        middle = self.frames[(len(self.frames) - 1) // 2]
        pose = locate(pair, middle.view, settings)
        if pose is None:
            self.reason = f"frame {middle.number} between the first keyframes has no pose"
            return None
        world = self._map([(first, np.eye(3, 4)), (middle, pose), (last, found.camera)])
        tracks = np.flatnonzero(pair.known)
        world.points[tracks] = pair.points[tracks]
        return world if self._adjusted(world) else None

    def _map(self, keyframes: list[tuple[Frame, FloatArray]]) -> WorldMap:
        world = WorldMap(self._intrinsics)
        for frame, pose in keyframes:
            world.add(frame, pose)
        return world

    def _adjusted(self, world: WorldMap) -> bool:
        """Adjust all three keyframes; whether enough points are left."""
        settings = self._settings
        local = world.around(3)
        local.problem.fixed_cameras[0] = True
        solve(local.problem, threads=1, loss="huber", loss_scale_px=2.0)
        world.take(local)
        drop_outliers(world, local, settings)
        shared = len(common(world.keyframes[0].view, world.keyframes[2].view)[0])
        points = np.count_nonzero(world.known)
        if points < max(settings.min_inliers, settings.start_point_ratio * shared):
            self.reason = f"the first three keyframes leave {points} points only, from {shared} tracks"
            return False
        return True


def rejoin(result: SlamResult, part: WorldMap, sensors: SensorSuite, follower: Follower) -> None:
    """Put a part that has just started where its frames were followed to, and into the map.

    Its first keyframe stays at the pose that bridges the gap; its scale makes its way as long as the odometer
    says, or the speed before the loss. From here on sensors constrain its keyframes as all others.

    Parameters
    ----------
    result : SlamResult
        The run; its map takes the part in.
    part : WorldMap
        Three keyframes of a frame and a unit of their own.
    sensors : SensorSuite
        What measures the motion.
    follower : Follower
        Tells the length of a way.
    """
    world = result.world
    assert world is not None
    lengths = [follower.length(a.t_s, b.t_s, result) for a, b in pairwise(part.keyframes)]
    own = np.linalg.norm(np.diff(part.poses[:, :, 3], axis=0), axis=1).sum()
    scale = sum(lengths) / own if sum(lengths) > 0 else 1.0
    # The first camera of the part is its world.
    anchor = result.poses[part.keyframes[0].frame]
    for before, keyframe in pairwise(part.keyframes):
        rotation = anchor[:, :3] @ keyframe.pose[:, :3]
        measured = sensors.measure(before.t_s, keyframe.t_s, rotation, metric=result.metric)
        keyframe.constraints = usual_weights(world, measured)
    world.append(part, Similarity(float(scale), anchor[:, :3], anchor[:, 3]))
