"""Localisation: pose of a frame from the points of the map, or relative to the frame before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import relative_pose, resection, resection_of_rotation, so3
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, View, common
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap

# Few tracks often fit two poses. One that turns otherwise than a gyroscope says is the wrong one.
SAME_TURN_RAD = float(np.radians(1.0))
# What a gyroscope says is supported where it leaves this share of the inliers of the best pose …
_SUPPORT = 0.9
# … and of this share of the points, where there is no such pose.
_LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Located:
    """Pose (3, 4) of a view, and the one that the images alone say; None where they say none."""

    pose: FloatArray
    seen: FloatArray | None


def locate(
    world: WorldMap, view: View, settings: SlamSettings, rotation: FloatArray | None = None
) -> Located | None:
    """Pose of a view by resection from the points of the map, or None.

    The `rotation` (3, 3) that a gyroscope tells, world_from_camera, is kept where the images support it
    about as well as the one they like best.
    """
    known = view.only(world.knows(view.tracks))
    if len(known.tracks) < settings.min_inliers:
        return None
    points, row = world.points[known.tracks], world.intrinsics[0]
    threshold_px, least = settings.resection_threshold_px, settings.min_inliers
    free = resection(
        points,
        known.pixels,
        row,
        threshold_px=threshold_px,
        min_inliers=least,
        max_iterations=1000,
        seed=settings.seed,
    )
    if rotation is not None:
        least = max(least, math.ceil(_SUPPORT * max(free.num_inliers, _LEAST_SHARE * len(points))))
        rotated = resection_of_rotation(
            points,
            known.pixels,
            row,
            rotation,
            threshold_px=threshold_px,
            min_inliers=least,
            seed=settings.seed,
        )
        if rotated.success:
            return Located(rotated.camera, free.camera if free.success else None)
    return Located(free.camera, free.camera) if free.success else None


def expected_rotation(world: WorldMap, sensors: SensorSuite, time_s: float) -> FloatArray | None:
    """Rotation (3, 3) world_from_camera that a gyroscope tells, from the keyframe before that time on."""
    before = next((k for k in reversed(world.keyframes) if k.t_s < time_s), None)
    turn = None if before is None else sensors.rotation(before.t_s, time_s)
    return None if before is None or turn is None else before.pose[:, :3] @ turn


@dataclass(frozen=True, eq=False)
class Step:
    """Pose (3, 4) of a frame, and whether the camera has moved rather than turned on the spot."""

    pose: FloatArray
    moved: bool


class Follower:
    """Goes on without the map: from the last frame with a pose, by tracks, sensors, or the speed so far.

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
        if turn is not None and so3.rotation_angle(turn.T @ found.camera[:, :3]) > SAME_TURN_RAD:
            return None
        moved = found.failure != "rotation only"
        length = self.length(last.t_s, frame.t_s, result) if moved else 0.0
        pose = result.poses[last.number]
        rotation = pose[:, :3] @ found.camera[:, :3]
        centre = pose[:, 3] + length * pose[:, :3] @ found.camera[:, 3]
        return Step(np.column_stack([rotation, centre]), moved)

    def predict(self, frame: Frame, result: SlamResult) -> FloatArray:
        """Pose by the sensors, and at constant velocity where they are silent (thesis eqs 1.1–1.3)."""
        path, metric = result.path, result.metric
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
            distance = self._sensors.distance(start_s, frame.t_s) if metric else None
            centre = now[:, 3] + _predicted_step(guess, now, distance)
        return np.asarray(np.column_stack([rotation, centre]))

    def length(self, start_s: float, end_s: float, result: SlamResult) -> float:
        """Length of the way between two times: measured, or by the speed so far."""
        distance = self._sensors.distance(start_s, end_s) if result.metric else None
        if distance is None:
            return result.path.speed(without=result.doubtful) * (end_s - start_s)
        return distance


def _predicted_step(guess: FloatArray, now: FloatArray, distance: float | None) -> FloatArray:
    """Step (3,) from one pose to the next as guessed, of the `distance` measured if there is one."""
    step = np.asarray(guess[:, 3] - now[:, 3])
    if distance is None:
        return step
    length = float(np.linalg.norm(step))
    return np.asarray(distance * (step / length if length > 0 else now[:, 2]))
