"""A camera in the hand of somebody who walks round a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_positive
from sfmcpp.sources.synthetic.body_motion import BodySensors, Sway, SyntheticDrive, stamps
from sfmcpp.sources.synthetic.image_geometry import UP, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.sight import Sight, enters
from sfmcpp.sources.synthetic.tracker import Tracker, track

_EYE_HEIGHT_M = 1.5
_TABLE_M = np.array([1.4, 0.9, 0.75])
_TOP_M = 0.04
_THINGS = 10
_THING_M = (np.array([0.08, 0.08, 0.05]), np.array([0.3, 0.3, 0.35]))
_POINTS_PER_M2 = 250.0
_ROOM_M = np.array([6.0, 5.0, 2.6])
_WALL_POINTS_PER_M2 = 6.0
# The hand wanders [m] and tilts [rad], fluently (thesis §5.4.3.1).
_WANDER_M = np.array([0.02, 0.02, 0.015])
_TILT_RAD = np.deg2rad([2.0, 2.0, 1.5])
_HAND_HZ = (0.05, 0.5)
# A point on a box is not hidden by the surface it lies on.
_SURFACE_M = 1e-6


@checked()
def table_walk(
    length_m: float = 8.28,
    *,
    seconds: float = 45.0,
    radius_m: float = 1.4,
    frame_hz: float = 30.0,
    focal_px: float = 400.0,
    image_size: tuple[int, int] = (640, 480),
    tracker: Tracker | None = None,
    sensors: BodySensors | None = None,
    seed: int = 0,
) -> SyntheticDrive:
    """A camera carried around a table with objects on it, always looking at its middle.

    Made after the sequence Gyroviz of thesis §5.4.3.1: 8.28 m and 1,360 images in a room, a camera of 640 ×
    480 pixels with a short focal length, rigidly joined to a navigation system whose orientations are
    accurate to 0.01°. The table and its objects occlude each other; the walls are visible behind them.

    Parameters
    ----------
    length_m : float
        Way walked along the circle [m].
    seconds : float
        Time taken [s].
    radius_m : float
        Radius of the circle around the middle of the table [m].
    frame_hz, focal_px, image_size, tracker, sensors, seed
        As for :func:`vehicle_drive`.

    Returns
    -------
    SyntheticDrive
        Without odometer. Its world has its origin on the floor below the middle of the table, z up; the body
        frame is the camera's.

    Raises
    ------
    InvalidArgument
        If a length, time or rate is not positive.
    """
    lengths = {"length_m": length_m, "seconds": seconds, "radius_m": radius_m, "frame_hz": frame_hz}
    for name, value in lengths.items():
        require_positive(name, value)
    geometry = ImageGeometry("calibrated", focal_px, image_size)
    scene_rng, body_rng, track_rng, sensor_rng = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(4)
    )
    boxes = _furniture(scene_rng)
    points = np.concatenate([boxes.surface_points(_POINTS_PER_M2, scene_rng), _walls(scene_rng)])
    walker = _Walker(length_m / seconds / radius_m, radius_m, body_rng)
    t_s = stamps(seconds, frame_hz)
    poses = walker.poses(t_s)
    tracks = track(
        geometry,
        poses,
        points,
        tracker or Tracker(),
        track_rng,
        Sight(float(2 * np.linalg.norm(_ROOM_M)), boxes.hides),
    )
    chosen = sensors or BodySensors()
    return SyntheticDrive(
        t_s,
        tracks.frame_index,
        tracks.track_index,
        tracks.pixels,
        len(tracks.point_index),
        geometry.intrinsics(1)[0],
        np.eye(3),
        np.zeros(3),
        None,
        chosen.gyro(walker.poses, seconds, sensor_rng),
        chosen.navigation(walker.poses, seconds, sensor_rng),
        Trajectory(t_s, poses),
    )


class _Walker:
    """The camera on its way round: where it is when, hand-held."""

    def __init__(self, rate_rad_s: float, radius_m: float, rng: np.random.Generator) -> None:
        self._rate_rad_s, self._radius_m = rate_rad_s, radius_m
        self._sway = Sway(np.concatenate([_WANDER_M, _TILT_RAD]), *_HAND_HZ, rng)

    def poses(self, t_s: FloatArray) -> FloatArray:
        """(n, 3, 4) poses world_from_camera at times (n,) [s]."""
        angles, sway = self._rate_rad_s * t_s, self._sway.at(t_s)
        circle = self._radius_m * np.column_stack([np.cos(angles), np.sin(angles)])
        centres = np.column_stack([circle, np.full(len(t_s), _EYE_HEIGHT_M)]) + sway[:, :3]
        poses = looking_at(centres, np.array([0.0, 0.0, _TABLE_M[2]]), UP)
        poses[:, :, :3] = poses[:, :, :3] @ so3.exp(sway[:, 3:])
        return poses


def _furniture(rng: np.random.Generator) -> Boxes:
    """The table top, and things that stand on it."""
    half = _TABLE_M[:2] / 2
    sizes = rng.uniform(*_THING_M, (_THINGS, 3))
    middles = rng.uniform(-1, 1, (_THINGS, 2)) * (half - sizes[:, :2] / 2)
    lower = np.column_stack([middles - sizes[:, :2] / 2, np.full(_THINGS, _TABLE_M[2])])
    upper = np.column_stack([middles + sizes[:, :2] / 2, _TABLE_M[2] + sizes[:, 2]])
    return Boxes(
        np.concatenate([[[*-half, _TABLE_M[2] - _TOP_M]], lower]),
        np.concatenate([[[*half, _TABLE_M[2]]], upper]),
    )


def _walls(rng: np.random.Generator) -> FloatArray:
    """Points on the four walls of the room and on its floor."""
    length, width, height = _ROOM_M
    around_m = 2 * (length + width)
    places = rng.uniform(0, around_m, round(_WALL_POINTS_PER_M2 * around_m * height))
    corners_m = np.cumsum([0.0, length, width, length, width])
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * _ROOM_M[:2] / 2
    walls = np.column_stack(
        [
            *(np.interp(places, corners_m, axis) for axis in outline.T),
            rng.uniform(0, height, len(places)),
        ]
    )
    floor = rng.uniform(-0.5, 0.5, (round(_WALL_POINTS_PER_M2 * length * width), 3)) * [length, width, 0]
    return np.concatenate([walls, floor])


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes with sides along the axes of the world.

    Attributes
    ----------
    lower, upper : (B, 3) float64
        Opposite corners [m].
    """

    lower: FloatArray
    upper: FloatArray

    def surface_points(self, per_m2: float, rng: np.random.Generator) -> FloatArray:
        """(N, 3) points, uniform on all sides but the bottoms; `per_m2` on a square metre, rounded."""
        found = [np.empty((0, 3))]
        for lower, upper in zip(self.lower, self.upper, strict=True):
            size = upper - lower
            for axis, high in ((0, False), (0, True), (1, False), (1, True), (2, True)):
                count = round(per_m2 * float(np.prod(np.delete(size, axis))))
                places = rng.uniform(lower, upper, (count, 3))
                places[:, axis] = upper[axis] if high else lower[axis]
                found.append(places)
        return np.concatenate(found)

    def hides(self, centre: FloatArray, points: FloatArray) -> BoolArray:
        """(N,) whether a box stands between `centre` (3,) and each of `points` (N, 3) (slab method)."""
        way = points - centre
        hidden = np.zeros(len(points), dtype=np.bool_)
        for lower, upper in zip(self.lower + _SURFACE_M, self.upper - _SURFACE_M, strict=True):
            hidden |= enters(centre, way, lower, upper)
        return hidden
