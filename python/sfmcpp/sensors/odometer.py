"""Odometer: how far, and where to, the body went between two times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.sensors.imu import rotations_between_cuts
from sfmcpp.sensors.stream import measured_at, require_interval, require_kind, segments

# Body frames of vehicles have x forward (ISO 8855). The thesis takes the camera's frame instead: z forward.
FORWARD = (1.0, 0.0, 0.0)


def travelled_distance(stream: SensorStream, start_s: float, end_s: float) -> float | None:
    """Distance along the path between two times, backwards negative.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"`` (whose norm is taken).
    start_s, end_s : float
        The interval [s].

    Returns
    -------
    float or None
        Distance [m]: the integral of the speed, or the difference of the distances at both ends. None if the
        stream does not cover the interval.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or the interval is none.
    """
    require_kind(stream, "speed", "distance", "velocity")
    require_interval(start_s, end_s)
    if not stream.covers(start_s, end_s):
        return None
    middles_s, lengths_s = segments(start_s, end_s, stream)
    if stream.kind == "velocity":
        return float(np.linalg.norm(measured_at(stream, middles_s), axis=1) @ lengths_s)
    return float(_piecewise_distance(stream, middles_s, lengths_s).sum())


def displacement(
    stream: SensorStream,
    start_s: float,
    end_s: float,
    orientation: SensorStream | None = None,
    forward: ArrayLike = FORWARD,
) -> FloatArray | None:
    """Displacement of the body between two times, in the body frame at the first: thesis eq. 5.20.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    start_s, end_s : float
        The interval [s].
    orientation : SensorStream, optional
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``: turns the direction of travel on the way.
        Without it the body goes straight ahead from start to end, as in the thesis.
    forward : (3,) array-like
        Direction of travel in the body frame, for kinds that tell none.

    Returns
    -------
    (3,) float64 or None
        ``Σ R_mid v_mid dt`` [m], the midpoint rule over all samples of both streams. None if either
        stream does not cover the interval.

    Raises
    ------
    InvalidArgument
        If a stream is of another kind, the interval is none, or `forward` is no direction.
    """
    require_kind(stream, "speed", "distance", "velocity")
    streams = [stream] if orientation is None else [stream, orientation]
    require_interval(start_s, end_s)
    if not all(s.covers(start_s, end_s) for s in streams):
        return None
    middles_s, lengths_s = segments(start_s, end_s, *streams)
    steps = _steps(stream, middles_s, lengths_s, _unit(forward))
    if orientation is None:
        return np.asarray(steps.sum(axis=0))
    require_kind(orientation, "angular_rate", "orientation", "pose")
    rotations = rotations_between_cuts(orientation, middles_s, lengths_s)
    return np.asarray(np.einsum("nij,nj->i", rotations, steps))


def speed_along(stream: SensorStream, forward: ArrayLike = FORWARD) -> SensorStream:
    """The odometer that a stream of velocities would give: its component along one direction.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"velocity"``.
    forward : (3,) array-like
        Direction in the body frame.

    Returns
    -------
    SensorStream
        Of kind ``"speed"``.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `forward` is no direction.
    """
    require_kind(stream, "velocity")
    return SensorStream(stream.t_s, stream.values @ _unit(forward), "speed", "odometer", stream.max_gap_s)


def _steps(
    stream: SensorStream, middles_s: FloatArray, lengths_s: FloatArray, forward: FloatArray
) -> FloatArray:
    """Displacement (m, 3) of each piece in its own body frame."""
    if stream.kind == "velocity":
        return np.asarray(measured_at(stream, middles_s) * lengths_s[:, None])
    return np.asarray(_piecewise_distance(stream, middles_s, lengths_s)[:, None] * forward)


def _piecewise_distance(stream: SensorStream, middles_s: FloatArray, lengths_s: FloatArray) -> FloatArray:
    if stream.kind == "speed":
        return np.asarray(measured_at(stream, middles_s)[:, 0] * lengths_s)
    half = 0.5 * lengths_s
    return np.asarray((measured_at(stream, middles_s + half) - measured_at(stream, middles_s - half))[:, 0])


def _unit(forward: ArrayLike) -> FloatArray:
    direction = finite_array("forward", forward, (3,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise InvalidArgument(f"forward = {direction.tolist()}: must not be zero")
    return np.asarray(direction / length)
