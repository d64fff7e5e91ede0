"""KITTI drives as they might have been: with stops, backwards, at half the frame rate, with less to see.

Tracks go in straight lines between two images, poses with constant velocity; so does what sensors measure
between two samples. What is interpolated gets noise of its own, or it would be better than what was measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import interpolate_poses, interpolate_vectors
from sfmcpp.sources.io.kitti_mat import KittiDrive

_STOPS = (0.3, 0.7)  # of the time of the drive
_STANDS_S, _BRAKES_S = 4.0, 4.0
_GRID_S = 1e-3
_INTERPOLATION_PX, _STANDSTILL = 0.1, 1e-3
_HALF, _NOISE_PX, _LOST_FRAMES = 0.5, 0.5, 0.2


def with_stops(drive: KittiDrive) -> KittiDrive:
    """The vehicle brakes evenly, stands and accelerates, twice: the same way at another pace."""
    wall_s, driven_s = _pace(float(drive.t_s[-1] - drive.t_s[0]))
    step_s = float(np.median(np.diff(drive.t_s)))
    times = np.arange(0.0, wall_s[-1], step_s)
    at_s = drive.t_s[0] + np.interp(times, wall_s, driven_s)
    streams = {name: _at_pace(getattr(drive, name), drive, wall_s, driven_s) for name in STREAMS}
    t_s = drive.t_s[0] + times
    poses = interpolate_poses(drive.t_s, drive.truth.poses, at_s)
    return replace(_seen_at(drive, at_s), t_s=t_s, truth=Trajectory(t_s, poses), **streams)


def backwards(drive: KittiDrive) -> KittiDrive:
    """The vehicle drives the same way from its end to its start, in reverse gear."""
    last, turned_s = len(drive.t_s) - 1, drive.t_s[0] + drive.t_s[-1]
    t_s = turned_s - drive.t_s[::-1]
    streams = {name: _reversed(getattr(drive, name), turned_s) for name in STREAMS}
    truth = Trajectory(t_s, drive.truth.poses[::-1].copy())
    order = np.lexsort([drive.track_index, last - drive.frame_index])
    seen = replace(drive, frame_index=last - drive.frame_index)
    return replace(rows_of(seen, order), t_s=t_s, truth=truth, **streams)


def at_half_rate(drive: KittiDrive) -> KittiDrive:
    """The camera takes every second frame."""
    return _frames(drive, np.arange(len(drive.t_s)) % 2 == 0)


def with_lost_frames(drive: KittiDrive) -> KittiDrive:
    """A fifth of the frames are missing, at random; the first and the last are there."""
    kept = np.random.default_rng(0).random(len(drive.t_s)) >= _LOST_FRAMES
    kept[[0, -1]] = True
    return _frames(drive, kept)


def with_half_the_tracks(drive: KittiDrive) -> KittiDrive:
    """Half of the tracks, at random."""
    return with_some_tracks(drive, _HALF)


def with_some_tracks(drive: KittiDrive, share: float, seed: int = 0) -> KittiDrive:
    """A share of the tracks, drawn at random."""
    kept = np.random.default_rng(seed).random(drive.num_tracks) < share
    return rows_of(drive, np.flatnonzero(kept[drive.track_index]))


def with_noisy_pixels(drive: KittiDrive) -> KittiDrive:
    """Each coordinate of each observation is off by half a pixel more."""
    rng = np.random.default_rng(0)
    left, right = (p + rng.normal(0.0, _NOISE_PX, p.shape) for p in (drive.left_px, drive.right_px))
    return replace(drive, left_px=left, right_px=right)


ALTERED: dict[str, Callable[[KittiDrive], KittiDrive]] = {
    "stops": with_stops,
    "backwards": backwards,
    "half-rate": at_half_rate,
    "lost-frames": with_lost_frames,
    "half-the-tracks": with_half_the_tracks,
    "noisy": with_noisy_pixels,
}
STREAMS = ("velocity", "angular_rate")


def _pace(seconds: float) -> tuple[FloatArray, FloatArray]:
    """Time since the start, and how far into the drive of so many seconds the vehicle is then [s]."""
    longer_s = len(_STOPS) * (_STANDS_S + _BRAKES_S)
    wall_s = np.arange(0.0, seconds + longer_s, _GRID_S)
    speed = np.ones_like(wall_s)
    for k, share in enumerate(_STOPS):
        stands_s = share * seconds + k * (_STANDS_S + _BRAKES_S) + _BRAKES_S / 2
        away_s = np.maximum(stands_s - wall_s, wall_s - stands_s - _STANDS_S)
        speed = np.minimum(speed, np.clip(away_s / _BRAKES_S, 0.0, 1.0))
    return wall_s, np.minimum(np.cumsum(speed) * _GRID_S, seconds)


def _at_pace(
    stream: SensorStream, drive: KittiDrive, wall_s: FloatArray, driven_s: FloatArray
) -> SensorStream:
    """Velocities or rates of the vehicle at that pace, as often as they were measured."""
    first_s, step_s = drive.t_s[0], float(np.median(np.diff(stream.t_s)))
    times = np.arange(0.0, wall_s[-1], step_s)
    values = interpolate_vectors(stream.t_s, stream.values, first_s + np.interp(times, wall_s, driven_s))
    speed = np.interp(times, wall_s, np.gradient(driven_s, _GRID_S))
    noise = np.random.default_rng(0).normal(0.0, _STANDSTILL, values.shape)
    return SensorStream(first_s + times, speed[:, None] * values + noise, stream.kind, stream.name)


def _seen_at(drive: KittiDrive, at_s: FloatArray) -> KittiDrive:
    """What the camera would have seen at other times: the tracks of the image before and the one after."""
    before = np.clip(np.searchsorted(drive.t_s, at_s, side="right") - 1, 0, len(drive.t_s) - 2)
    share = (at_s - drive.t_s[before]) / np.diff(drive.t_s)[before]
    rows = np.searchsorted(drive.frame_index, np.arange(len(drive.t_s) + 1))
    start, end = [], []
    for k in before:
        tracks = [drive.track_index[rows[j] : rows[j + 1]] for j in (k, k + 1)]
        _, here, there = np.intersect1d(*tracks, assume_unique=True, return_indices=True)
        start.append(rows[k] + here)
        end.append(rows[k + 1] + there)
    frame = np.repeat(np.arange(len(at_s), dtype=np.int32), [len(some) for some in start])
    a, b = np.concatenate(start), np.concatenate(end)
    rng, weight = np.random.default_rng(0), share[frame][:, None]
    left, right = (
        p[a] + weight * (p[b] - p[a]) + rng.normal(0.0, _INTERPOLATION_PX, (len(a), 2))
        for p in (drive.left_px, drive.right_px)
    )
    return replace(drive, frame_index=frame, track_index=drive.track_index[a], left_px=left, right_px=right)


def _frames(drive: KittiDrive, kept: np.ndarray) -> KittiDrive:
    number = (np.cumsum(kept) - 1).astype(np.int32)
    some = rows_of(drive, np.flatnonzero(kept[drive.frame_index]))
    truth = Trajectory(drive.t_s[kept], drive.truth.poses[kept])
    return replace(some, t_s=drive.t_s[kept], frame_index=number[some.frame_index], truth=truth)


def rows_of(drive: KittiDrive, rows: np.ndarray) -> KittiDrive:
    """Some of the observations, in that order."""
    names = ("frame_index", "track_index", "left_px", "right_px")
    return replace(drive, **{name: getattr(drive, name)[rows] for name in names})


def _reversed(stream: SensorStream, turned_s: float) -> SensorStream:
    return SensorStream(turned_s - stream.t_s[::-1], -stream.values[::-1], stream.kind, stream.name)
