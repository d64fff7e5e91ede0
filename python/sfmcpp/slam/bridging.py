"""Bridging of gaps: poses of frames that see too little of the map, and the part of the map after a gap."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice, pairwise

import numpy as np

from sfmcpp.geometry import RelativePose, relative_pose, so3
from sfmcpp.geometry.epipolar import closest_depths
from sfmcpp.geometry.known_step import rotation_of_step
from sfmcpp.geometry.pinhole import homogeneous, to_normalised
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.model.rigs import composed
from sfmcpp.slam.fusion import usual_weights
from sfmcpp.slam.localisation import LEAST_PARALLAX_PX, RANSAC_ITERATIONS, SAME_TURN_RAD
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.stereo import metres_per_unit
from sfmcpp.slam.world_map import WorldMap

# A camera stood whose speed would move what it sees by less than this from frame to frame [px]: noise …
_STANDS_PX = 1.0
# … and moves again where a rotation leaves more than this [px].
_MOVES_AGAIN_PX = 2.0
# The usual depth is that of so many keyframes, of the last so many.
_OF_DEPTHS, _MOST_BEFORE = 50, 300
_AHEAD = np.array([0.0, 0.0, 1.0])
# Fewer points do not tie a keyframe behind a stop to the map: if one of them is wrong, nothing denies it.
_FEWEST_TIES = 3


@dataclass(frozen=True, eq=False)
class Step:
    """Pose (3, 4) of a frame, world_from_camera; whether the camera moved, and had stood until then."""

    pose: FloatArray
    moved: bool
    stood: bool


class Follower:
    """Continues the path without the map, by tracks from frame to frame, sensors, or the speed so far.

    Parameters
    ----------
    intrinsics : (5,) or (12,) float64
        Of the camera.
    settings : SlamSettings
        Thresholds and seed.
    sensors : SensorSuite
        What measures the motion, where there is anything.
    """

    def __init__(self, intrinsics: FloatArray, settings: SlamSettings, sensors: SensorSuite) -> None:
        self._intrinsics, self._settings, self._sensors = intrinsics, settings, sensors

    def follow(self, frame: Frame, last: Frame, result: SlamResult) -> Step | None:
        """Pose by the tracks shared with the last frame; None where they do not determine it."""
        before, here = _shared_pixels(last, frame)
        length = self.length(last.t_s, frame.t_s, result)
        found = relative_pose(
            before,
            here,
            self._intrinsics,
            min_inliers=self._settings.min_inliers,
            min_parallax_px=LEAST_PARALLAX_PX if length is not None else _MOVES_AGAIN_PX,
            max_iterations=RANSAC_ITERATIONS,
            seed=self._settings.seed,
        )
        if found.failure not in ("", "ambiguous", "rotation only"):
            return None
        turn = self._sensors.rotation(last.t_s, frame.t_s)
        if turn is not None and so3.rotation_angle(turn.T @ found.camera[:, :3]) > SAME_TURN_RAD:
            return None
        moved, stood = found.failure != "rotation only", length is None
        pose = result.path.pose_of(last.number)
        measured = self._measured_step(last.t_s, frame.t_s, found.camera[:, :3], result)
        if measured is not None and turn is None:
            seen = rotation_of_step(before, here, self._intrinsics, measured)
            measured = self._measured_step(last.t_s, frame.t_s, seen, result)
        if measured is not None:
            return Step(_moved_by(pose, measured), moved, stood)
        if moved and length is None:
            length = self.usual_depth(result) / _depth_of_step(found, before, here, self._intrinsics)
        way = (length if moved and length else 0.0) * found.camera[:, 3]
        return Step(_moved_by(pose, np.column_stack([found.camera[:, :3], way])), moved, stood)

    def predict(self, frame: Frame, result: SlamResult) -> FloatArray:
        """Pose by the sensors, else at constant velocity (thesis eqs 1.1–1.3)."""
        path, metric = result.path, result.metric
        known = self._sensors.pose(frame.t_s) if metric else None
        if known is not None:
            return known
        guess = path.predict(frame.t_s)
        ((last, now),) = path.latest(1).items()
        start_s = path.times[last]
        # As a product of two poses it would treble what they lack of a rotation, with every frame of a gap.
        turn = so3.exp(so3.log(now[:, :3].T @ guess[:, :3]))
        step = self._measured_step(start_s, frame.t_s, turn, result)
        if step is None:
            way = now[:, :3].T @ (guess[:, 3] - now[:, 3])
            step = self._usual_step(start_s, frame.t_s, np.column_stack([turn, way]), metric)
        pose = _moved_by(now, step)
        centre = self._sensors.centre(frame.t_s, pose[:, :3]) if metric else None
        return pose if centre is None else np.column_stack([pose[:, :3], centre])

    def _usual_step(self, start_s: float, end_s: float, guess: FloatArray, metric: bool) -> FloatArray:
        """The motion `guess` (3, 4) start_from_end, with the turn and the length of the way as measured."""
        turn = self._sensors.rotation(start_s, end_s)
        distance = self._sensors.distance(start_s, end_s) if metric else None
        way = _of_length(guess[:, 3], distance)
        return np.column_stack([guess[:, :3] if turn is None else turn, way])

    def _measured_step(
        self, start_s: float, end_s: float, seen: FloatArray, result: SlamResult
    ) -> FloatArray | None:
        """Motion (3, 4) start_from_end by an odometer of velocities; None where there is none to trust.

        Few tracks leave the direction of a step of a tenth of a second open by ten degrees, and with it the
        turn by tenths of one. That is the gyroscope's, else the one `seen` (3, 3).
        """
        measured = self._sensors.measure(start_s, end_s, seen, metric=result.metric, previous=np.eye(3))
        usable = (m for m in measured if m.sensor not in self._sensors.in_conflict and not m.doubtful)
        return next((np.asarray(m.value) for m in usable if m.kind == "displacement-pose"), None)

    def length(self, start_s: float, end_s: float, result: SlamResult) -> float | None:
        """Length of the path between two times [s], by an odometer, else by the speed so far.

        None where that is the speed of a camera that stood: noise, at which it will not drive off. The scale
        of the map would change by a factor of five at such a stop, and by 1e15 in a drive of an hour.
        """
        distance = self._sensors.distance(start_s, end_s) if result.metric else None
        if distance is not None:
            return distance
        length = result.path.speed(without=result.doubtful) * (end_s - start_s)
        stood = length * self._intrinsics[0] < _STANDS_PX * self.usual_depth(result)
        return None if stood else length

    def usual_depth(self, result: SlamResult) -> float:
        """Median depth of what the latest keyframes with enough points see, in units of the map; 0: none.

        Depths tell the scale of a scene worse than a speed does, but better than no speed.
        """
        assert result.world is not None
        latest = (keyframe.depths for keyframe in reversed(result.world.keyframes[-_MOST_BEFORE:]))
        enough = (depths for depths in latest if len(depths) >= self._settings.keyframe_min_tracks)
        return float(np.median([float(np.median(depths)) for depths in islice(enough, _OF_DEPTHS)] or [0.0]))


def untied(frame: Frame, world: WorldMap) -> Frame:
    """A frame behind a stop, without the points of the map where it sees one or two.

    They would decide on the scale of all that follows: a single one that had come loose while the camera
    stood has made a map six times smaller. Where it did not stand they hold the scale better than nothing.
    """
    known = world.knows(frame.view.tracks)
    few = 0 < np.count_nonzero(known) < _FEWEST_TIES
    return replace(frame, view=frame.view.only(~known)) if few else frame


def _shared_pixels(last: Frame, frame: Frame) -> tuple[FloatArray, FloatArray]:
    """Pixels (n, 2) of the tracks that two frames share, in each of them."""
    in_last, in_frame = common(last.view, frame.view)
    return last.view.pixels[in_last], frame.view.pixels[in_frame]


def _depth_of_step(found: RelativePose, before: FloatArray, here: FloatArray, row: FloatArray) -> float:
    """Median depth of the inliers of a step, whose length is one."""
    rays_before, rays_here = (homogeneous(to_normalised(p[found.inliers], row)) for p in (before, here))
    depths, _, factor = closest_depths(rays_before, rays_here @ found.camera[:, :3].T, found.camera[:, 3])
    return float(np.median(depths / np.maximum(factor, np.finfo(float).tiny)))


def _moved_by(pose: FloatArray, step: FloatArray) -> FloatArray:
    """Pose (3, 4) world_from_camera after a motion (3, 4) start_from_end."""
    return np.asarray(composed(pose[None], step[None])[0])


def _of_length(way: FloatArray, distance: float | None) -> FloatArray:
    """A step (3,) of the length `distance`, if that was measured; ahead where it has no direction."""
    if distance is None:
        return way
    length = float(np.linalg.norm(way))
    return distance * (way / length if length > 0 else _AHEAD)


def rejoin(result: SlamResult, part: WorldMap, sensors: SensorSuite, follower: Follower) -> None:
    """Add a new part of the map after a gap.

    Its first keyframe gets the pose to which its frame was followed. Its scale is that at which its path is
    as long as the odometer or the speed before the gap has it; after a stop, that of the usual depth. Sensors
    constrain its keyframes like all others, the first one across the gap, so that adjustments may still move
    the part.

    Parameters
    ----------
    result : SlamResult
        The run; its map takes the part in.
    part : WorldMap
        Three keyframes in a frame and a unit of their own.
    sensors : SensorSuite
        What measures the motion.
    follower : Follower
        What followed the frames across the gap.
    """
    world = result.world
    assert world is not None
    scale = _scale_of(part, result, follower)
    # The first camera of the part is its world.
    anchor = result.path.pose_of(part.keyframes[0].frame)
    last, previous = world.keyframes[-1], world.keyframes[-1].pose[:, :3]
    for keyframe in part.keyframes:
        rotation = anchor[:, :3] @ keyframe.pose[:, :3]
        measured = sensors.measure(last.t_s, keyframe.t_s, rotation, metric=result.metric, previous=previous)
        keyframe.constraints = usual_weights(world, measured)
        last, previous = keyframe, rotation
    world.append(part, Similarity(scale, anchor[:, :3], anchor[:, 3]))


def _scale_of(part: WorldMap, result: SlamResult, follower: Follower) -> float:
    """Scale of a new part in the map, or the metres of its right images."""
    metres = metres_per_unit(part) if result.world is not None and result.world.metric else None
    if metres is not None:
        return float(metres)
    lengths = [follower.length(a.t_s, b.t_s, result) for a, b in pairwise(part.keyframes)]
    known = [length for length in lengths if length is not None]
    if len(known) < len(lengths):
        return follower.usual_depth(result) / float(np.median(part.keyframes[0].depths))
    own = float(np.linalg.norm(np.diff(part.poses[:, :, 3], axis=0), axis=1).sum())
    return sum(known) / own if sum(known) > 0 else 1.0
