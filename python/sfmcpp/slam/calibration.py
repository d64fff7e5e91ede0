"""Clocks and biases of gyroscopes, estimated from the rotations of images and corrected during a run.

A clock that is off by half a second, or a bias of a few degrees per second, bends a map before the run is
over, and no weight prevents it: by their rotations alone either the sensor or the images may be right.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, takewhile

from sfmcpp.geometry import relative_pose
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.sensors import Turn
from sfmcpp.slam.fusion import presumed_weights
from sfmcpp.slam.localisation import LEAST_PARALLAX_PX, RANSAC_ITERATIONS
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe

# Every so many keyframes a clock is also estimated from the poses of so many frames, the latest: each time
# these are compared at some 200 offsets.
_EVERY, _LOOK_BACK = 8, 128


def calibrate(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Correct the clocks and biases of gyroscopes as soon as images determine them.

    After a correction all sensors measure the keyframes so far again; these constraints have the weights of
    their declared σ.

    Parameters
    ----------
    result : SlamResult
        The run so far; its keyframes get the new constraints, and `warnings` a sentence for each clock.
    sensors : SensorSuite
        Whose clocks and biases are corrected.
    settings : SlamSettings
        Nothing is done unless `trusts_declared`.
    """
    world = result.world
    if world is None or not settings.trusts_declared:
        return
    has_changed = remove_biases(world.keyframes, world.intrinsics[0], sensors, settings)
    if not sensors.in_time:
        has_changed |= _set_clocks(result, sensors)
    if has_changed:
        _renew_constraints(result, sensors)


def calibrate_at_rest(
    result: SlamResult, frame: Frame | None, sensors: SensorSuite, settings: SlamSettings
) -> None:
    """Correct the biases of gyroscopes where the camera stands still until the next `frame`, or the end.

    As :func:`calibrate`; before there is a map, too: most drives begin with a vehicle that stands.
    """
    if settings.trusts_declared and sensors.rests_before(frame) and result.world is not None:
        _renew_constraints(result, sensors)


def _set_clocks(result: SlamResult, sensors: SensorSuite) -> bool:
    """Set clocks by pairs of images, and every few keyframes by the latest frames; whether any was off."""
    world = result.world
    assert world is not None
    warnings = sensors.set_clocks()
    if not warnings and not sensors.in_time and len(world.keyframes) % _EVERY == 0:
        first = world.keyframes[-1].frame - _LOOK_BACK
        warnings = sensors.set_clocks(result.seen_trajectory(first))
    result.warnings += warnings
    return bool(warnings)


def remove_biases(
    images: Sequence[Frame | Keyframe], intrinsics: FloatArray, sensors: SensorSuite, settings: SlamSettings
) -> bool:
    """Estimate the biases of gyroscopes by the images that came since the last call, and subtract them.

    Parameters
    ----------
    images : sequence of Frame or Keyframe
        In the order of time.
    intrinsics : (5,) or (12,) float64
        Of the camera.
    sensors : SensorSuite
        Whose rates are corrected.
    settings : SlamSettings
        Nothing is done unless `trusts_declared`.

    Returns
    -------
    bool
        Whether any rates have changed.
    """
    fresh = list(takewhile(lambda image: image.t_s >= sensors.turns_until_s, reversed(images)))[::-1]
    if len(fresh) < 2 or not sensors.compares_pairs or not settings.trusts_declared:
        return False
    turns = [
        _rotation_between_images(before, after, intrinsics, settings) for before, after in pairwise(fresh)
    ]
    return sensors.remove_biases([turn for turn in turns if turn is not None], fresh[-1].t_s)


def _rotation_between_images(
    before: Frame | Keyframe, after: Frame | Keyframe, intrinsics: FloatArray, settings: SlamSettings
) -> Turn | None:
    """Motion from one image to the next; None where it is undetermined or ambiguous."""
    in_before, in_after = common(before.view, after.view)
    found = relative_pose(
        before.view.pixels[in_before],
        after.view.pixels[in_after],
        intrinsics,
        min_parallax_px=LEAST_PARALLAX_PX,
        max_iterations=RANSAC_ITERATIONS,
        seed=settings.seed,
    )
    motion = found.camera[:, :3], found.camera[:, 3]
    if not found.success:
        return None
    return Turn(before.t_s, after.t_s, *motion, parallax_px=found.lower_parallax_px)


def _renew_constraints(result: SlamResult, sensors: SensorSuite) -> None:
    """Measure all constraints of the keyframes again, with the corrected sensors."""
    world = result.world
    assert world is not None
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=result.metric)
        keyframe.constraints = presumed_weights(world, keyframe, before, measured)
