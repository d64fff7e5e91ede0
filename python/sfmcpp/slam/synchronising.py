"""Clocks that are not the camera's, found out by a gyroscope's rotations and set right as the run goes.

Half a second bends a map by degrees before the run is over, and no weight mends it: sometimes the sensor is
right, sometimes the images are.
"""

from __future__ import annotations

from itertools import pairwise

from sfmcpp.slam.fusing import presumed_weights
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings

# Keyframes after which clocks are looked at again, and frames that are looked back on at most.
_EVERY, _LOOK_BACK = 8, 128
# Offsets that are tried [s].
_LARGEST_OFFSET_S = 1.0


def synchronise(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Set the clock of a gyroscope, and of all that shares its stamps, once the images tell it.

    What the sensors have said of the keyframes so far they say again, with the weights of their declared σ.

    Parameters
    ----------
    result : SlamResult
        The run so far; its keyframes get new constraints, and `warnings` a sentence.
    sensors : SensorSuite
        Whose clocks are set.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing.
    """
    world = result.world
    if world is None or sensors.in_time or not settings.trusts_declared or len(world.keyframes) % _EVERY:
        return
    first = world.keyframes[-1].frame - _LOOK_BACK
    told = sensors.set_clocks(result.seen_trajectory(first), _LARGEST_OFFSET_S)
    if not told:
        return
    result.warnings += told
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=result.metric)
        keyframe.constraints = presumed_weights(world, keyframe, before, measured)
