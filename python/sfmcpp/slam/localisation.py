"""Where the camera is: from the points of the map, or from the frame before."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from sfmcpp.model import so3
from sfmcpp.model.problem import FloatArray
from sfmcpp.mvg import relative_pose, resection
from sfmcpp.slam.sensing import SensorSuite
from sfmcpp.slam.sequence import TrackSequence, View, common
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap


def locate(world: WorldMap, view: View, settings: SlamSettings) -> FloatArray | None:
    """Pose (3, 4) of a view by resection from the points of the map, or None."""
    known = view.only(world.known[view.tracks])
    if len(known.tracks) < settings.min_inliers:
        return None
    found = resection(
        world.points[known.tracks],
        known.pixels,
        world.intrinsics,
        threshold_px=settings.resection_threshold_px,
        min_inliers=settings.min_inliers,
        max_iterations=1000,
        seed=settings.seed,
    )
    return found.camera if found.success else None


@dataclass(frozen=True, eq=False)
class Step:
    """Pose (3, 4) of a frame, and whether the camera has moved rather than turned on the spot."""

    pose: FloatArray
    moved: bool


class Follower:
    """Goes on without the map: from the last frame with a pose, by tracks, sensors, or the speed so far.

    Parameters
    ----------
    sequence : TrackSequence
        What the frames see.
    settings : SlamSettings
        Thresholds and seed.
    sensors : SensorSuite
        Distances and rotations, where there are any.
    """

    def __init__(self, sequence: TrackSequence, settings: SlamSettings, sensors: SensorSuite) -> None:
        self._sequence, self._settings, self._sensors = sequence, settings, sensors

    def follow(self, frame: int, poses: dict[int, FloatArray], doubtful: Collection[int]) -> Step | None:
        """Pose by the tracks shared with the last frame; None where they do not tell it."""
        last = max(poses)
        before, here = self._sequence.view(last), self._sequence.view(frame)
        in_before, in_here = common(before, here)
        found = relative_pose(
            before.pixels[in_before],
            here.pixels[in_here],
            self._sequence.intrinsics,
            min_inliers=self._settings.min_inliers,
            min_parallax_px=0.3,
            max_iterations=1000,
            seed=self._settings.seed,
        )
        if found.failure not in ("", "ambiguous", "rotation only"):
            return None
        moved = found.failure != "rotation only"
        length = self._length(last, frame, poses, doubtful) if moved else 0.0
        pose = poses[last]
        rotation = pose[:, :3] @ found.camera[:, :3]
        centre = pose[:, 3] + length * pose[:, :3] @ found.camera[:, 3]
        return Step(np.column_stack([rotation, centre]), moved)

    def predict(self, frame: int, poses: dict[int, FloatArray]) -> FloatArray:
        """Pose by the sensors, and at constant velocity where they are silent (thesis eqs 1.1–1.3)."""
        last = max(poses)
        now, guess = poses[last], predict(self._sequence, poses, frame)
        start_s, end_s = self._times(last, frame)
        turn = self._sensors.rotation(start_s, end_s)
        distance = self._distance(start_s, end_s)
        rotation = guess[:, :3] if turn is None else now[:, :3] @ turn
        step = guess[:, 3] - now[:, 3]
        length = float(np.linalg.norm(step))
        if distance is not None:
            step = distance * (step / length if length > 0 else now[:, 2])
        return np.asarray(np.column_stack([rotation, now[:, 3] + step]))

    def _length(
        self, last: int, frame: int, poses: dict[int, FloatArray], doubtful: Collection[int]
    ) -> float:
        start_s, end_s = self._times(last, frame)
        distance = self._distance(start_s, end_s)
        if distance is not None:
            return distance
        return speed(self._sequence, {k: poses[k] for k in poses if k not in doubtful}) * (end_s - start_s)

    def _distance(self, start_s: float, end_s: float) -> float | None:
        return self._sensors.distance(start_s, end_s) if self._sensors.metric else None

    def _times(self, last: int, frame: int) -> tuple[float, float]:
        return float(self._sequence.t_s[last]), float(self._sequence.t_s[frame])


def predict(sequence: TrackSequence, poses: dict[int, FloatArray], frame: int) -> FloatArray:
    """Pose (3, 4) of a frame if the camera goes on as between the last two poses (thesis eqs 1.1–1.3)."""
    last = sorted(poses)[-2:]
    if len(last) < 2:
        return np.array(poses[last[-1]])
    before, now = poses[last[0]], poses[last[1]]
    share = (sequence.t_s[frame] - sequence.t_s[last[1]]) / (sequence.t_s[last[1]] - sequence.t_s[last[0]])
    turn = so3.log(before[:, :3].T @ now[:, :3])
    rotation = now[:, :3] @ so3.exp(share * turn)
    moved = before[:, :3].T @ (now[:, 3] - before[:, 3])
    return np.asarray(np.column_stack([rotation, now[:, 3] + share * now[:, :3] @ moved]))


def speed(sequence: TrackSequence, poses: dict[int, FloatArray], frames: int = 5) -> float:
    """Median speed over the last frames with a pose, in units of the map per second."""
    last = sorted(poses)[-frames - 1 :]
    centres = np.stack([poses[k][:, 3] for k in last])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    return float(np.median(steps / np.diff(sequence.t_s[last]))) if len(steps) else 0.0
