"""A check of gaps in what is seen: the map behind one hangs on what was assumed on the way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.scale_drift import stretches
from sfmcpp.slam.sensor_suite import SensorSuite

# A camera keeps its turn and its speed for so long that what comes after is hardly off [s].
_SHORT_S = 0.5
# How warnings of this check begin.
UNSEEN = "images do not tell how the camera moved at frames"


def warn_of_gaps(result: SlamResult, sensors: SensorSuite) -> list[str]:
    """A warning for each stretch of lost frames over which no sensor measures the turn or the way.

    Parameters
    ----------
    result : SlamResult
        Of a finished run.
    sensors : SensorSuite
        What measured the motion.

    Returns
    -------
    list of str
        Where positions or poses are measured on both sides of it, a gap is none.
    """
    return list(_warnings(result, sensors)) if result.world is not None else []


def _warnings(result: SlamResult, sensors: SensorSuite) -> Iterator[str]:
    times, lost = result.path.times, set(result.lost)
    frames = list(times)
    first = 0
    for place in range(1, len(frames)):
        if frames[place] in lost:
            continue
        start_s, end_s = times[frames[first]], times[frames[place]]
        if place > first + 1 and end_s - start_s > _SHORT_S:
            unseen = frames[first + 1 : place]
            yield from _of_gap(stretches(unseen, near=1)[0], start_s, end_s, result.metric, sensors)
        first = place


def _of_gap(named: str, start_s: float, end_s: float, metric: bool, sensors: SensorSuite) -> Iterator[str]:
    if metric and all(_is_placed(t_s, sensors) for t_s in (start_s, end_s)):
        return
    no_turn = sensors.rotation(start_s, end_s) is None
    no_way = not metric or sensors.distance(start_s, end_s) is None
    if no_turn or no_way:
        kept = " and ".join(["turn"] * no_turn + ["speed"] * no_way)
        untied = " and ".join(["pose" if no_turn else "place"] + ["scale"] * (not metric))
        yield (
            f"{UNSEEN} {named} ({end_s - start_s:.1f} s), and no sensor does: it is taken to have kept its "
            f"{kept}, and nothing else ties the {untied} of the map behind to the map before"
        )


def _is_placed(time_s: float, sensors: SensorSuite) -> bool:
    """Whether positions or poses are measured at a time [s]."""
    return sensors.pose(time_s) is not None or sensors.centre(time_s, np.eye(3)) is not None
