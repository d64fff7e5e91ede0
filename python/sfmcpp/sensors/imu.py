"""Inertial sensor: rotations between two times from angular rates, or from orientations it gives itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.sensors.stream import measured_at, require_interval, require_kind, segments


def rotation_increment(stream: SensorStream, start_s: float, end_s: float) -> FloatArray | None:
    """Rotation of the body between two times: thesis eq. 5.21, over all samples between keyframes.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``.
    start_s, end_s : float
        The interval [s].

    Returns
    -------
    (3, 3) float64 or None
        Rotation start_from_end of the body, ``R_startᵀ R_end``: for rates ``Π exp(ω_mid dt)``, the
        exponential midpoint rule, of second order. None if the stream does not cover the interval.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or the interval is none.
    """
    require_kind(stream, "angular_rate", "orientation", "pose")
    require_interval(start_s, end_s)
    if not stream.covers(start_s, end_s):
        return None
    if stream.kind == "angular_rate":
        return _integrated(stream, start_s, end_s)
    start, end = so3.exp(measured_at(stream, np.array([start_s, end_s]))[:, -3:])
    return np.asarray(start.T @ end)


def orientations(stream: SensorStream, times_s: ArrayLike) -> FloatArray:
    """Orientation of the body at each of several times, seen from the first.

    Parameters
    ----------
    stream : SensorStream
        As for :func:`rotation_increment`.
    times_s : (m,) array-like
        Times [s], increasing.

    Returns
    -------
    (m, 3, 3) float64
        Rotation first_from_body; NaN from the first interval on that the stream does not cover.

    Raises
    ------
    InvalidArgument
        As :func:`rotation_increment`.
    """
    times = [float(t) for t in np.asarray(times_s, dtype=np.float64)]
    result = np.full((len(times), 3, 3), np.nan)
    result[:1] = np.eye(3)
    for row in range(1, len(times)):
        turn = rotation_increment(stream, times[row - 1], times[row])
        if turn is None:
            break
        result[row] = result[row - 1] @ turn
    return result


def without_bias(stream: SensorStream, bias_rad_s: ArrayLike) -> SensorStream:
    """Subtract a constant bias from a stream of angular rates.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    bias_rad_s : (3,) array-like
        What the gyroscope shows at rest [rad/s].

    Returns
    -------
    SensorStream

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or the bias is not three finite numbers.
    """
    require_kind(stream, "angular_rate")
    return replace(stream, values=stream.values - finite_array("bias_rad_s", bias_rad_s, (3,)))


def bias_at_rest(stream: SensorStream, start_s: float, end_s: float) -> FloatArray:
    """Mean angular rate while the body stands still: the bias of the gyroscope.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    start_s, end_s : float
        When the body stands [s].

    Returns
    -------
    (3,) float64
        Bias [rad/s]; the Earth's own 7.3e-5 rad/s are part of it.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or has no sample in the interval.
    """
    require_kind(stream, "angular_rate")
    require_interval(start_s, end_s)
    resting = stream.values[(stream.t_s >= start_s) & (stream.t_s <= end_s)]
    if not len(resting):
        raise InvalidArgument(
            f"stream {stream.name!r}: no sample from {start_s} to {end_s} s, must be one or more"
        )
    return np.asarray(resting.mean(axis=0))


def rotations_between_cuts(stream: SensorStream, middles_s: FloatArray, lengths_s: FloatArray) -> FloatArray:
    """Rotations (m, 3, 3) start_from_body in the middle of each of consecutive pieces."""
    if stream.kind == "angular_rate":
        return _chained(measured_at(stream, middles_s), lengths_s)
    start_s = middles_s[:1] - 0.5 * lengths_s[:1]
    absolute = so3.exp(measured_at(stream, np.concatenate([start_s, middles_s]))[:, -3:])
    return np.asarray(absolute[0].T @ absolute[1:])


def rotations_at_samples(stream: SensorStream, factor: float = 1.0) -> FloatArray:
    """Rotations (n, 3, 3) start_from_body at a stream's stamps; rates are multiplied by `factor` first."""
    if stream.kind != "angular_rate":
        return so3.exp(stream.values[:, -3:])
    middles = 0.5 * factor * (stream.values[1:] + stream.values[:-1])
    result = np.empty((len(stream), 3, 3))
    result[0] = np.eye(3)
    for row, step in enumerate(so3.exp(middles * np.diff(stream.t_s)[:, None])):
        result[row + 1] = result[row] @ step
    return result


def _integrated(stream: SensorStream, start_s: float, end_s: float) -> FloatArray:
    middles_s, lengths_s = segments(start_s, end_s, stream)
    turn = np.eye(3)
    for step in so3.exp(measured_at(stream, middles_s) * lengths_s[:, None]):
        turn = turn @ step
    return turn


def _chained(rates: FloatArray, lengths_s: FloatArray) -> FloatArray:
    """Orientation half-way through each piece, having turned through all pieces before it."""
    halves = so3.exp(0.5 * lengths_s[:, None] * rates)
    result = np.empty_like(halves)
    turn = np.eye(3)
    for row, half in enumerate(halves):
        result[row] = turn @ half
        turn = result[row] @ half
    return result
