"""Bias of angular rates, by the rotations of pairs of images and by what the rates say while the body rests.

A map follows a gyroscope that it is fitted to; the rotation that two images tell by themselves does not, and
is right to a milliradian or two where it is not wrong altogether. A bias of a tenth of a degree per second
hides in its noise, but not in a second in which nothing turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.rotation_check import turns_at_offsets
from sfmcpp.sensors.stream import is_coarse, require_kind
from sfmcpp.sensors.turn import CLOCK_OFFSETS_S, Turn, rotations_of, times_of

# Pairs of images used: fewer do not determine a bias, and more are not needed.
_FEWEST, MOST_TURNS = 6, 64
# A bias is one from so many standard deviations on, and from so much over the root of the number of turns on
# [rad/s]: with both, in no window of the fault-free streams of 0001, 0027, 0036 and 0039 there was one.
_SIGMAS = 5.0
_LEAST_RAD_S = float(np.radians(3.7))
# With as many pairs the standard deviations alone decide: in windows of the same streams there were up to 6.1
# with 6 to 16 pairs, 3.5 with 24, 2.8 with 32 or more.
_MANY = 32
# No gyroscope has more; rates in a wrong unit do [rad/s].
LARGEST_RAD_S = float(np.radians(20.0))
# Least standard deviation of the rotations by images [rad].
_LEAST_ERROR_RAD = 0.001
# A clock offset looks like a bias where the rate changes, and wrong axes do where it does not. The bias must
# leave at most this share of the errors that the best clock leaves, or the best axes …
_SHARE_OF_OTHERS = 0.5
# … or explain many pairs better by so much in log-likelihood, as a small bias hides in the noise of each.
_GAIN = 12.0
# A stream that turns by less than this share of what the camera does may be dead, or in a wrong unit: an even
# turn of the camera is then no bias.
_DEAD_SHARE = 0.5
# Median length of a vector of three standard normal numbers.
_MEDIAN_LENGTH = 1.538
# Rounds of reweighting.
_ROUNDS = 6
# Left out at both ends of a rest, as clocks differ [s], and what must be left [s].
_MARGIN_S, _LEAST_S = 0.25, 0.5
# Fewest samples of a rest.
_FEWEST_AT_REST = 5
# Rates that turn a body from where their mean does by more than this [rad] and so many standard deviations of
# their noise are of one that does not rest.
_SAME_RAD, _SAME_SIGMAS = 0.002, 4.0
# A rest whose rate is farther from the median of all rests than this is none: no bias walks so far [rad/s].
_LARGEST_WALK_RAD_S = float(np.radians(1.0))


@dataclass(frozen=True, eq=False)
class RateBias:
    """A bias of angular rates that is known at some times.

    Attributes
    ----------
    t_s : (k,) float64
        These times, increasing [s].
    rates_rad_s : (k, 3) float64
        The bias then, in the axes of the body [rad/s].
    """

    t_s: FloatArray
    rates_rad_s: FloatArray

    def at(self, t_s: FloatArray) -> FloatArray:
        """The bias (n, 3) at times (n,): linear between those known, constant before and after [rad/s]."""
        return np.column_stack([np.interp(t_s, self.t_s, column) for column in self.rates_rad_s.T])

    def plus(self, rate_rad_s: FloatArray) -> RateBias:
        """The same with a constant bias (3,) beside it."""
        return RateBias(self.t_s, self.rates_rad_s + rate_rad_s)

    def differs_from(self, other: RateBias | None, largest_rad_s: float) -> bool:
        """Whether it differs by more than that at any time from another one, or from none."""
        t_s = np.union1d(self.t_s, [] if other is None else other.t_s)
        rates = self.at(t_s) - (0.0 if other is None else other.at(t_s))
        return bool(np.linalg.norm(rates, axis=1).max() > largest_rad_s)

    @property
    def complaint(self) -> str:
        """What is removed."""
        sizes = np.degrees(np.linalg.norm(self.rates_rad_s, axis=1))
        told = " to ".join(dict.fromkeys(f"{size:.1f}" for size in (sizes.min(), sizes.max())))
        return f"a bias of {told}°/s is removed from its rates"


@checked()
def find_bias(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> FloatArray | None:
    """Estimate the bias of angular rates from the rotations of pairs of images.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    mounting : Mounting
        How the camera sits on the body.
    turns : sequence of Turn
        Some of which may be wrong. The last 64 are looked at.

    Returns
    -------
    (3,) float64 or None
        To be taken from the rates, in the axes of the body [rad/s]. None where the turns show none: fewer
        than six (of samples more than 0.3 s apart, than 32) that the stream covers together with the second
        after them, a rate within what they may be off by, or errors that a wrong clock or wrong axes explain
        as well.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    # Clocks that are ahead need the rates after a turn: without them noise would be taken for a bias.
    reach_s = float(CLOCK_OFFSETS_S[-1])
    covered = [turn for turn in turns[-MOST_TURNS:] if stream.covers(turn.start_s, turn.end_s + reach_s)]
    if len(covered) < (_MANY if is_coarse(stream) else _FEWEST):
        return None
    errors, lengths_s = rotation_errors(stream, mounting, covered, np.zeros(1))[0], durations_s(covered)
    rate, sigma = constant_rate(errors, lengths_s)
    floor = _LEAST_RAD_S / np.sqrt(len(covered)) if len(covered) < _MANY else 0.0
    if not max(_SIGMAS * sigma, floor) <= np.linalg.norm(rate) <= LARGEST_RAD_S:
        return None
    left = np.linalg.norm(errors - lengths_s[:, None] * rate, axis=1)
    if not _is_likelier(left, _left_by_others(stream, mounting, covered)):
        return None
    return np.asarray(mounting.camera_from_body.T @ rate)


@checked()
def bias_at_rest(stream: SensorStream, rests: Sequence[Gap]) -> RateBias | None:
    """The mean of angular rates during each rest of the body.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    rests : sequence of Gap
        In the order of time; a quarter of a second at both ends is left out.

    Returns
    -------
    RateBias or None
        Known in the middle of each rest that has half a second left with five samples, whose rates turn the
        body by less than two milliradians and their noise beside their mean, which is 20°/s at most; None if
        there is no such rest. Rests with rates more than 1°/s from the median of all are left out.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    known = [(rest, rate) for rest in rests if (rate := _rate_at_rest(stream, rest)) is not None]
    if not known:
        return None
    middles_s = np.array([0.5 * (rest.start_s + rest.end_s) for rest, _ in known])
    rates = np.array([rate for _, rate in known])
    alike = np.linalg.norm(rates - np.median(rates, axis=0), axis=1) <= _LARGEST_WALK_RAD_S
    return RateBias(middles_s[alike], rates[alike]) if alike.any() else None


@checked()
def without_bias(stream: SensorStream, bias: FloatArray | RateBias) -> SensorStream:
    """The stream without a bias.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    bias : (3,) float64 or RateBias
        What to take from its rates [rad/s].

    Returns
    -------
    SensorStream

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    rates = bias.at(stream.t_s) if isinstance(bias, RateBias) else finite_array("bias", bias, (3,))
    return replace(stream, values=stream.values - rates)


def durations_s(turns: Sequence[Turn]) -> FloatArray:
    """Time between both ends of each motion (n,) [s]."""
    return np.array([turn.end_s - turn.start_s for turn in turns])


def rotation_errors(
    stream: SensorStream, mounting: Mounting, turns: Sequence[Turn], offsets: FloatArray
) -> FloatArray:
    """Rotation vectors (offsets, n, 3) from the rotations of images to those of the stream [rad]."""
    told = turns_at_offsets(stream, mounting, times_of(turns), offsets)
    return so3.log(np.swapaxes(rotations_of(turns), 1, 2) @ told)


def constant_rate(errors: FloatArray, lengths_s: FloatArray) -> tuple[FloatArray, float]:
    """Constant rate (3,) that explains rotation vectors (n, 3), and its standard deviation [rad/s].

    By iteratively reweighted least squares with Cauchy's weights.
    """
    rates = errors / lengths_s[:, None]
    rate: FloatArray = np.median(rates, axis=0)
    for _ in range(_ROUNDS):
        left = np.linalg.norm(errors - lengths_s[:, None] * rate, axis=1)
        scale = error_scale(left)
        weights = lengths_s**2 / (1 + (left / (2 * scale)) ** 2)
        rate = weights @ rates / weights.sum()
    return rate, float(scale / np.sqrt(weights.sum()))


def error_scale(lengths: FloatArray) -> float:
    """Standard deviation of the entries of rotation vectors by the median of their lengths (n,) [rad]."""
    return max(float(np.median(lengths)) / _MEDIAN_LENGTH, _LEAST_ERROR_RAD)


def cauchy_loss(lengths: FloatArray, scale: float) -> FloatArray:
    """Negative log-likelihood of rotation vectors by their lengths (…, n), with Cauchy's density."""
    return np.asarray(np.log1p((lengths / (2 * scale)) ** 2).sum(axis=-1))


def _is_likelier(left: FloatArray, by_others: FloatArray) -> bool:
    """Whether a bias that leaves errors of lengths (n,) explains more than what leaves each of (k, n)."""
    if np.median(left) <= _SHARE_OF_OTHERS * np.median(by_others, axis=1).min():
        return True
    scale = error_scale(left)
    gain = cauchy_loss(by_others, scale).min() - cauchy_loss(left, scale)
    return len(left) >= _MANY and bool(gain >= _GAIN)


def _left_by_others(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> FloatArray:
    """Lengths (k, n) of the errors at each clock offset, with the best axes, and of a dead stream [rad]."""
    by_clocks = np.linalg.norm(rotation_errors(stream, mounting, turns, CLOCK_OFFSETS_S), axis=-1)
    seen, lengths_s = so3.log(rotations_of(turns)), durations_s(turns)
    told = so3.log(turns_at_offsets(stream, mounting, times_of(turns), np.zeros(1))[0])
    others = [by_clocks, _left_by_axes(seen, told)]
    if _median_norm(told) < _DEAD_SHARE * _median_norm(seen):
        others.append(np.linalg.norm(seen - lengths_s[:, None] * constant_rate(seen, lengths_s)[0], axis=1))
    return np.vstack(others)


def _left_by_axes(seen: FloatArray, told: FloatArray) -> FloatArray:
    """Lengths (n,) of what the best axes leave of rotation vectors (n, 3) that differ [rad].

    Wrong axes keep the angle of each rotation, a bias changes it. By iteratively reweighted orthogonal
    Procrustes fits with Cauchy's weights; mirrored axes count, too. A free scale would take a bias on a
    straight road for one.
    """
    weights = np.ones(len(seen))
    for _ in range(_ROUNDS):
        left, _, right = np.linalg.svd(seen.T @ (weights[:, None] * told))
        lengths = np.linalg.norm(seen - told @ (left @ right).T, axis=1)
        weights = 1 / (1 + (lengths / (2 * error_scale(lengths))) ** 2)
    return np.asarray(lengths)


def _median_norm(errors: FloatArray) -> FloatArray:
    return np.asarray(np.median(np.linalg.norm(errors, axis=-1), axis=-1))


def _rate_at_rest(stream: SensorStream, rest: Gap) -> FloatArray | None:
    """Mean rate (3,) of one rest; None where it is not known, or not of a body that rests."""
    start_s, end_s = rest.start_s + _MARGIN_S, rest.end_s - _MARGIN_S
    if end_s - start_s < _LEAST_S or not stream.covers(start_s, end_s):
        return None
    first, last = np.searchsorted(stream.t_s, [start_s, end_s])
    rates = stream.values[first:last]
    if len(rates) < _FEWEST_AT_REST:
        return None
    rate: FloatArray = rates.mean(axis=0)
    step_s = (end_s - start_s) / len(rates)
    angles = step_s * np.cumsum(rates - rate, axis=0)
    # Of sums up to the middle, whose noise is largest; that of one rate by those beside it.
    noise = step_s * 0.5 * np.sqrt(len(rates) * (np.diff(rates, axis=0) ** 2).mean(axis=0) / 2)
    turns = (np.abs(angles) > _SAME_RAD + _SAME_SIGMAS * noise).any()
    return None if turns or np.linalg.norm(rate) > LARGEST_RAD_S else rate
