"""Gaps of a few seconds in speeds, bridged by inertia: a body hardly changes its acceleration meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.sensors.stream import interpolate_vectors, require_kind

# Over longer gaps [s] images hold the scale as well: on KITTI's 0001, 0027, 0036 and 0039 ways over gaps of
# 2 s are off by 0.1 to 0.3 m (root mean square), of 5 s by 0.8 to 2.3 m.
LONGEST_BRIDGED_S = 5.0


@checked()
def bridgeable_gaps(stream: SensorStream) -> tuple[Gap, ...]:
    """Gaps of a stream of speeds or velocities that inertia bridges; none of other kinds.

    Parameters
    ----------
    stream : SensorStream
        Of any kind.

    Returns
    -------
    tuple of Gap
        Those of at most five seconds, in order.
    """
    if stream.kind not in ("speed", "velocity"):
        return ()
    return tuple(gap for gap in stream.gaps() if gap.end_s - gap.start_s <= LONGEST_BRIDGED_S)


@checked()
def with_gaps_bridged(stream: SensorStream, gaps: Sequence[Gap]) -> SensorStream:
    """The stream with samples in gaps, which go evenly from the last value before each to the first after it.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"`` or ``"velocity"``.
    gaps : sequence of Gap
        Some of its gaps.

    Returns
    -------
    SensorStream
        With as many more samples as its period asks for.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "speed", "velocity")
    if not gaps:
        return stream
    added = [_stamps_within(gap, stream.period_s) for gap in gaps]
    t_s = np.sort(np.concatenate([stream.t_s, *added]))
    return replace(stream, t_s=t_s, values=interpolate_vectors(stream.t_s, stream.values, t_s))


def _stamps_within(gap: Gap, period_s: float) -> np.ndarray:
    steps = int(np.ceil((gap.end_s - gap.start_s) / period_s))
    return np.linspace(gap.start_s, gap.end_s, steps + 1)[1:-1]
