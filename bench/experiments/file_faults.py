"""Faults that a user's files of sensors have: units, signs, axes, sampling, spans, counters that wrap."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import require_agreement
from sfmcpp.sources.io.kitti_mat import KittiDrive

_ODOMETER, _GYROSCOPE = "velocity", "angular_rate"
_BOTH = (_ODOMETER, _GYROSCOPE)
_SPARSE_S, _GAP_S, _SHORT_S = 1.0, 2.0, 5.0
# A counter of 16 bits, and what its ticks are [m].
_TICK_M, _WRAPS_AT = 1e-3, 1 << 16
_DEGREES = 180 / np.pi


def with_file_fault(drive: KittiDrive, fault: str, sensors: Sequence[str]) -> KittiDrive:
    """The drive with a fault of `FILE_FAULTS` in its streams or mounting.

    InvalidArgument where the streams of the `sensors` used, ``"velocity"`` and ``"imu"``, would be refused.
    """
    spoilt = FILE_FAULTS[fault](drive)
    used = {"velocity": spoilt.velocity, "imu": spoilt.angular_rate}
    require_agreement([used[name] for name in sensors])
    return spoilt


def _times(name: str, factor: float | FloatArray) -> Callable[[KittiDrive], KittiDrive]:
    """Values of a stream multiplied, or their axes by one factor each."""

    def change(drive: KittiDrive) -> KittiDrive:
        stream = getattr(drive, name)
        return replace(drive, **{name: replace(stream, values=stream.values * factor)})

    return change


def _turned(name: str, axes: FloatArray) -> Callable[[KittiDrive], KittiDrive]:
    """Values of a stream in other axes."""

    def change(drive: KittiDrive) -> KittiDrive:
        stream = getattr(drive, name)
        return replace(drive, **{name: replace(stream, values=stream.values @ axes.T)})

    return change


def _without_mounting(drive: KittiDrive) -> KittiDrive:
    """A camera that is said to have the axes of the body."""
    return replace(drive, camera_from_body=np.eye(3))


def _sparse(drive: KittiDrive) -> KittiDrive:
    """The sample next to each full second, with the largest gap that this makes usual."""
    return _resampled(
        drive, lambda t_s: np.unique(np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], _SPARSE_S)))
    )


def _late(drive: KittiDrive) -> KittiDrive:
    return _resampled(drive, lambda t_s: np.flatnonzero(t_s >= drive.t_s[0] + _SHORT_S))


def _short(drive: KittiDrive) -> KittiDrive:
    return _resampled(drive, lambda t_s: np.flatnonzero(t_s <= drive.t_s[-1] - _SHORT_S))


def _with_gap(drive: KittiDrive) -> KittiDrive:
    middle_s = 0.5 * (drive.t_s[0] + drive.t_s[-1])
    return _resampled(drive, lambda t_s: np.flatnonzero(np.abs(t_s - middle_s) > 0.5 * _GAP_S))


def _resampled(drive: KittiDrive, rows: Callable[[FloatArray], np.ndarray]) -> KittiDrive:
    streams = {name: getattr(drive, name) for name in _BOTH}
    some = {
        name: SensorStream(s.t_s[rows(s.t_s)], s.values[rows(s.t_s)], s.kind, s.name)
        for name, s in streams.items()
    }
    return replace(drive, **some)


def _wrapping(drive: KittiDrive) -> KittiDrive:
    """The way in ticks of a wheel, by a counter that begins again at its end."""
    stream = drive.velocity
    speeds = np.linalg.norm(stream.values, axis=1)
    way_m = np.cumsum(0.5 * (speeds + np.roll(speeds, 1)) * np.diff(stream.t_s, prepend=stream.t_s[0]))
    counted = np.floor(way_m / _TICK_M) % _WRAPS_AT * _TICK_M
    return replace(drive, velocity=SensorStream(stream.t_s, counted, "distance", "odometer"))


FILE_FAULTS: dict[str, Callable[[KittiDrive], KittiDrive]] = {
    "km/h as m/s": _times(_ODOMETER, 3.6),
    "m/s as km/h": _times(_ODOMETER, 1 / 3.6),
    "mm as m": _times(_ODOMETER, 1e3),
    "m as mm": _times(_ODOMETER, 1e-3),
    "deg as rad": _times(_GYROSCOPE, _DEGREES),
    "rad as deg": _times(_GYROSCOPE, 1 / _DEGREES),
    "yaw reversed": _times(_GYROSCOPE, np.array([1.0, 1.0, -1.0])),
    "rates reversed": _times(_GYROSCOPE, -1.0),
    "y reversed": _times(_ODOMETER, np.array([1.0, -1.0, 1.0])),
    "axes permuted": _turned(_GYROSCOPE, np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])),
    "no mounting": _without_mounting,
    "1 Hz": _sparse,
    "2 s lost": _with_gap,
    "5 s late": _late,
    "5 s short": _short,
    "ticks wrap": _wrapping,
}
# The sensor that a fault does not touch; all others are faults of both.
UNTOUCHED = {
    **dict.fromkeys(("km/h as m/s", "m/s as km/h", "mm as m", "m as mm", "y reversed", "ticks wrap"), "imu"),
    **dict.fromkeys(
        ("deg as rad", "rad as deg", "yaw reversed", "rates reversed", "axes permuted"), "odometer"
    ),
}
