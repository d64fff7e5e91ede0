"""Measurements of a stream at any time: interpolated within, predicted a little beyond its ends.

The rule everywhere in this package: a measurement between two keyframes exists only if the stream covers all
of the interval, that is if no gap longer than its `max_gap_s` touches it and it reaches at most `max_gap_s`
beyond the first or the last sample. Where it does not, the answer is None, never a guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, finite_array, require_increasing

_RATES = ("speed", "velocity", "angular_rate")
_PLACES = ("position", "pose")
# Rows before and after each time, and how far it is from one to the other.
_Sides = tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]
# Rates this far apart do not tell a motion [s].
_SPARSE_S = 2.0
# Rates this far apart are coarse [s]: what a vehicle does between two of them is not on the line between.
_COARSE_S = 0.3
# Beyond the ends speeds and rates are predicted to stay. Over 0.1 to 0.4 s (drives 0001, 0027, 0036, 0039)
# they change by 0.3 to 0.5 m/s² and 0.03 to 0.2 rad/s² (root mean square along each axis).
_PREDICTED_M_S2, _PREDICTED_RAD_S2 = 1.0, 0.3
# More gaps of a stream than this are told in one sentence.
_MOST_GAPS = 8


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


def is_coarse(stream: SensorStream) -> bool:
    """Whether the samples of a stream of rates are so far apart that a vehicle turns otherwise between."""
    return stream.kind == "angular_rate" and stream.period_s > _COARSE_S


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
        value; distances, positions and rotations keep their velocity. Longitudes go on beyond ±180°.

    Raises
    ------
    InvalidArgument
        If a time is not finite.
    """
    # A stream was checked as it was made: only the samples beside the times are looked at.
    t_s, values = stream.t_s, stream.values
    times_s = finite_array("times_s", times_s, (ANY,))
    if stream.kind in _RATES:
        times_s = np.clip(times_s, t_s[0], t_s[-1])
    sides = _bracketing_rows(t_s, times_s)
    if stream.kind == "orientation":
        return so3.log(_turned_between(so3.exp, values, sides))
    if stream.kind == "pose":
        turns = so3.log(_turned_between(so3.exp, values[:, 3:], sides))
        return np.hstack([_moved_between(values[:, :3], sides), turns])
    if stream.kind == "geodetic":
        values = np.column_stack([values[:, 0], np.unwrap(values[:, 1], period=360.0), values[:, 2]])
    return _moved_between(values, sides)


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
    inside = [_stamps_between(s.t_s, start_s, end_s) for s in streams]
    cuts = np.unique(np.concatenate([[start_s, end_s], *inside]))
    return 0.5 * (cuts[:-1] + cuts[1:]), np.diff(cuts)


def _stamps_between(t_s: FloatArray, start_s: float, end_s: float) -> FloatArray:
    """Stamps after the start and before the end, whatever the length of the stream."""
    first, last = np.searchsorted(t_s, start_s, side="right"), np.searchsorted(t_s, end_s, side="left")
    return t_s[first:last]


def prediction_sigma(stream: SensorStream, start_s: float, end_s: float) -> float:
    """Standard deviation of a motion by what is predicted of it, beyond the ends of a stream.

    Along an axis of a displacement [m], or about one of a rotation [rad]; zero for what is measured.
    """
    first_s, last_s = float(stream.t_s[0]), float(stream.t_s[-1])
    after = max(end_s - last_s, 0.0) ** 2 - max(start_s - last_s, 0.0) ** 2
    before = max(first_s - start_s, 0.0) ** 2 - max(first_s - end_s, 0.0) ** 2
    turns = stream.kind in ("angular_rate", "orientation", "pose")
    return 0.5 * (after + before) * (_PREDICTED_RAD_S2 if turns else _PREDICTED_M_S2)


@checked()
def describe_gaps(streams: Sequence[SensorStream]) -> list[str]:
    """Tell of each gap too long to be bridged, naming the stream and the times; of many in one sentence.

    Parameters
    ----------
    streams : sequence of SensorStream
        Any streams.

    Returns
    -------
    list of str
        One line for each gap; one for all of a stream that has more than eight.
    """
    return [told for stream in streams for told in _gaps_in_words(stream)]


def _gaps_in_words(stream: SensorStream) -> list[str]:
    gaps, told = stream.gaps(), f"stream {stream.name!r}: "
    if len(gaps) > _MOST_GAPS:
        together_s = sum(gap.end_s - gap.start_s for gap in gaps)
        where = f"{together_s:.1f} s together, first {gaps[0]}"
        longer = f"{len(gaps)} gaps longer than {stream.max_gap_s:.3f} s"
        return [f"{told}{longer}, {where}: no measurements in them"]
    rule = f"longer than {stream.max_gap_s:.3f} s: no measurements in it"
    return [f"{told}gap of {gap}, {rule}" for gap in gaps]


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
        f"stream {stream.name!r}: {fault}"
        for stream in streams
        for fault in _stream_faults(stream, start_s, end_s)
    ]


def _stream_faults(stream: SensorStream, start_s: float, end_s: float) -> Iterator[str]:
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


def clock_text(offset_s: float, sigma_s: float, reference: str) -> str:
    """What a sensor's clock is beside `reference`, ``"the camera's"``; its stamps lack `offset_s` [s]."""
    side = "behind" if offset_s > 0 else "ahead of"
    return f"its clock is {abs(offset_s):.2f} ± {sigma_s:.2f} s {side} {reference}"


def repeats(values: FloatArray) -> BoolArray:
    """Which of (n,) or (n, K) values are equal to those before them, (n,)."""
    same = np.diff(values, axis=0, prepend=np.nan) == 0
    return np.asarray(same if same.ndim == 1 else same.all(axis=1))


def rows_of_repeats(values: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of equal values in (n,) or (n, K), (m,): the first of each, and the one after its last."""
    begins = np.flatnonzero(~repeats(values))
    return begins, np.append(begins[1:], len(values))


def local_medians(rows: FloatArray, reach: int) -> FloatArray:
    """Median of each row, (n,) or (n, k), and of `reach` on either side, of fewer at the ends.

    :func:`sfmcpp.weighting.running_median` has no medians where neighbours are missing.
    """
    padded = np.pad(rows, [(reach, reach), *[(0, 0)] * (rows.ndim - 1)], constant_values=np.nan)
    # Sorted, what is missing comes last: a fifth of the time of nanmedian, which live streams would feel.
    windows = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0), axis=-1)
    known = np.count_nonzero(~np.isnan(windows), axis=-1)
    low, high = (np.take_along_axis(windows, k[..., None], -1) for k in ((known - 1) // 2, known // 2))
    return np.asarray(0.5 * (low + high)[..., 0])


@checked(pose=(3, 4), angular_rate_rad_s=(3,), velocity_m_s=(3,))
def predict_pose(
    pose: FloatArray, angular_rate_rad_s: FloatArray, velocity_m_s: FloatArray, seconds: float
) -> FloatArray:
    """Move on with constant velocity: thesis eqs 1.1–1.3.

    Parameters
    ----------
    pose : (3, 4) float64
        ``[R | c]`` world_from_body.
    angular_rate_rad_s : (3,) float64
        Angular rate in the body frame.
    velocity_m_s : (3,) float64
        Velocity in the world.
    seconds : float
        How far ahead, or back where negative.

    Returns
    -------
    (3, 4) float64
        ``[R exp(ω dt) | c + v dt]``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite.
    """
    pose = finite_array("pose", pose, (3, 4))
    turn = finite_array("angular_rate_rad_s", angular_rate_rad_s, (3,)) * seconds
    shift = finite_array("velocity_m_s", velocity_m_s, (3,)) * seconds
    return np.column_stack([pose[:, :3] @ so3.exp(turn), pose[:, 3] + shift])


def interpolate_rotations(t_s: FloatArray, rotations: FloatArray, times_s: FloatArray) -> FloatArray:
    """Turn at constant rate from each rotation to the next, and on beyond the ends.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    rotations : (n, 3, 3) float64
        World_from_body at these stamps.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, 3, 3) float64
        ``R_i exp(u log(R_iᵀ R_{i+1}))``; the only rotation there is, if n is 1.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    t_s, times_s = _checked_stamps(t_s, times_s)
    rotations = finite_array("rotations", rotations, (len(t_s), 3, 3))
    return _turned_between(np.asarray, rotations, _bracketing_rows(t_s, times_s))


def interpolate_vectors(t_s: FloatArray, vectors: FloatArray, times_s: FloatArray) -> FloatArray:
    """Go in a straight line from each vector to the next, and on beyond the ends.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    vectors : (n, k) float64
        Positions, distances or the like at these stamps.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, k) float64

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    t_s, times_s = _checked_stamps(t_s, times_s)
    vectors = finite_array("vectors", vectors, (len(t_s), ANY))
    return _moved_between(vectors, _bracketing_rows(t_s, times_s))


def interpolate_poses(t_s: FloatArray, poses: FloatArray, times_s: FloatArray) -> FloatArray:
    """Poses between stamps, and beyond the ends by constant velocity.

    Beyond the ends this is eqs 1.2 and 1.3 with the velocities of the last, or first, two poses.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    poses : (n, 3, 4) float64
        ``[R | c]`` world_from_body.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, 3, 4) float64

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    poses = finite_array("poses", poses, (ANY, 3, 4))
    rotations = interpolate_rotations(t_s, poses[:, :, :3], times_s)
    centres = interpolate_vectors(t_s, poses[:, :, 3], times_s)
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def _checked_stamps(t_s: FloatArray, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    t_s = finite_array("t_s", t_s, (ANY,))
    if not len(t_s):
        raise InvalidArgument("t_s: there is no stamp, must be at least one")
    require_increasing("t_s", t_s)
    return t_s, finite_array("times_s", times_s, (ANY,))


def _turned_between(
    rotation_of: Callable[[FloatArray], FloatArray], rows: FloatArray, sides: _Sides
) -> FloatArray:
    """Rotations (m, 3, 3) between those of the rows (n, …) on both sides of each time."""
    before, after, share = sides
    start, end = rotation_of(rows[before]), rotation_of(rows[after])
    return np.asarray(start @ so3.exp(share[:, None] * so3.log(np.swapaxes(start, 1, 2) @ end)))


def _moved_between(vectors: FloatArray, sides: _Sides) -> FloatArray:
    """Vectors (m, k) on the straight lines between those on both sides of each time."""
    before, after, share = sides
    return np.asarray(vectors[before] + share[:, None] * (vectors[after] - vectors[before]))


def _bracketing_rows(t_s: FloatArray, times_s: FloatArray) -> _Sides:
    """Rows before and after each time, and how far from one to the other; outside [0, 1] beyond the ends."""
    if len(t_s) == 1:
        alone = np.zeros(len(times_s), dtype=np.int64)
        return alone, alone, np.zeros(len(times_s))
    before = np.clip(np.searchsorted(t_s, times_s, side="right") - 1, 0, len(t_s) - 2)
    return before, before + 1, (times_s - t_s[before]) / (t_s[before + 1] - t_s[before])
