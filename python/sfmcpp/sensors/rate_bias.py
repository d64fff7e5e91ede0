"""Bias of angular rates, estimated from the rotations of pairs of images.

A map follows a gyroscope that it is fitted to; the rotation that two images tell by themselves does not, and
is right to a milliradian or two where it is not wrong altogether.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.rotation_check import turns_at_offsets
from sfmcpp.sensors.stream import require_kind
from sfmcpp.sensors.turn import Turn, rotations_of, times_of

# Pairs of images used: fewer do not determine a bias, and more are not needed.
_FEWEST, MOST_TURNS = 6, 64
# A bias is one from so many standard deviations on, and from so much over the root of the number of turns on
# [rad/s]: with both, in no window of the fault-free streams of 0001, 0027, 0036 and 0039 there was one.
_SIGMAS = 5.0
_LEAST_RAD_S = float(np.radians(3.7))
# No gyroscope has more; rates in a wrong unit do [rad/s].
LARGEST_RAD_S = float(np.radians(20.0))
# Least standard deviation of the rotations by images [rad].
_LEAST_ERROR_RAD = 0.001
# A clock offset looks like a bias where the rate changes, and wrong axes do where it does not. The bias must
# leave at most this share of the errors that the best clock leaves, or that an evenly turning camera leaves …
_SHARE_OF_OTHERS = 0.5
# … the latter if the errors are, beside the camera's rotations, no larger than wrong axes make them.
_LARGEST_RATIO = 2.0
# Clock offsets tried [s].
_OFFSETS_S = np.linspace(-1.0, 1.0, 41)
# Median length of a vector of three standard normal numbers.
_MEDIAN_LENGTH = 1.538
# Rounds of reweighting.
_ROUNDS = 6


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
        than six that the stream covers together with the second after them, a rate within what they may be
        off by, or errors that a wrong clock or wrong axes explain as well.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    # Clocks that are ahead need the rates after a turn: without them noise would be taken for a bias.
    reach_s = float(_OFFSETS_S[-1])
    covered = [turn for turn in turns[-MOST_TURNS:] if stream.covers(turn.start_s, turn.end_s + reach_s)]
    if len(covered) < _FEWEST:
        return None
    errors, lengths_s = rotation_errors(stream, mounting, covered, np.zeros(1))[0], durations_s(covered)
    rate, sigma = _rate(errors, lengths_s)
    least = max(_SIGMAS * sigma, _LEAST_RAD_S / np.sqrt(len(covered)))
    if not least <= np.linalg.norm(rate) <= LARGEST_RAD_S:
        return None
    left = _median_norm(errors - lengths_s[:, None] * rate)
    if left > _SHARE_OF_OTHERS * _median_error_of_alternatives(stream, mounting, covered, errors):
        return None
    return np.asarray(mounting.camera_from_body.T @ rate)


@checked(rate_rad_s=(3,))
def without_bias(stream: SensorStream, rate_rad_s: FloatArray) -> SensorStream:
    """The stream without a bias.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    rate_rad_s : (3,) float64
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
    return replace(stream, values=stream.values - rate_rad_s)


def durations_s(turns: Sequence[Turn]) -> FloatArray:
    """Time between both ends of each motion (n,) [s]."""
    return np.array([turn.end_s - turn.start_s for turn in turns])


def rotation_errors(
    stream: SensorStream, mounting: Mounting, turns: Sequence[Turn], offsets: FloatArray
) -> FloatArray:
    """Rotation vectors (offsets, n, 3) from the rotations of images to those of the stream [rad]."""
    told = turns_at_offsets(stream, mounting, times_of(turns), offsets)
    return so3.log(np.swapaxes(rotations_of(turns), 1, 2) @ told)


def _rate(errors: FloatArray, lengths_s: FloatArray) -> tuple[FloatArray, float]:
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


def _median_norm(errors: FloatArray) -> FloatArray:
    return np.asarray(np.median(np.linalg.norm(errors, axis=-1), axis=-1))


def _median_error_of_alternatives(
    stream: SensorStream, mounting: Mounting, turns: Sequence[Turn], errors: FloatArray
) -> float:
    """Median error at the best clock offset, or with a camera that turns evenly if that is less [rad]."""
    by_clocks = float(_median_norm(rotation_errors(stream, mounting, turns, _OFFSETS_S)).min())
    seen, lengths_s = so3.log(rotations_of(turns)), durations_s(turns)
    if _median_norm(errors) > _LARGEST_RATIO * _median_norm(seen):
        return by_clocks
    evenly = seen - lengths_s[:, None] * _rate(seen, lengths_s)[0]
    return min(by_clocks, float(_median_norm(evenly)))
