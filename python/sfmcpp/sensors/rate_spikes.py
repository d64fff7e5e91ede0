"""Angular rates that leap away and back within a sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.stream import require_kind

# How far a rate is from the mean of its neighbours: of the eight KITTI drives by 5°/s at most, and 7.9 times
# what half of the samples are. A spike is as far off as neither, and farther than its neighbours are apart.
_LEAST_RAD_S, _LEAST_RATIO = float(np.radians(10.0)), 16.0
# Neighbours across a gap tell nothing.
_LONGEST_PERIODS = 3.0


@checked()
def rate_spikes(stream: SensorStream) -> NDArray[np.bool_]:
    """Find the rates that leap away from both neighbours, while these agree.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.

    Returns
    -------
    (n,) bool
        Which samples are spikes; never the first or the last.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    spikes = np.zeros(len(stream), dtype=bool)
    if len(stream) < 3:
        return spikes
    away = np.linalg.norm(stream.values[1:-1] - _between_neighbours(stream.values), axis=1)
    apart = np.linalg.norm(stream.values[2:] - stream.values[:-2], axis=1)
    near = stream.t_s[2:] - stream.t_s[:-2] < _LONGEST_PERIODS * stream.period_s
    least = max(_LEAST_RAD_S, _LEAST_RATIO * float(np.median(away)))
    spikes[1:-1] = near & (away > least) & (away > apart)
    return spikes


@checked()
def without_spikes(stream: SensorStream) -> SensorStream:
    """The stream with the mean of its sound neighbours in place of each spike; itself if there are none.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.

    Returns
    -------
    SensorStream

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    spikes = rate_spikes(stream)
    if not spikes.any():
        return stream
    values, rows, sound = stream.values.copy(), np.flatnonzero(spikes), np.flatnonzero(~spikes)
    after = np.searchsorted(sound, rows)
    values[rows] = 0.5 * (values[sound[after - 1]] + values[sound[after]])
    return replace(stream, values=values)


def _between_neighbours(values: FloatArray) -> FloatArray:
    """Mean (n - 2, 3) of the neighbours of each sample but the first and the last."""
    return 0.5 * (values[:-2] + values[2:])


def describe_spikes(stream: SensorStream) -> list[str]:
    """Tell of the spikes of a stream of rates: how many, the first, the largest.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.

    Returns
    -------
    list of str
        One line, or none.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    spikes = rate_spikes(stream)
    if not spikes.any():
        return []
    rows = np.flatnonzero(spikes)
    away = stream.values[rows] - _between_neighbours(stream.values)[rows - 1]
    largest = np.degrees(np.linalg.norm(away, axis=1).max())
    found = f"{len(rows)} of {len(stream)} rates leap away and back within a sample"
    where = f"first at {stream.t_s[rows[0]]:.3f} s, by up to {largest:.3g}°/s"
    return [f"stream {stream.name!r}: {found}, {where}: the mean of their neighbours takes their place"]
