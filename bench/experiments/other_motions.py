"""Simulated drives with motions, mountings and streams that no recorded drive here has: `COURSES`, `CHANGES`.

A body goes along a course given in closed form, past points on both sides and on the ground. Where `Sight`
says nothing else, its camera sees them within forty metres, with noise of half a pixel a frame and half a
pixel a track, and loses one track in twenty a frame. The body tells velocities and rates, with white noise,
as drives of KITTI do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.kitti_mat import KittiDrive

# Axes of a camera that looks ahead, in a body whose x axis points ahead and z up.
_AHEAD = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_FOCAL_PX, _SIZE_PX = 720.0, np.array([1240.0, 376.0])
_LEVER_M = np.array([1.0, 0.3, 0.0])
_FINE_S = 0.005
_NEAR_M, _HEIGHT_M = 2.0, 1.6
_FEWEST_POINTS = 300
_TRACK_PX, _WRONG_PX = 0.5, 3.0
# A car ahead keeps so far away, and comes nearer and goes farther by so much in as many seconds.
_AHEAD_M, _SWINGS_M, _SWINGS_S = 12.0, 1.5, 20.0
_SPEED_SIGMA_M_S, _RATE_SIGMA_RAD_S = 0.02, 0.002
_MIDDLE, _GAP_S, _LATE_S, _EARLY_S = 0.5, 3.0, 5.0, 3.0


@dataclass(frozen=True)
class Sight:
    """What there is to see, and how it is seen.

    Attributes
    ----------
    far_m, aside_m : float
        How far the camera sees, and how far away the walls may be [m].
    points_a_metre : float
        Points for each metre of the way.
    frame_px : float
        Noise of each pixel [px].
    lost_share, wrong_share : float
        Shares of the tracks that end with each frame, and that slide off by some `_WRONG_PX` a frame.
    longest : int
        Frames after which a track ends.
    on_car : int
        Points on a car ahead, which goes with the body.
    """

    far_m: float = 40.0
    aside_m: float = 15.0
    points_a_metre: float = 6.0
    frame_px: float = 0.5
    lost_share: float = 0.05
    wrong_share: float = 0.0
    longest: int = 1_000_000
    on_car: int = 0


@dataclass(frozen=True)
class Course:
    """Speed [m/s], yaw rate [rad/s] and slope [rad]; how the body sways, and how it is seen and measured.

    The phase of the sway wanders, by default: a clock off by the period of a regular one would look right.
    """

    seconds: float
    speed: Callable[[FloatArray], FloatArray]
    yaw_rate: Callable[[FloatArray], FloatArray] = lambda t: 0.25 * np.sin(0.5 * t)
    slope: float = 0.0
    camera_from_body: FloatArray = field(default_factory=lambda: _AHEAD)
    frame_s: float = 0.1
    sensor_s: float = 0.1
    sway_rad: float = 0.004
    wanders_rad: float = 3.0
    sight: Sight = Sight()


def _turned(about: str, angle_deg: float) -> FloatArray:
    """Axes of a camera turned by an angle about an axis of the body."""
    return np.asarray(_AHEAD @ Rotation.from_euler(about, -angle_deg, degrees=True).as_matrix())


def _ramp(t: FloatArray, *knots: tuple[float, float]) -> FloatArray:
    return np.asarray(np.interp(t, *zip(*knots, strict=True)))


def _usual(t: FloatArray) -> FloatArray:
    return np.asarray(7 + 2 * np.sin(0.4 * t))


def _motorway(on_car: int = 0) -> Course:
    """A kilometre at 30 m/s past few and far points."""
    sight = Sight(far_m=120.0, aside_m=30.0, points_a_metre=0.8, on_car=on_car)
    return Course(34, lambda t: 30 + np.sin(0.3 * t), lambda t: 0.02 * np.sin(0.2 * t), sight=sight)


COURSES = {
    "usual": Course(30, _usual),
    "stands first": Course(35, lambda t: _ramp(t, (0, 0), (15, 0), (19, 8), (35, 8))),
    "reverses first": Course(
        30,
        lambda t: _ramp(t, (0, 0), (1, -1.5), (5, -1.5), (6, 0), (7, 0), (10, 6), (30, 7)),
        lambda t: _ramp(t, (0, 0), (1, -0.25), (5, -0.25), (6, 0), (30, 0)) + 0.2 * np.sin(0.5 * t) * (t > 7),
    ),
    "slow start": Course(35, lambda t: _ramp(t, (0, 0.3), (10, 0.8), (18, 6), (35, 7))),
    "u-turn": Course(
        30,
        lambda t: _ramp(t, (0, 6), (10, 6), (12, 2.5), (18, 2.5), (21, 7), (30, 7)),
        lambda t: np.where((t > 12) & (t < 18), np.pi / 6, 0.05 * np.sin(t)),
    ),
    "spiral ramp": Course(30, lambda t: 3 + 0 * t, lambda t: 0.45 + 0 * t, slope=0.1),
    "looks left": Course(30, _usual, camera_from_body=_turned("z", 90)),
    "looks back": Course(30, _usual, camera_from_body=_turned("z", 180)),
    "5 Hz": Course(30, _usual, frame_s=0.2),
    "walk": Course(30, lambda t: 1.2 + 0.2 * np.sin(11 * t), sway_rad=0.05),
    "hand-held": Course(30, lambda t: 1.2 + 0.2 * np.sin(11 * t), sway_rad=0.15),
    "motorway": _motorway(),
    "motorway, a car ahead": _motorway(on_car=15),
    "a car ahead": Course(30, _usual, sight=Sight(on_car=40)),
    "heavy braking": Course(
        30, lambda t: _ramp(t, (0, 18), (8, 18), (10.2, 0), (12, 0), (17, 14), (22, 14), (23.7, 0), (30, 8))
    ),
    "stop-and-go": Course(
        42,
        lambda t: _ramp(
            t, (0, 5), (4, 5), (6, 0), (14, 0), (16, 5), (19, 5), (21, 0), (31, 0), (33, 5), (42, 6)
        ),
        lambda t: (
            0.02 * np.abs(_ramp(t, (0, 1), (5, 1), (7, 0), (14, 0), (16, 1), (20, 0), (32, 0), (34, 1)))
        ),
    ),
    "roundabout": Course(
        30,
        lambda t: _ramp(t, (0, 9), (6, 9), (9, 5), (22, 5), (26, 9)),
        lambda t: _ramp(t, (9, 0), (9.5, -0.5), (10.5, -0.5), (11, 0.42), (20, 0.42), (21, -0.5), (22, 0)),
    ),
    "one bend": Course(
        35,
        lambda t: _ramp(t, (0, 13), (26, 13), (29, 6), (35, 6)),
        lambda t: _ramp(t, (28, 0), (29, 0.35), (33, 0.35), (34, 0)),
    ),
    "regular sway": Course(30, _usual, wanders_rad=0.0),
    "wrong tracks": Course(30, _usual, sight=Sight(wrong_share=0.2)),
    "short tracks": Course(30, _usual, sight=Sight(longest=3)),
    "noise of 2 px": Course(30, _usual, sight=Sight(frame_px=2.0)),
    "30 Hz": Course(30, _usual, frame_s=1 / 30),
    "sensors at 200 Hz": Course(30, _usual, sensor_s=0.005),
}


@cache
def simulated(name: str, seed: int = 0) -> KittiDrive:
    """A drive along a course, or such a drive changed: ``usual, ticks``."""
    if name in COURSES:
        return _driven(COURSES[name], seed)
    name, _, change = name.rpartition(", ")
    return CHANGES[change](_driven(COURSES[name], seed))


def _driven(course: Course, seed: int) -> KittiDrive:
    rng = np.random.default_rng(seed)
    fine_s = np.arange(0.0, course.seconds + 1.0, _FINE_S)
    body, velocity, rates = _motion(course, fine_s)
    at = (np.arange(0.0, course.seconds, course.frame_s) / _FINE_S).round().astype(int)
    camera = _camera_poses(body[at], course.camera_from_body)
    scene, on_car = _scene(body, course.sight, rng), _points_on_car(body[at], fine_s[at], course.sight, rng)
    rows = _observations(camera, scene, on_car, course.sight, rng)
    ticks = np.arange(0, len(fine_s) - 1, round(course.sensor_s / _FINE_S))
    noise = [s * rng.normal(size=(len(ticks), 3)) for s in (_SPEED_SIGMA_M_S, _RATE_SIGMA_RAD_S)]
    return KittiDrive(
        fine_s[at],
        *rows,
        num_tracks=int(rows[1].max()) + 1,
        focal_px=np.full(2, _FOCAL_PX),
        principal_point_px=_SIZE_PX / 2,
        baseline_m=0.5,
        camera_from_body=course.camera_from_body,
        lever_arm_m=_LEVER_M,
        velocity=SensorStream(fine_s[ticks], velocity[ticks] + noise[0], "velocity", "velocity"),
        angular_rate=SensorStream(fine_s[ticks], rates[ticks] + noise[1], "angular_rate", "gyro"),
        truth=Trajectory(fine_s[at], camera),
    )


def _motion(course: Course, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses (n, 3, 4) of the body, its velocities and its rates (n, 3) in its axes."""
    yaw = np.cumsum(course.yaw_rate(t_s)) * _FINE_S
    moving = np.minimum(np.abs(course.speed(t_s)), 1.0)
    phases = np.outer(t_s, [7.0, 9.0]) + course.wanders_rad * np.sin(np.outer(t_s, [0.9, 0.7]))
    sway = course.sway_rad * moving[:, None] * np.sin(phases)
    rotations = Rotation.from_euler("ZYX", np.column_stack([yaw, sway[:, 0] - course.slope, sway[:, 1]]))
    ahead = course.speed(t_s)[:, None] * Rotation.from_euler(
        "ZY", np.column_stack([yaw, np.full_like(yaw, -course.slope)])
    ).apply([1.0, 0.0, 0.0])
    centres = np.cumsum(ahead, axis=0) * _FINE_S
    rates = (rotations[:-1].inv() * rotations[1:]).as_rotvec() / _FINE_S
    poses = np.concatenate([rotations.as_matrix(), centres[:, :, None]], axis=2)
    return poses, rotations.apply(ahead, inverse=True), np.vstack([rates, rates[-1]])


def _camera_poses(body: FloatArray, camera_from_body: FloatArray) -> FloatArray:
    rotations = body[:, :, :3] @ camera_from_body.T
    return np.concatenate([rotations, body[:, :, :3] @ _LEVER_M[:, None] + body[:, :, 3:]], axis=2)


def _scene(body: FloatArray, sight: Sight, rng: np.random.Generator) -> FloatArray:
    """Points (n, 3): walls on both sides of the way and the ground, also beyond its ends."""
    length = np.linalg.norm(np.diff(body[:, :, 3], axis=0), axis=1).sum() + 2 * sight.far_m
    count = max(int(sight.points_a_metre * length), _FEWEST_POINTS)
    at = body[rng.integers(len(body), size=count)]
    on_wall = rng.random(count) < 0.8
    sideways = np.where(on_wall, rng.uniform(4, sight.aside_m, count), rng.uniform(0, 4, count))
    sideways *= rng.choice([-1, 1], count)
    up = np.where(on_wall, rng.uniform(-_HEIGHT_M, 6, count), -_HEIGHT_M)
    offset = np.column_stack([rng.uniform(-sight.far_m, sight.far_m, count), sideways, up])
    return np.asarray(at[:, :, 3] + np.einsum("nij,nj->ni", at[:, :, :3], offset))


def _points_on_car(body: FloatArray, t_s: FloatArray, sight: Sight, rng: np.random.Generator) -> FloatArray:
    """Points (frames, n, 3) on the back of a car ahead, at the times of the images."""
    back = rng.uniform([0.0, -0.9, 0.2 - _HEIGHT_M], [0.5, 0.9, 1.4 - _HEIGHT_M], (sight.on_car, 3))
    away_m = _AHEAD_M + _SWINGS_M * np.sin(2 * np.pi * t_s / _SWINGS_S)
    in_body = back + away_m[:, None, None] * [1.0, 0.0, 0.0]
    return np.einsum("kij,knj->kni", body[:, :, :3], in_body) + body[:, None, :, 3]


def _observations(
    camera: FloatArray, points: FloatArray, on_car: FloatArray, sight: Sight, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frames, tracks and left pixels of all observations, and right ones, which are not known."""
    count, next_track = len(points) + sight.on_car, 0
    track_of, ages = np.full(count, -1), np.zeros(count, int)
    shift, slides = np.zeros((count, 2)), np.zeros((count, 2))
    frames, tracks, pixels = [], [], []
    for k, pose in enumerate(camera):
        px, seen = _projected(np.concatenate([points, on_car[k]]), pose, sight)
        ends = ~seen | (rng.random(count) < sight.lost_share) | (ages >= sight.longest)
        track_of[ends], ages[ends] = -1, 0
        (new,) = np.nonzero(seen & (track_of < 0))
        track_of[new] = next_track + np.arange(len(new))
        shift[new] = rng.normal(0.0, _TRACK_PX, (len(new), 2))
        wrong = rng.random(len(new)) < sight.wrong_share if sight.wrong_share else np.zeros(len(new), bool)
        slides[new] = 0.0
        slides[new[wrong]] = rng.normal(0.0, _WRONG_PX, (np.count_nonzero(wrong), 2))
        next_track += len(new)
        here = np.flatnonzero(seen)
        here = here[np.argsort(track_of[here])]
        frames.append(np.full(len(here), k, np.int32))
        tracks.append(track_of[here].astype(np.int32))
        pixels.append(px[here] + shift[here] + rng.normal(0.0, sight.frame_px, (len(here), 2)))
        ages[here] += 1
        shift += slides
    left = np.concatenate(pixels)
    return np.concatenate(frames), np.concatenate(tracks), left, np.full_like(left, np.nan)


def _projected(points: FloatArray, pose: FloatArray, sight: Sight) -> tuple[FloatArray, np.ndarray]:
    """Pixels (n, 2) of points, and which of them the camera sees."""
    local = (points - pose[:, 3]) @ pose[:, :3]
    px = _FOCAL_PX * local[:, :2] / np.maximum(local[:, 2:], 1e-9) + _SIZE_PX / 2
    seen = (local[:, 2] > _NEAR_M) & (local[:, 2] < sight.far_m) & ((px > 0) & (px < _SIZE_PX)).all(axis=1)
    return px, seen


def _kept(drive: KittiDrive, keep: Callable[[FloatArray, KittiDrive], np.ndarray]) -> KittiDrive:
    """The drive with the samples of both streams at some times (n,) only."""
    streams = {}
    for name in ("velocity", "angular_rate"):
        stream = getattr(drive, name)
        kept = keep(stream.t_s, drive)
        streams[name] = SensorStream(stream.t_s[kept], stream.values[kept], stream.kind, stream.name)
    return replace(drive, **streams)


def _without_middle(t_s: FloatArray, drive: KittiDrive) -> np.ndarray:
    return np.abs(t_s - _MIDDLE * drive.t_s[-1]) > _GAP_S / 2


def _quantised(drive: KittiDrive, step_m: float) -> KittiDrive:
    """Whole ticks of a wheel in each interval."""
    stream = drive.velocity
    every_s = float(np.median(np.diff(stream.t_s)).round(6))
    way = np.cumsum(stream.values[:, 0]) * every_s
    ticks = np.diff(np.floor(way / step_m), prepend=0.0) * step_m / every_s
    speeds = SensorStream(stream.t_s, np.column_stack([ticks, 0 * ticks, 0 * ticks]), "velocity", "velocity")
    return replace(drive, velocity=speeds)


def _clipped(drive: KittiDrive, largest_deg_s: float) -> KittiDrive:
    """Rates up to the range of the gyroscope."""
    stream, largest = drive.angular_rate, np.radians(largest_deg_s)
    return replace(drive, angular_rate=replace(stream, values=np.clip(stream.values, -largest, largest)))


def _jittered(drive: KittiDrive) -> KittiDrive:
    """Stamps off by up to two fifths of their distance, those of each stream by others."""
    rng, streams = np.random.default_rng(0), {}
    for name in ("velocity", "angular_rate"):
        stream = getattr(drive, name)
        off_s = rng.uniform(-0.4, 0.4, len(stream)) * np.median(np.diff(stream.t_s))
        streams[name] = replace(stream, t_s=stream.t_s + off_s)
    return replace(drive, **streams)


CHANGES: dict[str, Callable[[KittiDrive], KittiDrive]] = {
    "late streams": lambda drive: _kept(drive, lambda t, d: t >= _LATE_S),
    "streams end early": lambda drive: _kept(drive, lambda t, d: t <= d.t_s[-1] - _EARLY_S),
    "streams with a gap": lambda drive: _kept(drive, _without_middle),
    "jitter": _jittered,
    "ticks of 5 cm": lambda drive: _quantised(drive, 0.05),
    "ticks of 20 cm": lambda drive: _quantised(drive, 0.2),
    "clipped at 20°/s": lambda drive: _clipped(drive, 20.0),
    "clipped at 10°/s": lambda drive: _clipped(drive, 10.0),
}
