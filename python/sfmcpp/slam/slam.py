"""The SLAM loop (thesis algorithm 10)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from sfmcpp.model import Trajectory
from sfmcpp.model.problem import FloatArray
from sfmcpp.sensors import register_by_distances
from sfmcpp.slam.fusing import fuse
from sfmcpp.slam.initialisation import Initialiser
from sfmcpp.slam.localisation import Follower, locate
from sfmcpp.slam.mapping import adjust, triangulate_new
from sfmcpp.slam.sensing import MotionSensor, SensorSuite
from sfmcpp.slam.sequence import TrackSequence, View, common
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap


@dataclass
class KeyframeRecord:
    """What happened at one keyframe, for the report.

    Attributes
    ----------
    frame : int
        Number of the frame.
    t_s : float
        Its time [s].
    inliers : int
        Points of the map that it saw.
    new_points : int
        Points that it gave to the map.
    milliseconds : dict of str to float
        Time of each stage [ms].
    weights : dict of str to float
        λ of each sensor's constraint.
    conflicts : dict of str to float
        By how many standard deviations each sensor disagrees with the images.
    """

    frame: int
    t_s: float
    inliers: int
    new_points: int
    milliseconds: dict[str, float] = field(default_factory=dict)
    weights: dict[str, float] = field(default_factory=dict)
    conflicts: dict[str, float] = field(default_factory=dict)


@dataclass
class SlamResult:
    """What a run found.

    Attributes
    ----------
    world : WorldMap or None
        The map; None if it never started.
    poses : dict of int to (3, 4) float64
        Pose of every frame that has one.
    records : list of KeyframeRecord
        One per keyframe after the first three.
    lost : list of int
        Frames after the start whose images say too little: their poses are predicted at constant velocity.
    bridged : list of int
        Frames whose pose follows from the frame before alone, the length of the step from the speed so far.
    metric : bool
        Whether the map is in metres, by the distances of an odometer; else its unit is its own.
    message : str
        Why there is no map, or empty.
    """

    world: WorldMap | None
    poses: dict[int, FloatArray]
    records: list[KeyframeRecord]
    lost: list[int]
    bridged: list[int] = field(default_factory=list)
    metric: bool = False
    message: str = ""

    def trajectory(self, t_s: FloatArray) -> Trajectory:
        """All frames with a pose, in order."""
        frames = sorted(self.poses)
        return Trajectory(t_s[frames], np.stack([self.poses[k] for k in frames]))

    def keyframe_trajectory(self) -> Trajectory:
        """Keyframes alone."""
        assert self.world is not None
        keyframes = self.world.keyframes
        return Trajectory(np.array([k.t_s for k in keyframes]), self.world.poses())


class Slam:
    """One run over a sequence; :meth:`step` takes one frame.

    Parameters
    ----------
    sequence : TrackSequence
        What the frames see.
    settings : SlamSettings, optional
        What decides about keyframes, poses and points.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.
    """

    def __init__(
        self,
        sequence: TrackSequence,
        settings: SlamSettings | None = None,
        sensors: Sequence[MotionSensor] = (),
    ) -> None:
        self.sequence = sequence
        self.settings = settings or SlamSettings()
        self.result = SlamResult(None, {}, [], [], message="there is no frame")
        self._sensors = SensorSuite(sensors)
        self._initialiser = Initialiser(sequence, self.settings)
        self._follower = Follower(sequence, self.settings, self._sensors)

    def step(self, frame: int) -> None:
        """Take the next frame."""
        if self.result.world is None:
            self._start(frame)
            return
        view = self.sequence.view(frame)
        clock = _Clock()
        pose = locate(self.result.world, view, self.settings)
        clock.lap("resection")
        if pose is None:
            self._bridge(frame, view, clock)
            return
        self.result.poses[frame] = pose
        if self._is_keyframe(view):
            self._add_keyframe(frame, view, pose, clock)

    def _bridge(self, frame: int, view: View, clock: _Clock) -> None:
        """Too few points are left: go on from the last frame with a pose, by the tracks they share."""
        last = max(self.result.poses)
        doubtful = {*self.result.bridged, *self.result.lost}
        step = self._follower.follow(frame, self.result.poses, doubtful)
        if step is None:
            self.result.lost.append(frame)
            self.result.poses[frame] = self._follower.predict(frame, self.result.poses)
            return
        self.result.bridged.append(frame)
        self.result.poses[frame] = step.pose
        if not step.moved:
            return
        if self._world.keyframes[-1].frame != last:
            self._add_keyframe(last, self.sequence.view(last), self.result.poses[last], clock)
        self._add_keyframe(frame, view, step.pose, clock)

    def _start(self, frame: int) -> None:
        world = self._initialiser.try_frame(frame)
        if world is None:
            self.result.message = self._initialiser.reason
            return
        self.result.world, self.result.message = world, ""
        for earlier in range(world.keyframes[0].frame, frame):
            pose = locate(world, self.sequence.view(earlier), self.settings)
            if pose is not None:
                self.result.poses[earlier] = pose
        for keyframe in world.keyframes:
            self.result.poses[keyframe.frame] = keyframe.pose

    def _register(self) -> None:
        """Bring the map to metres by the distances between the first keyframes (thesis §5.3.3)."""
        keyframes = self._world.keyframes[: self.settings.registration_keyframes]
        if not self._sensors.gives_scale or len(keyframes) < self.settings.registration_keyframes:
            return
        times = [keyframe.t_s for keyframe in keyframes]
        found = [self._sensors.distance(*span) for span in pairwise(times)]
        distances = [d for d in found if d is not None]
        if len(distances) < len(found) or not sum(distances) > 0:
            return
        registration = register_by_distances(self._world.poses(), distances, len(keyframes))
        self._world.transform(registration.similarity)
        for frame, pose in self.result.poses.items():
            self.result.poses[frame] = registration.similarity.apply_to_poses(pose)
        self._sensors.metric = self.result.metric = True

    def _is_keyframe(self, view: View) -> bool:
        world, settings = self._world, self.settings
        last = world.keyframes[-1].view
        here, there = common(view, last)
        if len(here) < settings.keyframe_overlap * len(last.tracks):
            return True
        known = np.count_nonzero(world.known[view.tracks])
        moved = np.linalg.norm(view.pixels[here] - last.pixels[there], axis=1)
        return bool(known < settings.keyframe_min_tracks and np.median(moved) > settings.keyframe_parallax_px)

    def _add_keyframe(self, frame: int, view: View, pose: FloatArray, clock: _Clock) -> None:
        world = self._world
        inliers = np.count_nonzero(world.known[view.tracks])
        t_s = float(self.sequence.t_s[frame])
        measurements = self._sensors.between(world.keyframes[-1].t_s, t_s)
        fused = fuse(world, view, pose, measurements, self.settings)
        world.keyframes.append(Keyframe(frame, t_s, fused.pose, view, fused.constraints))
        clock.lap("weights")
        new_points = triangulate_new(world, self.settings)
        clock.lap("triangulation")
        adjust(world, self.settings)
        clock.lap("adjustment")
        for keyframe in world.keyframes[-self.settings.window :]:
            self.result.poses[keyframe.frame] = keyframe.pose
        if not self._sensors.metric:
            self._register()
        record = KeyframeRecord(frame, t_s, int(inliers), new_points, dict(clock.laps))
        for constraint in fused.constraints:
            record.weights[constraint.measurement.sensor] = constraint.weight
        for selection in fused.selections:
            record.conflicts[selection.constraint.name] = selection.conflict.sigmas
        self.result.records.append(record)

    @property
    def _world(self) -> WorldMap:
        assert self.result.world is not None
        return self.result.world


class _Clock:
    """Milliseconds of each stage."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now


def run_slam(
    sequence: TrackSequence,
    settings: SlamSettings | None = None,
    sensors: Sequence[MotionSensor] = (),
    callback: Callable[[int, SlamResult], None] | None = None,
) -> SlamResult:
    """Run over all frames of a sequence.

    Parameters
    ----------
    sequence : TrackSequence
        What the frames see.
    settings : SlamSettings, optional
        What decides about keyframes, poses and points.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.
    callback : callable, optional
        Called as ``callback(frame, result)`` after each frame.

    Returns
    -------
    SlamResult
        The map and the poses; `message` says why if there is no map.
    """
    slam = Slam(sequence, settings, sensors)
    for frame in range(len(sequence)):
        slam.step(frame)
        if callback is not None:
            callback(frame, slam.result)
    return slam.result
