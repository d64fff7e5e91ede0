"""A drive along a winding road, known in closed form, with what an odometer and a gyroscope measure on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, Odometer, SlamResult, SlamSettings, TrackSequence, run_slam
from slam_helpers import INTRINSICS, STEP_S, project

# Sensors are given in the camera's frame: z ahead, y down.
AT_CAMERA = Mounting(np.eye(3), np.zeros(3))
FRAMES = 100
SENSOR_S = 0.02
_FINE_S = 0.001
_REACH_M = 30.0
_POINTS = 400


@dataclass(frozen=True, eq=False)
class Winding:
    """Tracks of the drive, its true poses (n, 3, 4), and perfect sensors."""

    sequence: TrackSequence
    truth: np.ndarray
    odometer: SensorStream
    gyro: SensorStream

    def length_ratio(self, result: SlamResult) -> float:
        """Length of the path found over the true one."""
        return length(result.trajectory().poses) / length(self.truth[sorted(result.poses)])

    def errors(self, result: SlamResult) -> tuple[float, float]:
        """Mean error of the centres [m], and median of the rotations [rad], aligned by the first twenty."""
        frames = sorted(result.poses)
        found = np.stack([result.poses[frame] for frame in frames])
        true = self.truth[frames]
        aligned = fit_pose_similarity(found[:20], true[:20]).apply_to_poses(found)
        turned = Rotation.from_matrix(aligned[:, :, :3].transpose(0, 2, 1) @ true[:, :, :3]).magnitude()
        distances = np.linalg.norm(aligned[:, :, 3] - true[:, :, 3], axis=1)
        return float(distances.mean()), float(np.median(turned))


def speed(t_s: np.ndarray) -> np.ndarray:
    """Speed [m/s]."""
    return 5.0 + 2.0 * np.sin(0.9 * t_s)


def heading(t_s: np.ndarray) -> np.ndarray:
    """Yaw about the axis down [rad]."""
    return 0.45 * np.sin(0.8 * t_s) + 0.08 * np.sin(2.7 * t_s)


def yaw_rate(t_s: np.ndarray) -> np.ndarray:
    """Its derivative [rad/s]."""
    return 0.36 * np.cos(0.8 * t_s) + 0.216 * np.cos(2.7 * t_s)


def poses(t_s: np.ndarray) -> np.ndarray:
    """Poses (n, 3, 4), by sums over steps of a millisecond."""
    middles = np.arange(0.0, t_s[-1] + 1.0, _FINE_S) + 0.5 * _FINE_S
    steps = _FINE_S * speed(middles)
    ahead = np.stack([np.sin(heading(middles)), 0 * middles, np.cos(heading(middles))], axis=1)
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(steps[:, None] * ahead, axis=0)])
    centres = way[np.round(t_s / _FINE_S).astype(int)]
    rotations = Rotation.from_rotvec(heading(t_s)[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def length(path: np.ndarray) -> float:
    """Length of a path of poses (n, 3, 4)."""
    return float(np.linalg.norm(np.diff(path[:, :, 3], axis=0), axis=1).sum())


@cache
def winding(sigma_px: float = 1.0, seed: int = 0) -> Winding:
    """Drive past points on both sides; each is seen within thirty metres, so that the map drifts."""
    t_s = STEP_S * np.arange(FRAMES)
    truth = poses(t_s)
    rng = np.random.default_rng(seed)
    sequence = sequence_along(truth, beside(truth, rng), sigma_px, rng)
    ticks = np.arange(0.0, t_s[-1] + SENSOR_S, SENSOR_S)
    turning = yaw_rate(ticks)[:, None] * [0.0, 1.0, 0.0]
    return Winding(
        sequence,
        truth,
        SensorStream(ticks, speed(ticks), "speed", "odometer"),
        SensorStream(ticks, turning, "angular_rate", "gyro"),
    )


def sound_run(*sensors: str, seed: int = 0, hindsight: bool = True) -> SlamResult:
    """Run with these perfect sensors, ``"odometer"`` and ``"gyro"``, once; tests must not change it."""
    return _sound_run(sensors, seed, hindsight)


@cache
def _sound_run(sensors: tuple[str, ...], seed: int, hindsight: bool) -> SlamResult:
    drive = winding(seed=seed)
    known = {"odometer": Odometer(drive.odometer), "gyro": Gyroscope(drive.gyro, AT_CAMERA)}
    return run_slam(drive.sequence, SlamSettings(hindsight=hindsight), [known[name] for name in sensors])


def beside(way: np.ndarray, rng: np.random.Generator | None = None) -> np.ndarray:
    """Points (n, 3) on both sides of a way of poses (k, 3, 4)."""
    rng = rng or np.random.default_rng(0)
    return way[rng.integers(len(way), size=_POINTS), :, 3] + np.column_stack(
        [
            rng.uniform(3, 12, _POINTS) * rng.choice([-1, 1], _POINTS),
            rng.uniform(-4, 1.5, _POINTS),
            rng.uniform(5, 25, _POINTS),
        ]
    )


def sequence_along(
    way: np.ndarray, points: np.ndarray, sigma_px: float, rng: np.random.Generator | None = None
) -> TrackSequence:
    """What a camera on a way of poses (k, 3, 4), a frame every tenth of a second, sees of near points."""
    rng = rng or np.random.default_rng(0)
    seen = [_sees(pose, points) for pose in way]
    frames = np.concatenate([np.full(len(tracks), k) for k, tracks in enumerate(seen)])
    pixels = np.concatenate([project(pose, points[tracks]) for pose, tracks in zip(way, seen, strict=True)])
    noisy = pixels + rng.normal(0, sigma_px, pixels.shape)
    return TrackSequence(STEP_S * np.arange(len(way)), frames, np.concatenate(seen), noisy, INTRINSICS)


def without(stream: SensorStream, *gaps: tuple[float, float]) -> SensorStream:
    """Leave out the samples within each of the gaps [s]."""
    lost = np.zeros(len(stream), dtype=bool)
    for start, end in gaps:
        lost |= (stream.t_s > start) & (stream.t_s < end)
    return SensorStream(stream.t_s[~lost], stream.values[~lost], stream.kind, stream.name)


def _sees(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which of the points (n, 3) are in the image and near enough."""
    depth = ((points - pose[:, 3]) @ pose[:, :3])[:, 2]
    ahead = np.flatnonzero((depth > 2.0) & (depth < _REACH_M))
    inside = np.abs(project(pose, points[ahead]) - INTRINSICS[2:4]) < INTRINSICS[2:4]
    return ahead[inside.all(axis=1)]
