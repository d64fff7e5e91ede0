"""The first three keyframes (thesis §3.3.2): relative pose, triangulation, resection, adjustment."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba import solve
from sfmcpp.model.problem import FloatArray
from sfmcpp.mvg import relative_pose
from sfmcpp.slam.localisation import locate
from sfmcpp.slam.mapping import drop_outliers, triangulate_new
from sfmcpp.slam.sequence import TrackSequence, common
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap


class Initialiser:
    """Looks for a frame that, with the first one, fixes the scene up to scale.

    Parameters
    ----------
    sequence : TrackSequence
        What the frames see.
    settings : SlamSettings
        Thresholds and seed.
    """

    def __init__(self, sequence: TrackSequence, settings: SlamSettings) -> None:
        self._sequence = sequence
        self._settings = settings
        self._first: int | None = None
        self.reason = "no frame yet"

    def try_frame(self, frame: int) -> WorldMap | None:
        """Offer the next frame; the map of the first three keyframes once there is one."""
        if self._first is None:
            self._first = frame
            self.reason = f"frame {frame} is alone"
            return None
        first, last = self._sequence.view(self._first), self._sequence.view(frame)
        in_first, in_last = common(first, last)
        if len(in_first) < 2 * self._settings.min_inliers:
            self.reason = f"frames {self._first} and {frame} share {len(in_first)} tracks only"
            self._first = frame
            return None
        moved = np.linalg.norm(last.pixels[in_last] - first.pixels[in_first], axis=1)
        if frame - self._first < 2 or np.median(moved) < self._settings.start_parallax_px:
            self.reason = f"the image moves {np.median(moved):.3g} px from frame {self._first} to {frame}"
            return None
        return self._map_of(frame, first.pixels[in_first], last.pixels[in_last])

    def _map_of(self, frame: int, first: FloatArray, last: FloatArray) -> WorldMap | None:
        assert self._first is not None
        settings = self._settings
        found = relative_pose(
            first,
            last,
            self._sequence.intrinsics,
            min_parallax_px=settings.start_parallax_px / 2,
            max_iterations=1000,
            seed=settings.seed,
        )
        if not found.success:
            self.reason = f"frames {self._first} and {frame}: {found.message}"
            return None
        world = WorldMap(self._sequence.num_tracks, self._sequence.intrinsics)
        identity = np.eye(3, 4)
        world.keyframes = [self._keyframe(self._first, identity), self._keyframe(frame, found.camera)]
        triangulate_new(world, settings)
        return world if self._insert_middle(world) else None

    def _insert_middle(self, world: WorldMap) -> bool:
        """Add the frame half-way by resection, and adjust all three."""
        settings = self._settings
        middle = (world.keyframes[0].frame + world.keyframes[1].frame) // 2
        pose = locate(world, self._sequence.view(middle), settings)
        if pose is None:
            self.reason = f"frame {middle} between the first keyframes has no pose"
            return False
        world.keyframes.insert(1, self._keyframe(middle, pose))
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

    def _keyframe(self, frame: int, pose: FloatArray) -> Keyframe:
        return Keyframe(frame, float(self._sequence.t_s[frame]), pose, self._sequence.view(frame))
