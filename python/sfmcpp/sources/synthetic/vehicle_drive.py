"""A vehicle with an odometer that drives through a town."""

from __future__ import annotations

from itertools import product

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_above, require_positive
from sfmcpp.sensors import Mounting
from sfmcpp.sources.synthetic.body_motion import BodySensors, Sway, SyntheticDrive, stamps
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.streets import FRONT_HEIGHT_M, StreetGrid
from sfmcpp.sources.synthetic.tracker import Tracker, track

# The body frame has its origin on the road below the rear axle: x forward, y left, z up (ISO 8855).
_MOUNTING = Mounting(Mounting.forward_looking().camera_from_body, np.array([1.5, 0.0, 1.5]))
_STREET_M = 14.0
_ACROSS_M = 36.0
_TURN_RADIUS_M = 8.0
# The wheel is turned over some metres, not at once.
_STEERING_M = 3.0
_STEERING_STEPS = 31
_SLOWEST_SHARE = 0.5
_SLOWING_M = 8.0
_POINTS_PER_M2 = 0.8
_CARS_PER_M = 4.0
_CAR_HEIGHT_M = 1.6
_CAR_WIDTH_M = 2.0
_GRID_STEP_M = 0.01
# Springs: the body rolls, pitches and yaws a little [rad], and bounces [m].
_SWAY_RAD = np.deg2rad([0.3, 0.4, 0.2])
_BOUNCE_M = 0.01
_SPRING_HZ = (0.5, 2.0)


@checked()
def vehicle_drive(
    length_m: float = 130.0,
    *,
    speed_m_s: float = 5.0,
    frame_hz: float = 30.0,
    max_depth_m: float = 40.0,
    focal_px: float = 400.0,
    image_size: tuple[int, int] = (640, 480),
    tracker: Tracker | None = None,
    sensors: BodySensors | None = None,
    seed: int = 0,
) -> SyntheticDrive:
    """A vehicle that drives along a street, turns left twice and returns by the next street.

    Made after the sequence Odiaac of thesis §5.4.2: 130 m in a town, a camera of 640 × 480 pixels with a
    short focal length at 30 Hz, an odometer at 25 Hz. Points lie on house fronts and on cars parked on both
    sides.

    Parameters
    ----------
    length_m : float
        Way driven [m]; more than 45, the turns and the stretch between them.
    speed_m_s : float
        Speed on straight stretches [m/s]; half of it in turns.
    frame_hz : float
        Frames a second.
    max_depth_m : float
        Depth beyond which the camera sees nothing [m].
    focal_px : float
        Focal length [px].
    image_size : (int, int)
        Width and height [px].
    tracker : Tracker, optional
        Corner tracker. Default: a poor one, see :class:`Tracker`.
    sensors : BodySensors, optional
        Odometer, gyroscope and navigation system. Default: those of the thesis' table 1.1.
    seed : int
        Same seed, same drive.

    Returns
    -------
    SyntheticDrive
        Its world has the street along x, z up; the truth is that of the camera.

    Raises
    ------
    InvalidArgument
        If a length or rate is not positive, or the way is too short.
    """
    path = _Path(length_m)
    for name, value in {"speed_m_s": speed_m_s, "frame_hz": frame_hz, "max_depth_m": max_depth_m}.items():
        require_positive(name, value)
    geometry = ImageGeometry("calibrated", focal_px, image_size)
    scene_rng, body_rng, track_rng, sensor_rng = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(4)
    )
    vehicle = _Vehicle(path, speed_m_s, body_rng)
    t_s = stamps(vehicle.seconds, frame_hz)
    cameras = _MOUNTING.camera_poses(vehicle.poses(t_s))
    grid = StreetGrid((path.along_m, _ACROSS_M), _STREET_M)
    points = _points_of_town(grid, path, max_depth_m, scene_rng)
    tracks = track(
        geometry,
        cameras,
        points,
        tracker or Tracker(),
        track_rng,
        Sight(max_depth_m, grid.hides),
    )
    chosen = sensors or BodySensors()
    ticks = stamps(vehicle.seconds, chosen.odometer_hz)
    return SyntheticDrive(
        t_s,
        tracks.frame_index,
        tracks.track_index,
        tracks.pixels,
        len(tracks.point_index),
        geometry.intrinsics(1)[0],
        _MOUNTING.camera_from_body,
        _MOUNTING.lever_arm_m,
        chosen.odometer(vehicle.speeds(ticks), ticks, sensor_rng),
        chosen.gyro(vehicle.poses, vehicle.seconds, sensor_rng),
        chosen.navigation(vehicle.poses, vehicle.seconds, sensor_rng),
        Trajectory(t_s, cameras),
    )


class _Path:
    """Down one street, left, and left again into the next: straights and quarter circles, joined smoothly."""

    def __init__(self, length_m: float) -> None:
        quarter_m = 0.5 * np.pi * _TURN_RADIUS_M
        between_m = _ACROSS_M - 2 * _TURN_RADIUS_M
        require_above("length_m", length_m, 2 * quarter_m + between_m, "both turns and the way between them")
        straight_m = 0.5 * (length_m - 2 * quarter_m - between_m)
        self.length_m = length_m
        self.along_m = straight_m + _TURN_RADIUS_M + _STREET_M
        self._bends_m = np.cumsum([straight_m, quarter_m, between_m, quarter_m])
        self.driven_m = np.linspace(0, length_m, int(np.ceil(length_m / _GRID_STEP_M)) + 1)
        middles_m = 0.5 * (self.driven_m[1:] + self.driven_m[:-1])
        headings = self.headings(middles_m)
        steps = np.diff(self.driven_m)[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
        self._places = np.cumsum(np.concatenate([[[_STREET_M, 0.0]], steps]), axis=0)

    def headings(self, driven_m: FloatArray) -> FloatArray:
        """(n,) directions of travel after so many metres, from x to the left [rad]."""
        near_m = np.asarray(driven_m)[:, None] + np.linspace(-0.5, 0.5, _STEERING_STEPS) * _STEERING_M
        return np.asarray(np.interp(near_m, self._bends_m, [0.0, np.pi / 2, np.pi / 2, np.pi]).mean(axis=1))

    def places(self, driven_m: FloatArray) -> FloatArray:
        """(n, 2) places after so many metres (n,)."""
        return np.stack([np.interp(driven_m, self.driven_m, axis) for axis in self._places.T], axis=1)

    def slowness(self, driven_m: FloatArray) -> FloatArray:
        """(n,) from 0 on straights to 1 in the turns, smoothly."""
        start, end = self._bends_m[0], self._bends_m[-1]
        outside_m = np.maximum(start - driven_m, driven_m - end)
        return np.asarray(0.5 - 0.5 * np.tanh(outside_m / _SLOWING_M))


class _Vehicle:
    """The body on its way: where it is when, and how fast."""

    def __init__(self, path: _Path, speed_m_s: float, rng: np.random.Generator) -> None:
        self._path = path
        driven_m = path.driven_m
        speeds = speed_m_s * (1 - (1 - _SLOWEST_SHARE) * path.slowness(driven_m))
        pace = 0.5 * (1 / speeds[1:] + 1 / speeds[:-1])
        t_s = np.concatenate([[0.0], np.cumsum(np.diff(driven_m) * pace)])
        self._speeds, self._t_s, self._driven_m = speeds, t_s, driven_m
        self.seconds = float(t_s[-1])
        self._sway = Sway(np.append(_SWAY_RAD, _BOUNCE_M), *_SPRING_HZ, rng)

    def speeds(self, t_s: FloatArray) -> FloatArray:
        """(n,) speeds at times (n,) [m/s]."""
        return np.interp(t_s, self._t_s, self._speeds)

    def poses(self, t_s: FloatArray) -> FloatArray:
        """(n, 3, 4) poses world_from_body at times (n,) [s]."""
        driven_m = np.interp(t_s, self._t_s, self._driven_m)
        sway = self._sway.at(t_s)
        upright = np.zeros((len(t_s), 3))
        upright[:, 2] = self._path.headings(driven_m)
        rotations = so3.exp(upright) @ so3.exp(sway[:, :3])
        centres = np.column_stack([self._path.places(driven_m), sway[:, 3]])
        return np.concatenate([rotations, centres[:, :, None]], axis=2)


def _points_of_town(grid: StreetGrid, path: _Path, reach_m: float, rng: np.random.Generator) -> FloatArray:
    """(N, 3) points of the fronts and cars within reach of the path."""
    blocks = [_points_of_block(grid, np.array(corner), rng) for corner in product(range(-2, 3), repeat=2)]
    points = np.concatenate(blocks)
    way = path.places(np.linspace(0, path.length_m, int(path.length_m) + 1))
    nearest_m = np.min(np.linalg.norm(points[:, None, :2] - way, axis=2), axis=1)
    return np.asarray(points[nearest_m <= reach_m])


def _points_of_block(grid: StreetGrid, corner: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points on the four fronts of a block, and on the cars before them."""
    pitch = np.array(grid.pitch_m)
    middle, size = (corner + 0.5) * pitch, pitch - grid.street_m
    around_m = 2 * float(size.sum())
    fronts = _outline(size, grid.reliefs_m(int(around_m * FRONT_HEIGHT_M * _POINTS_PER_M2), rng), rng)
    cars = _outline(size, rng.uniform(0.5, _CAR_WIDTH_M + 0.5, int(around_m * _CARS_PER_M)), rng)
    heights = np.append(rng.uniform(0, FRONT_HEIGHT_M, len(fronts)), rng.uniform(0, _CAR_HEIGHT_M, len(cars)))
    return np.column_stack([middle + np.concatenate([fronts, cars]), heights])


def _outline(size: FloatArray, before_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Places (n, 2) about the origin, so far (n,) before the sides of a rectangle."""
    count = len(before_m)
    along, side = rng.uniform(-1, 1, count), rng.choice([-1.0, 1.0], count)
    first = rng.uniform(size=count) < size[0] / size.sum()
    half = 0.5 * size
    on_first = np.column_stack([along * half[0], side * (half[1] + before_m)])
    on_second = np.column_stack([side * (half[0] + before_m), along * half[1]])
    return np.where(first[:, None], on_first, on_second)
