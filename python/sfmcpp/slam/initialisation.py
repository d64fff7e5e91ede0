"""The first three keyframes (thesis §3.3.2): relative pose, triangulation, resection, adjustment."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import relative_pose
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam.localisation import locate
from sfmcpp.slam.mapping import drop_outliers, triangulate_new
from sfmcpp.slam.sequence import Frame, common
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap
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
        outer = [Keyframe.of(first, np.eye(3, 4)), Keyframe.of(last, found.camera)]
        pair = self._map(outer)
        triangulate_new(pair, settings)
        middle = self.frames[(len(self.frames) - 1) // 2]
        pose = locate(pair, middle.view, settings)
        if pose is None:
            self.reason = f"frame {middle.number} between the first keyframes has no pose"
            return None
        world = self._map([outer[0], Keyframe.of(middle, pose), outer[1]])
        tracks = np.flatnonzero(pair.known)
        world.points[tracks] = pair.points[tracks]
        return world if self._adjusted(world) else None

    def _map(self, keyframes: list[Keyframe]) -> WorldMap:
        world = WorldMap(self._intrinsics)
        for keyframe in keyframes:
            world.add(keyframe)
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
