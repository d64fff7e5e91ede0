"""Clocks that are not the camera's and gyroscopes with a bias, found out and set right as the run goes.

Half a second or a few degrees per second bend a map before the run is over, and no weight mends it: sometimes
the sensor is right, sometimes the images are.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from sfmcpp.geometry import relative_pose
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.sensors import Turn
from sfmcpp.slam.fusing import presumed_weights
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe

# Keyframes after which all frames are asked for clocks, and how many of them at most.
_EVERY, _LOOK_BACK = 8, 128
# Offsets that are tried [s].
_LARGEST_OFFSET_S = 1.0
# Less parallax does not tell a motion from a turn [px].
_LEAST_PARALLAX_PX = 0.3


def calibrate(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Set the clock of a gyroscope, and of all that shares its stamps, and its zero, once the images tell.

    What sensors have said of the keyframes so far they say again, with the weights of their declared σ.

    Parameters
    ----------
    result : SlamResult
        The run so far; its keyframes get new constraints, and `warnings` a sentence of a clock.
    sensors : SensorSuite
        Whose clocks and biases are corrected.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing.
    """
    world = result.world
    if world is None or not settings.trusts_declared:
        return
    changed = remove_biases(world.keyframes, world.intrinsics[0], sensors, settings)
    if not sensors.in_time:
        changed |= _set_clocks(result, sensors)
    if changed:
        _constrain_again(result, sensors)


def _set_clocks(result: SlamResult, sensors: SensorSuite) -> bool:
    """Whether a clock was set: by pairs of images, and now and then by all frames, which tell more."""
    world = result.world
    assert world is not None
    told = sensors.set_clocks(None, _LARGEST_OFFSET_S)
    if not told and not sensors.in_time and len(world.keyframes) % _EVERY == 0:
        first = world.keyframes[-1].frame - _LOOK_BACK
        told = sensors.set_clocks(result.seen_trajectory(first), _LARGEST_OFFSET_S)
    result.warnings += told
    return bool(told)


def remove_biases(
    images: Sequence[Frame | Keyframe], intrinsics: FloatArray, sensors: SensorSuite, settings: SlamSettings
) -> bool:
    """Take from rates what the images, those that were not asked before, say is no rotation.

    Parameters
    ----------
    images : sequence of Frame or Keyframe
        In the order of time.
    intrinsics : (5,) or (12,) float64
        Of the camera.
    sensors : SensorSuite
        Whose rates are corrected.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing.

    Returns
    -------
    bool
        Whether any rates have changed.
    """
    fresh = [image for image in images if image.t_s >= sensors.turns_until_s]
    if len(fresh) < 2 or not sensors.compares_pairs or not settings.trusts_declared:
        return False
    turns = [_seen_turn(before, after, intrinsics, settings) for before, after in pairwise(fresh)]
    return sensors.remove_biases([turn for turn in turns if turn is not None], fresh[-1].t_s)


def _seen_turn(
    before: Frame | Keyframe, after: Frame | Keyframe, intrinsics: FloatArray, settings: SlamSettings
) -> Turn | None:
    """What two images tell of the rotation between them; None where they tell none, or two."""
    in_before, in_after = common(before.view, after.view)
    found = relative_pose(
        before.view.pixels[in_before],
        after.view.pixels[in_after],
        intrinsics,
        min_parallax_px=_LEAST_PARALLAX_PX,
        max_iterations=1000,
        seed=settings.seed,
    )
    told = found.camera[:, :3], found.camera[:, 3]
    return Turn(before.t_s, after.t_s, *told) if found.success else None


def _constrain_again(result: SlamResult, sensors: SensorSuite) -> None:
    """What sensors have said of the keyframes so far they say again."""
    world = result.world
    assert world is not None
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=result.metric)
        keyframe.constraints = presumed_weights(world, keyframe, before, measured)
