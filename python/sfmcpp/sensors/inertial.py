"""Inertial sensors: rotations from angular rates or orientations (IMU), and whole poses (INS)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.sensors.stream import measured_at, require_interval, require_kind, segments


@checked()
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
        return _integrated_rates(stream, start_s, end_s)
    start, end = so3.exp(measured_at(stream, np.array([start_s, end_s]))[:, -3:])
    return np.asarray(start.T @ end)


@checked(times_s=(ANY,))
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


@checked()
def sampling_variance(stream: SensorStream) -> FloatArray:
    """Variance of integrated rates from what these do between samples, gathered from the first sample on.

    A body that shakes faster than it is sampled turns otherwise between samples than a straight line has it.
    How far each sample is from the line through its neighbours tells by how much: of white noise with the
    variance σ² the expected square is ``(1 + a² + b²) σ²``, the weights of the neighbours a and b, and the
    trapezoids gather ``h² σ²`` over a step h.

    Parameters
    ----------
    stream : SensorStream
        Of any kind: what is no rate is not integrated.

    Returns
    -------
    (n,) float64
        Variance about each axis, the mean of three, at each stamp [rad²]; zero of fewer than three samples.
    """
    t_s, rates = stream.t_s, stream.values
    if stream.kind != "angular_rate" or len(t_s) < 3:
        return np.zeros(len(t_s))
    share = (t_s[1:-1] - t_s[:-2]) / (t_s[2:] - t_s[:-2])
    between = (1 - share)[:, None] * rates[:-2] + share[:, None] * rates[2:]
    deviation = np.mean((rates[1:-1] - between) ** 2, axis=1)
    variance = np.pad(deviation / (1 + share**2 + (1 - share) ** 2), 1, mode="edge")
    steps = np.diff(t_s) ** 2 * 0.5 * (variance[1:] + variance[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def _integrated_rates(stream: SensorStream, start_s: float, end_s: float) -> FloatArray:
    middles_s, lengths_s = segments(start_s, end_s, stream)
    turn = np.eye(3)
    for step in so3.exp(measured_at(stream, middles_s) * lengths_s[:, None]):
        turn = turn @ step
    return turn


@checked()
def pose_at(stream: SensorStream, time_s: float) -> FloatArray | None:
    """Pose of the body at a time: thesis eqs 5.22 and 5.23.

    Between samples the pose is interpolated, where the thesis, online, predicts from the last one; after the
    last sample it goes on with the velocities of the last two (eq. 5.23).

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"pose"``.
    time_s : float
        When [s].

    Returns
    -------
    (3, 4) float64 or None
        ``[R | c]`` world_from_body; None if the stream does not cover that time.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "pose")
    if not stream.covers(time_s, time_s):
        return None
    value = measured_at(stream, np.array([time_s]))[0]
    return np.column_stack([so3.exp(value[3:]), value[:3]])


@checked(poses=(ANY, 3, 4))
def pose_stream_values(poses: FloatArray) -> FloatArray:
    """Poses (n, 3, 4) world_from_body as the values (n, 6) of a stream of kind ``"pose"``.

    Parameters
    ----------
    poses : (n, 3, 4) float64
        ``[R | c]`` of each sample.

    Returns
    -------
    (n, 6) float64
        Position [m], then rotation vector [rad].
    """
    return np.hstack([poses[:, :, 3], so3.log(poses[:, :, :3])])
