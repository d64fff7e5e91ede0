"""Clocks: the offset between a gyroscope's and the camera's, from the rotations both have seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.stream import require_kind

# Rates that correlate less do not show the same motion.
LEAST_CORRELATION = 0.7
_FEWEST_SAMPLES = 10
# rad/s → degrees/s is a factor of 57.3; anything beyond this is no noise of the scale factor.
_PLAUSIBLE_RATIO = (0.5, 2.0)
# Lags tried per period of the coarser stream; a parabola through the best three does the rest.
_LAGS_PER_PERIOD = 4


@dataclass(frozen=True)
class ClockOffset:
    """How a sensor's clock stands against the camera's.

    Attributes
    ----------
    offset_s : float
        What to add to the sensor's stamps [s]: the argument of :meth:`SensorStream.shifted`.
    correlation : float
        Correlation of the two rates at that offset, at most 1.
    rate_ratio : float
        The sensor's rates over vision's: 1 if both are in the same unit.
    """

    offset_s: float
    correlation: float
    rate_ratio: float

    @property
    def is_determined(self) -> bool:
        """Whether both have seen the same rotation, clearly enough to tell the offset."""
        return self.correlation >= LEAST_CORRELATION


def angular_rates(trajectory: Trajectory) -> SensorStream:
    """Angular rates of a camera, in its own frame, half-way between its poses.

    Parameters
    ----------
    trajectory : Trajectory
        At least two poses.

    Returns
    -------
    SensorStream
        Of kind ``"angular_rate"``.

    Raises
    ------
    InvalidArgument
        If there are fewer than two poses.
    """
    if len(trajectory) < 2:
        raise InvalidArgument(f"trajectory: has {len(trajectory)} pose, must have two or more")
    rotations = trajectory.rotations
    turns = so3.log(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])
    stamps = trajectory.t_s
    rates = turns / np.diff(stamps)[:, None]
    return SensorStream(0.5 * (stamps[:-1] + stamps[1:]), rates, "angular_rate", "vision")


def estimate_clock_offset(
    sensor: SensorStream, vision: SensorStream, largest_offset_s: float = 1.0
) -> ClockOffset:
    """Find the offset at which the magnitudes of two angular rates correlate best.

    Magnitudes are the same in every frame, so no calibration is needed.

    Parameters
    ----------
    sensor, vision : SensorStream
        Of kind ``"angular_rate"``; see :func:`angular_rates`.
    largest_offset_s : float
        Offsets from minus to plus this are tried [s].

    Returns
    -------
    ClockOffset
        See :attr:`ClockOffset.is_determined`: without turns there is nothing to compare.

    Raises
    ------
    InvalidArgument
        If a stream is of another kind, `largest_offset_s` is not positive, or the streams have too few
        samples in common at every offset.
    """
    require_kind(sensor, "angular_rate")
    require_kind(vision, "angular_rate")
    if not (np.isfinite(largest_offset_s) and largest_offset_s > 0):
        raise InvalidArgument(f"largest_offset_s = {largest_offset_s}: must be finite and positive")
    step = max(sensor.period_s, vision.period_s) / _LAGS_PER_PERIOD
    reach = int(np.ceil(largest_offset_s / step)) if step > 0 else 0
    lags = np.arange(-reach, reach + 1) * step
    scores = np.array([_correlation(sensor, vision, lag) for lag in lags])
    if not np.isfinite(scores).any():
        raise InvalidArgument(
            f"stream {sensor.name!r} ({_span(sensor)}) and stream {vision.name!r} ({_span(vision)}): fewer "
            f"than {_FEWEST_SAMPLES} samples in common at any offset up to {largest_offset_s} s"
        )
    best = int(np.nanargmax(scores))
    offset = float(lags[best] + step * _vertex(scores, best))
    return ClockOffset(offset, float(scores[best]), _ratio(sensor, vision, offset))


def require_same_clock(
    sensor: SensorStream, vision: SensorStream, tolerance_s: float = 0.1, largest_offset_s: float = 1.0
) -> ClockOffset:
    """Refuse a sensor whose clock, or whose unit, is not that of the camera.

    Where the rotations seen are too small to tell, nothing is refused.

    Parameters
    ----------
    sensor, vision : SensorStream
        Of kind ``"angular_rate"``.
    tolerance_s : float
        Largest offset that passes [s].
    largest_offset_s : float
        Offsets from minus to plus this are tried [s].

    Returns
    -------
    ClockOffset

    Raises
    ------
    InvalidArgument
        If the offset is determined and larger than `tolerance_s`, or the rates are in different units; and as
        :func:`estimate_clock_offset`.
    """
    found = estimate_clock_offset(sensor, vision, largest_offset_s)
    if not found.is_determined:
        return found
    low, high = _PLAUSIBLE_RATIO
    if not low <= found.rate_ratio <= high:
        raise InvalidArgument(
            f"stream {sensor.name!r}: its angular rates are {found.rate_ratio:.3g} times those seen by the "
            f"camera, must be {low} to {high} times; were they given in degrees/s?"
        )
    if abs(found.offset_s) > tolerance_s:
        side = "behind" if found.offset_s > 0 else "ahead of"
        raise InvalidArgument(
            f"stream {sensor.name!r}: its clock is {abs(found.offset_s):.3f} s {side} the camera's "
            f"(correlation {found.correlation:.2f}), must be within {tolerance_s} s: "
            f"give clock_offset_s = {found.offset_s:.3f}"
        )
    return found


def _correlation(sensor: SensorStream, vision: SensorStream, lag_s: float) -> float:
    """Correlation of the magnitudes at the camera's times; NaN where too little is in common."""
    one, other = _common(sensor, vision, lag_s)
    if len(one) < _FEWEST_SAMPLES:
        return float("nan")
    one, other = one - one.mean(), other - other.mean()
    norm = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / norm if norm > 0 else 0.0


def _common(sensor: SensorStream, vision: SensorStream, lag_s: float) -> tuple[FloatArray, FloatArray]:
    times = vision.t_s - lag_s
    inside = (times >= sensor.t_s[0]) & (times <= sensor.t_s[-1])
    magnitude = np.linalg.norm(sensor.values, axis=1)
    seen = np.linalg.norm(vision.values[inside], axis=1)
    return np.interp(times[inside], sensor.t_s, magnitude), np.asarray(seen)


def _ratio(sensor: SensorStream, vision: SensorStream, lag_s: float) -> float:
    """Least-squares slope of the sensor's magnitudes over vision's."""
    one, other = _common(sensor, vision, lag_s)
    power = float(other @ other)
    return float(one @ other) / power if power > 0 else float("nan")


def _vertex(scores: FloatArray, best: int) -> float:
    """Where the parabola through the best score and its neighbours peaks, in steps from the best."""
    if not 0 < best < len(scores) - 1:
        return 0.0
    left, peak, right = scores[best - 1 : best + 2]
    curvature = left - 2 * peak + right
    return float(0.5 * (left - right) / curvature) if curvature < 0 else 0.0


def _span(stream: SensorStream) -> str:
    return f"{stream.t_s[0]:.3f} to {stream.t_s[-1]:.3f} s"
