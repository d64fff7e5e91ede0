"""Ways of an odometer that go on from another origin: a counter that wraps, or is reset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.sensors.speed_leaps import LARGEST_ACCELERATION_M_S2
from sfmcpp.sensors.speed_resolution import step_of
from sfmcpp.sensors.stream import local_medians, require_kind

# A step is compared with the median of so many on either side. A leap differs from it by more than so many
# times the usual speed and what a tick makes of it, and what a body can accelerate over as many samples.
_NEIGHBOURS, _TIMES = 2, 2.0
# It is also so many times as long as nearly all steps, without those of a value that is repeated.
_LONGER, _NEARLY_ALL = 4.0, 0.9


@checked()
def counter_leaps(stream: SensorStream) -> NDArray[np.bool_]:
    """Find the steps of a way that no body makes, while those before and after are as usual.

    A body does not get to 600 m/s and back within two samples: its way is counted from another origin.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"distance"``.

    Returns
    -------
    (n - 1,) bool
        Which steps from sample to sample are leaps; never two in a row.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "distance")
    if len(stream) < 2 * _NEIGHBOURS + 2:
        return np.zeros(len(stream) - 1, dtype=bool)
    periods_s = np.diff(stream.t_s)
    speeds = np.diff(stream.values[:, 0]) / periods_s
    usual = local_medians(speeds, _NEIGHBOURS)
    least = _TIMES * (np.abs(usual) + step_of(stream) + LARGEST_ACCELERATION_M_S2 * periods_s)
    steps = np.abs(np.diff(stream.values[:, 0]))
    if not steps.any():
        return steps > 0
    longest = _LONGER * float(np.quantile(steps[steps > 0], _NEARLY_ALL))
    leaps = (np.abs(speeds - usual) > least) & (steps > longest)
    beside = np.convolve(leaps, [1, 0, 1], "same") > 0
    return np.asarray(leaps & ~beside)


@checked()
def without_counter_leaps(stream: SensorStream) -> SensorStream:
    """The stream with a step at the speed of its neighbours in place of each leap; itself if there are none.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"distance"``.

    Returns
    -------
    SensorStream

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    leaps = counter_leaps(stream)
    if not leaps.any():
        return stream
    periods_s = np.diff(stream.t_s)
    steps, middles_s = np.diff(stream.values[:, 0]), stream.t_s[:-1] + 0.5 * periods_s
    between = np.interp(middles_s[leaps], middles_s[~leaps], (steps / periods_s)[~leaps])
    steps[leaps] = periods_s[leaps] * between
    ways = stream.values[0, 0] + np.concatenate([[0.0], np.cumsum(steps)])
    return replace(stream, values=ways[:, None])


def describe_counter_leaps(stream: SensorStream) -> list[str]:
    """Tell of the leaps of a way: how many, the first.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"distance"``.

    Returns
    -------
    list of str
        One line, or none.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    rows = np.flatnonzero(counter_leaps(stream))
    if not len(rows):
        return []
    first = rows[0]
    by_m = float(stream.values[first + 1, 0] - stream.values[first, 0])
    times = "once" if len(rows) == 1 else f"{len(rows)} times"
    return [
        f"stream {stream.name!r}: the way leaps {times}, first by {by_m:.3g} m at {stream.t_s[first]:.3f} s, "
        "and goes on as before: a counter that wraps? A step as those beside it takes its place"
    ]
