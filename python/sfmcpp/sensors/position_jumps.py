"""Positions that jump away and come back: reflected signals, or another set of satellites."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_not_negative, require_positive
from sfmcpp.model.sensor_stream import FASTEST_M_S
from sfmcpp.sensors.speed_leaps import LARGEST_ACCELERATION_M_S2
from sfmcpp.sensors.stream import local_medians, repeats, require_kind, rows_of_repeats

# The velocity at a step is a median over this time [s] on either side, of at least 2 and at most 5 steps.
_SPEED_WITHIN_S, _LEAST_REACH, _LARGEST_REACH = 0.5, 2, 5
# Relative error of a period of rounded stamps, which must not cost a step.
_ROUNDING = 1e-5
# A level is the median of so many positions. Outliers of fewer than half of them do not change it: they are
# found one by one, by their distance from it.
_LEVEL = 4
# In units of σ, above all differences of levels, and of positions from their level, that white noise causes:
# the largest of 84,600 on KITTI's 0001, 0027, 0036 and 0039 were 7.4 and 6.0.
_NOISE = 9.0
# Largest error of a step between two fault-free positions, in units of σ, and least σ [m].
_NOISE_SIGMAS, _LEAST_SIGMA_M = 10.0, 1.0
# The motion of the vehicle may shorten one of the two large steps of a jump: stretches also end at steps of
# this share of the largest possible one.
_CUT_SHARE = 0.5
# More large steps are noise; such a stream is not searched.
_MOST_LEAPS = 1000
# Fewer different fixes are those of a place.
_FEWEST_FIXES = 3
# A fix that is repeated for longer than a logger does [s], the next one farther away than noise makes it.
_LONG_HELD_S, _FAR_SIGMAS = 1.5, 6.0


@checked()
def displaced_positions(stream: SensorStream, sigma_m: float = 1.0) -> NDArray[np.bool_]:
    """Find positions that have jumped away from the others, until they jump back.

    The motion, integrated from running medians of the velocity, is subtracted; what remains is constant but
    for noise. Where its level changes by more than noise and the acceleration of a vehicle explain, and later
    changes back, the positions between are displaced. After a jump without return it is not known which side
    is displaced.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    sigma_m : float
        Standard deviation of a position along each axis [m].

    Returns
    -------
    (n,) bool
        All False if more than half would be displaced: it is then not known which ones are.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `sigma_m` is not positive.
    """
    require_kind(stream, "position")
    require_positive("sigma_m", sigma_m)
    if len(stream) < 2 * _LEVEL:
        return np.zeros(len(stream), dtype=bool)
    period_s = float(np.median(np.diff(stream.t_s)))
    half_window_s = 0.5 * _reach(period_s) * period_s
    limit_m = _NOISE * sigma_m + LARGEST_ACCELERATION_M_S2 * half_window_s**2
    left = _without_motion(stream.t_s, stream.values)
    displaced = np.linalg.norm(left - local_medians(left, _LEVEL), axis=1) > limit_m
    rest = np.flatnonzero(~displaced)
    if len(rest) >= 2 * _LEVEL:
        changes = _level_changes(_without_motion(stream.t_s[rest], stream.values[rest]))
        displaced[rest[_between_jumps(changes, limit_m)]] = True
    return np.asarray(displaced & (2 * np.count_nonzero(displaced) <= len(stream)))


def _without_motion(t_s: FloatArray, positions: FloatArray) -> FloatArray:
    """Positions (n, 3) less the integral of the median velocity about each step."""
    periods_s = np.diff(t_s)
    reach = _reach(float(np.median(periods_s)))
    speeds = local_medians(np.diff(positions, axis=0) / periods_s[:, None], reach)
    way = np.concatenate([np.zeros((1, 3)), np.cumsum(speeds * periods_s[:, None], axis=0)])
    return np.asarray(positions - way)


def _reach(period_s: float) -> int:
    """Number of steps on either side in the median of a velocity."""
    steps = _SPEED_WITHIN_S / period_s * (1 + _ROUNDING)
    return int(np.clip(steps, _LEAST_REACH, _LARGEST_REACH))


def _level_changes(left: FloatArray) -> FloatArray:
    """Level after each step less that before it, (n - 1, 3); 0 near both ends."""
    levels = np.median(np.lib.stride_tricks.sliding_window_view(left, _LEVEL, axis=0), axis=-1)
    changes = np.zeros((len(left) - 1, 3))
    changes[_LEVEL - 1 : 1 - _LEVEL] = levels[_LEVEL:] - levels[:-_LEVEL]
    return changes


def _between_jumps(changes: FloatArray, limit_m: float) -> NDArray[np.bool_]:
    """Positions (n,) between a jump and the nearest one back."""
    displaced = np.zeros(len(changes) + 1, dtype=bool)
    jumps = _peaks(np.linalg.norm(changes, axis=1), 0.5 * limit_m)
    sizes = np.linalg.norm(changes[jumps], axis=1)
    free = np.ones(len(jumps), dtype=bool)
    for number in np.flatnonzero(sizes > limit_m).tolist():
        if not free[number]:
            continue
        misfit = np.linalg.norm(changes[jumps] + changes[jumps[number]], axis=1)
        undo = np.flatnonzero(free & (misfit < limit_m) & (sizes > 0.5 * sizes[number]))
        if len(undo):
            other = int(undo[np.argmin(np.abs(undo - number))])
            free[[number, other]] = False
            first, last = sorted((jumps[number], jumps[other]))
            displaced[first + 1 : last + 1] = True
    return displaced


def _peaks(sizes: FloatArray, limit: float) -> NDArray[np.intp]:
    """Indices of local maxima above a limit, each the largest within the length of a level."""
    padded = np.pad(sizes, _LEVEL - 1)
    largest = np.lib.stride_tricks.sliding_window_view(padded, 2 * _LEVEL - 1).max(axis=-1)
    return np.flatnonzero((sizes > limit) & (sizes == largest))


@checked()
def without_repeats(stream: SensorStream) -> SensorStream:
    """Leave out positions that repeat the one before to the last digit: nobody has measured them.

    Receivers repeat their last fix while they have none, and loggers until there is a new one.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"`` or ``"pose"``.

    Returns
    -------
    SensorStream
        The given stream if nothing is left out, or hardly any would be left.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "position", "pose")
    anew = ~repeats(stream.values)
    return stream if anew.all() or np.count_nonzero(anew) < _FEWEST_FIXES else stream.only(anew)


@checked()
def longest_lost_fix(stream: SensorStream, sigma_m: float) -> tuple[float, float] | None:
    """The longest time for which a fix was repeated though the receiver moved on.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"`` or ``"pose"``.
    sigma_m : float
        Standard deviation of a position along each axis [m].

    Returns
    -------
    (start, length) or None
        Time of the fix, and from it to the last repeat [s]; None if the next fix is always near.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `sigma_m` is not positive.
    """
    require_kind(stream, "position", "pose")
    require_positive("sigma_m", sigma_m)
    begins, following = rows_of_repeats(stream.values)
    held_s = stream.t_s[following - 1] - stream.t_s[begins]
    places = stream.values[begins, :3]
    ways = np.append(np.linalg.norm(np.diff(places, axis=0), axis=1), 0.0)
    lost = np.where((held_s > _LONG_HELD_S) & (ways > _FAR_SIGMAS * sigma_m), held_s, 0.0)
    longest = int(np.argmax(lost))
    return None if lost[longest] == 0 else (float(stream.t_s[begins[longest]]), float(held_s[longest]))


@checked()
def without_leaps(stream: SensorStream, sigma_m: float | None = None) -> SensorStream:
    """Leave out positions that a vehicle cannot have reached from the others, as of a lost fix.

    The stream is cut into stretches at large steps. Of all sequences of stretches that a vehicle can have
    driven, the one with the most positions is kept; a stream without impossible steps is kept whole.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"`` or ``"pose"``.
    sigma_m : float, optional
        Standard deviation of a position along each axis [m]; less than a metre, or None, counts as one.

    Returns
    -------
    SensorStream
        The given stream if nothing is left out.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `sigma_m` is negative or not finite.
    """
    require_kind(stream, "position", "pose")
    if sigma_m is not None:
        require_not_negative("sigma_m", sigma_m)
    t_s, places = stream.t_s, stream.values[:, :3]
    noise_m = _NOISE_SIGMAS * max(sigma_m or 0.0, _LEAST_SIGMA_M)
    leaps, cuts = (
        1 + np.flatnonzero(~_reachable(t_s[:-1], places[:-1], t_s[1:], places[1:], noise_m, share))
        for share in (1.0, _CUT_SHARE)
    )
    if not 0 < len(leaps) <= _MOST_LEAPS:
        return stream
    cuts = cuts if len(cuts) <= _MOST_LEAPS else leaps
    first, last = np.concatenate([[0], cuts]), np.concatenate([cuts, [len(t_s)]]) - 1
    counts = last - first + 1
    before = np.full(len(first), -1)
    for k in range(1, len(first)):
        possible = _reachable(t_s[last[:k]], places[last[:k]], t_s[first[k]], places[first[k]], noise_m)
        best = int(np.argmax(np.where(possible, counts[:k], 0)))
        if possible[best]:
            before[k] = best
            counts[k] += counts[best]
    kept, at = np.zeros(len(t_s), dtype=bool), int(np.argmax(counts))
    while at >= 0:
        kept[first[at] : last[at] + 1] = True
        at = int(before[at])
    return stream.only(kept)


def _reachable(
    start_s: FloatArray,
    start: FloatArray,
    end_s: FloatArray | float,
    end: FloatArray,
    noise_m: float,
    share: float = 1.0,
) -> NDArray[np.bool_]:
    """Whether the distance between two places is at most a share of what a vehicle can drive in the time."""
    way = np.linalg.norm(end - start, axis=1)
    return np.asarray(way <= share * (FASTEST_M_S * (end_s - start_s) + noise_m))
