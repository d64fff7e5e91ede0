"""Where the camera is: from the points of the map, or from the frame before."""

from __future__ import annotations

import heapq
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.geometry import relative_pose, resection, so3
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import predict_pose
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.sequence import Frame, View, common
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap

# Few tracks often fit two poses. One that turns otherwise than a gyroscope says is the wrong one.
_SAME_TURN_RAD = float(np.radians(1.0))


def locate(world: WorldMap, view: View, settings: SlamSettings) -> FloatArray | None:
    """Pose (3, 4) of a view by resection from the points of the map, or None."""
    known = view.only(world.knows(view.tracks))
    if len(known.tracks) < settings.min_inliers:
        return None
    found = resection(
        world.points[known.tracks],
        known.pixels,
        world.intrinsics[0],
        threshold_px=settings.resection_threshold_px,
        min_inliers=settings.min_inliers,
        max_iterations=1000,
        seed=settings.seed,
    )
    return found.camera if found.success else None


@dataclass
class Path:
    """Where the camera was.

    Attributes
    ----------
    between : dict of int to (3, 4) float64
        Pose of each frame that has one and is no keyframe, world_from_camera; the map has those of keyframes.
    times : dict of int to float
        Time of each frame looked at [s].
    world : WorldMap or None
        The map, as soon as there is one.
    """

    between: dict[int, FloatArray] = field(default_factory=dict)
    times: dict[int, float] = field(default_factory=dict)
    world: WorldMap | None = None

    @property
    def poses(self) -> dict[int, FloatArray]:
        """Pose (3, 4) of every frame that has one, put together anew each time."""
        keyframes = self.world.keyframes if self.world else []
        return {**self.between, **{keyframe.frame: keyframe.pose for keyframe in keyframes}}

    def latest(self, count: int, without: Collection[int] = ()) -> dict[int, FloatArray]:
        """Poses of the last `count` frames that have one, in their order."""
        poses = self.poses
        last = heapq.nlargest(count, (k for k in poses if k not in without))[::-1]
        return {number: poses[number] for number in last}

    def transform(self, similarity: Similarity, first: int = 0) -> None:
        """Move the poses between keyframes, of the frames from number `first` on (thesis eq. 5.16)."""
        for number in [k for k in self.between if k >= first]:
            self.between[number] = similarity.apply_to_poses(self.between[number])

    def predict(self, time_s: float) -> FloatArray:
        """Pose (3, 4) at a later time if the camera goes on as between the last two (thesis eqs 1.1–1.3)."""
        latest = self.latest(2)
        *earlier, last = latest
        now = latest[last]
        if not earlier:
            return np.array(now)
        before, first_s, last_s = latest[earlier[0]], self.times[earlier[0]], self.times[last]
        rotation = now[:, :3] @ before[:, :3].T
        rate = so3.log(before[:, :3].T @ now[:, :3]) / (last_s - first_s)
        # The body keeps its velocity in its own axes: it follows a bend.
        velocity = rotation @ (now[:, 3] - before[:, 3]) / (last_s - first_s)
        return predict_pose(now, rate, velocity, time_s - last_s)

    def speed(self, steps: int = 5, without: Collection[int] = ()) -> float:
        """Median speed over the last steps, in units of the map per second."""
        last = self.latest(steps + 1, without)
        if len(last) < 2:
            return 0.0
        centres = np.stack([pose[:, 3] for pose in last.values()])
        lengths = np.linalg.norm(np.diff(centres, axis=0), axis=1)
        return float(np.median(lengths / np.diff([self.times[k] for k in last])))


@dataclass(frozen=True, eq=False)
class Step:
    """Pose (3, 4) of a frame, and whether the camera has moved rather than turned on the spot."""

    pose: FloatArray
    moved: bool


class Follower:
    """Goes on without the map: from the last frame with a pose, by tracks, sensors, or the speed so far.

    Parameters
    ----------
    intrinsics : (5,) float64
        Of the camera.
    settings : SlamSettings
        Thresholds and seed.
    sensors : SensorSuite
        What measures the motion, where there is anything.
    """

    def __init__(self, intrinsics: FloatArray, settings: SlamSettings, sensors: SensorSuite) -> None:
        self._intrinsics, self._settings, self._sensors = intrinsics, settings, sensors

    def follow(
        self, frame: Frame, last: Frame, path: Path, doubtful: Collection[int], *, metric: bool
    ) -> Step | None:
        """Pose by the tracks shared with the last frame; None where they do not tell it."""
        in_before, in_here = common(last.view, frame.view)
        found = relative_pose(
            last.view.pixels[in_before],
            frame.view.pixels[in_here],
            self._intrinsics,
            min_inliers=self._settings.min_inliers,
            min_parallax_px=0.3,
            max_iterations=1000,
            seed=self._settings.seed,
        )
        if found.failure not in ("", "ambiguous", "rotation only"):
            return None
        turn = self._sensors.rotation(last.t_s, frame.t_s)
        if turn is not None and so3.rotation_angle(turn.T @ found.camera[:, :3]) > _SAME_TURN_RAD:
            return None
        moved = found.failure != "rotation only"
        length = self.length(last.t_s, frame.t_s, path, doubtful, metric=metric) if moved else 0.0
        pose = path.poses[last.number]
        rotation = pose[:, :3] @ found.camera[:, :3]
        centre = pose[:, 3] + length * pose[:, :3] @ found.camera[:, 3]
        return Step(np.column_stack([rotation, centre]), moved)

    def predict(self, frame: Frame, path: Path, *, metric: bool) -> FloatArray:
        """Pose by the sensors, and at constant velocity where they are silent (thesis eqs 1.1–1.3)."""
        known = self._sensors.pose(frame.t_s) if metric else None
        if known is not None:
            return known
        guess = path.predict(frame.t_s)
        ((last, now),) = path.latest(1).items()
        start_s = path.times[last]
        turn = self._sensors.rotation(start_s, frame.t_s)
        rotation = guess[:, :3] if turn is None else now[:, :3] @ turn
        centre = self._sensors.centre(frame.t_s, rotation) if metric else None
        if centre is None:
            centre = now[:, 3] + self._step(guess, now, start_s, frame.t_s, metric=metric)
        return np.asarray(np.column_stack([rotation, centre]))

    def length(
        self, start_s: float, end_s: float, path: Path, doubtful: Collection[int], *, metric: bool
    ) -> float:
        """Length of the way between two times: measured, or by the speed so far."""
        distance = self._sensors.distance(start_s, end_s) if metric else None
        return path.speed(without=doubtful) * (end_s - start_s) if distance is None else distance

    def _step(
        self, guess: FloatArray, now: FloatArray, start_s: float, end_s: float, *, metric: bool
    ) -> FloatArray:
        step = np.asarray(guess[:, 3] - now[:, 3])
        distance = self._sensors.distance(start_s, end_s) if metric else None
        if distance is None:
            return step
        length = float(np.linalg.norm(step))
        return np.asarray(distance * (step / length if length > 0 else now[:, 2]))
