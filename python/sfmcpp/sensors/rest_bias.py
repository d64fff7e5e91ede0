"""Bias of angular rates by what they say while the body rests.

A bias of a tenth of a degree per second hides in the noise of rotations by two images, but not in a second in
which nothing turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.rate_bias import LARGEST_RAD_S, RateBias
from sfmcpp.sensors.stream import require_kind

# Left out at both ends of a rest, as clocks differ [s], and what must be left [s].
_MARGIN_S, _LEAST_S = 0.25, 0.5
# Fewest samples of a rest.
_FEWEST = 5
# Rates that turn a body from where their mean does by more than this [rad] and so many standard deviations of
# their noise are of one that does not rest.
_SAME_RAD, _SAME_SIGMAS = 0.002, 4.0
# A rest whose rate is farther from the median of all rests than this is none: no bias walks so far [rad/s].
_LARGEST_WALK_RAD_S = float(np.radians(1.0))


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
    known = [(rest, rate) for rest in rests if (rate := _rate_of(stream, rest)) is not None]
    if not known:
        return None
    middles_s = np.array([0.5 * (rest.start_s + rest.end_s) for rest, _ in known])
    rates = np.array([rate for _, rate in known])
    alike = np.linalg.norm(rates - np.median(rates, axis=0), axis=1) <= _LARGEST_WALK_RAD_S
    return RateBias(middles_s[alike], rates[alike]) if alike.any() else None


def _rate_of(stream: SensorStream, rest: Gap) -> FloatArray | None:
    """Mean rate (3,) of one rest; None where it is not known, or not of a body that rests."""
    start_s, end_s = rest.start_s + _MARGIN_S, rest.end_s - _MARGIN_S
    if end_s - start_s < _LEAST_S or not stream.covers(start_s, end_s):
        return None
    first, last = np.searchsorted(stream.t_s, [start_s, end_s])
    rates = stream.values[first:last]
    if len(rates) < _FEWEST:
        return None
    rate: FloatArray = rates.mean(axis=0)
    step_s = (end_s - start_s) / len(rates)
    angles = step_s * np.cumsum(rates - rate, axis=0)
    # Of sums up to the middle, whose noise is largest; that of one rate by those beside it.
    noise = step_s * 0.5 * np.sqrt(len(rates) * (np.diff(rates, axis=0) ** 2).mean(axis=0) / 2)
    turns = (np.abs(angles) > _SAME_RAD + _SAME_SIGMAS * noise).any()
    return None if turns or np.linalg.norm(rate) > LARGEST_RAD_S else rate
