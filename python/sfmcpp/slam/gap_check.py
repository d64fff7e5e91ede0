"""A check of gaps in what is seen: the map behind one hangs on what was assumed on the way."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

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

    A stretch up to the end of the run counts, too: its poses are a guess.

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
    seen = [place for place, frame in enumerate(frames) if frame not in lost]
    for before, behind in pairwise([*seen, len(frames)]):
        unseen, ends = frames[before + 1 : behind], behind == len(frames)
        start_s, end_s = times[frames[before]], times[frames[-1] if ends else frames[behind]]
        if not unseen or end_s - start_s <= _SHORT_S:
            continue
        kept, untied = _unmeasured(start_s, end_s, result.metric, sensors)
        if not kept:
            continue
        named = f"{UNSEEN} {stretches(unseen, near=1)[0]} ({end_s - start_s:.1f} s), and no sensor does"
        tied = "" if ends else f", and nothing else ties the {untied} of the map behind to the map before"
        yield f"{named}: it is taken to have kept its {kept}{tied}"


def _unmeasured(start_s: float, end_s: float, metric: bool, sensors: SensorSuite) -> tuple[str, str]:
    """What no sensor measures between two times, and what that leaves untied; empty if it is nothing."""
    if metric and all(_is_placed(t_s, sensors) for t_s in (start_s, end_s)):
        return "", ""
    no_turn = sensors.rotation(start_s, end_s) is None
    no_way = not metric or sensors.distance(start_s, end_s) is None
    kept = " and ".join(["turn"] * no_turn + ["speed"] * no_way)
    return kept, " and ".join(["pose" if no_turn else "place"] + ["scale"] * (not metric))


def _is_placed(time_s: float, sensors: SensorSuite) -> bool:
    """Whether positions or poses are measured at a time [s]."""
    return sensors.pose(time_s) is not None or sensors.centre(time_s, np.eye(3)) is not None
