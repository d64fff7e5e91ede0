"""Measurements at times of one's own: interpolated within a stream, predicted a little beyond its ends.

The rule everywhere in this package: a measurement between two keyframes exists only if the stream covers all
of the interval, that is if no gap longer than its `max_gap_s` touches it and it reaches at most `max_gap_s`
beyond the first or the last sample. Where it does not, the answer is None, never a guess.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.sensors.prediction import interpolate_rotations, interpolate_vectors

_RATES = ("speed", "velocity", "angular_rate")
_PLACES = ("position", "pose")
# Rates this far apart do not tell a motion [s].
_SPARSE_S = 2.0


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
        f"stream {stream.name!r}: gap of {gap}, longer than {stream.max_gap_s:.3f} s: no measurements in it"
        for stream in streams
        for gap in stream.gaps()
    ]


@checked()
def describe_coverage(streams: Sequence[SensorStream], start_s: float, end_s: float) -> list[str]:
    """List streams that do not cover the images, or are too sparse to determine a motion.

    Parameters
    ----------
    streams : sequence of SensorStream
        Any streams.
    start_s, end_s : float
        Times of the first and of the last image [s].

    Returns
    -------
    list of str
        One line for each fault.
    """
    return [
        f"stream {stream.name!r}: {fault}" for stream in streams for fault in _faults(stream, start_s, end_s)
    ]


def _faults(stream: SensorStream, start_s: float, end_s: float) -> Iterator[str]:
    first_s, last_s = float(stream.t_s[0]), float(stream.t_s[-1])
    if first_s - stream.max_gap_s > start_s:
        yield f"begins at {first_s:.3f} s, {first_s - start_s:.3f} s after the images: no measurements before"
    if last_s + stream.max_gap_s < end_s:
        yield f"ends at {last_s:.3f} s, {end_s - last_s:.3f} s before the images: no measurements after"
    if stream.kind in _RATES and stream.period_s > _SPARSE_S:
        yield (
            f"its samples are {stream.period_s:.3g} s apart, too sparse to determine a motion: check the "
            "unit of the times in the file"
        )
    if stream.kind in _PLACES and stream.period_s > _SPARSE_S:
        yield (
            f"its samples are {stream.period_s:.3g} s apart, and between them the way is taken for straight: "
            "check the unit of the times in the file"
        )
