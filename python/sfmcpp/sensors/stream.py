"""Measurements at times of one's own: interpolated within a stream, predicted a little beyond its ends.

The rule everywhere in this package: a measurement between two keyframes exists only if the stream covers all
of the interval, that is if no gap longer than its `max_gap_s` touches it and it reaches at most `max_gap_s`
beyond the first or the last sample. Where it does not, the answer is None, never a guess.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.sensors.prediction import interpolate_rotations, interpolate_vectors

_RATES = ("speed", "velocity", "angular_rate")


def require_kind(stream: SensorStream, *kinds: str) -> None:
    """Raise InvalidArgument unless `stream` is of one of `kinds`."""
    if stream.kind not in kinds:
        raise InvalidArgument(
            f"stream {stream.name!r} is of kind {stream.kind!r}: must be {' or '.join(kinds)}"
        )


def require_interval(start_s: float, end_s: float) -> None:
    """Raise InvalidArgument unless `start_s` ≤ `end_s`, both finite."""
    if not (np.isfinite([start_s, end_s]).all() and start_s <= end_s):
        raise InvalidArgument(f"start_s = {start_s}, end_s = {end_s}: must be finite and in this order")


@checked(times_s=(ANY,))
def measured_at(stream: SensorStream, times_s: FloatArray) -> FloatArray:
    """Values at any time, whether the stream covers it or not.

    Parameters
    ----------
    stream : SensorStream
        Any kind.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, k) float64
        Linear between samples, at constant rate in rotation. Beyond the ends speeds and rates keep their
        value; distances, positions and rotations keep their velocity.

    Raises
    ------
    InvalidArgument
        If a time is not finite.
    """
    t_s, values = stream.t_s, stream.values
    if stream.kind in _RATES:
        return interpolate_vectors(t_s, values, np.clip(times_s, t_s[0], t_s[-1]))
    if stream.kind == "orientation":
        return so3.log(interpolate_rotations(t_s, so3.exp(values), times_s))
    if stream.kind == "pose":
        turns = so3.log(interpolate_rotations(t_s, so3.exp(values[:, 3:]), times_s))
        return np.hstack([interpolate_vectors(t_s, values[:, :3], times_s), turns])
    return interpolate_vectors(t_s, values, times_s)


def segments(start_s: float, end_s: float, *streams: SensorStream) -> tuple[FloatArray, FloatArray]:
    """Cut an interval at every sample of every stream.

    Parameters
    ----------
    start_s, end_s : float
        The interval [s].
    *streams : SensorStream
        Streams whose stamps within it are cuts.

    Returns
    -------
    middles_s : (m,) float64
        Middle of each piece [s].
    lengths_s : (m,) float64
        Length of each piece [s]; none is longer than the time between samples.
    """
    inside = [s.t_s[(s.t_s > start_s) & (s.t_s < end_s)] for s in streams]
    cuts = np.unique(np.concatenate([[start_s, end_s], *inside]))
    return 0.5 * (cuts[:-1] + cuts[1:]), np.diff(cuts)


@checked()
def describe_gaps(streams: Sequence[SensorStream]) -> list[str]:
    """Tell of each gap too long to be bridged, naming the stream and the times.

    Parameters
    ----------
    streams : sequence of SensorStream
        Any streams.

    Returns
    -------
    list of str
        One line for each gap.
    """
    return [
        f"stream {stream.name!r}: gap of {gap}, longer than {stream.max_gap_s:.3f} s: no measurement there"
        for stream in streams
        for gap in stream.gaps()
    ]
