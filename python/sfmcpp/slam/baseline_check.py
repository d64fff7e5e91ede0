"""A baseline that odometers or positions contradict, at the end of a run with right images.

Where one of them is off by a constant factor, no step looks wrong: the map follows one of them, or both by
halves. Over a run their metres differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import register_by_positions
from sfmcpp.sensors.odometer import LEAST_STEP_M
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.registration import UP
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.stereo import metres_by_right_images
from sfmcpp.slam.world_map import WorldMap

# Metres that differ by no more are the same. On KITTI's drives those of speeds and of right images differ by
# 0.016 at most; with a baseline that is wrong by a tenth by 0.03 to 0.08, as the map gives way to both.
_SAME = 0.03
# Fewer steps tell no factor; nor do positions that leave the scale open by more.
_FEWEST_STEPS, _OPEN_SCALE = 10, 0.01


def warn_of_baseline(world: WorldMap | None, sensors: SensorSuite) -> list[str]:
    """Warn of sensors whose metres are others than those of right images.

    Parameters
    ----------
    world : WorldMap or None
        The map at the end of a run.
    sensors : SensorSuite
        What measured metres beside them.

    Returns
    -------
    list of str
        A sentence for each such sensor.
    """
    by_images = None if world is None or not world.stereo else metres_by_right_images(world)
    if world is None or by_images is None or world.right_centre_m is None:
        return []
    baseline_m = float(np.linalg.norm(world.right_centre_m))
    ratios = {name: metres / by_images for name, metres in _metres_of(world, sensors)}
    return [
        f"{name}: its metres are {ratio:.3g} of those of the right images: the baseline of {baseline_m:.3g} "
        "m is wrong, or the scale or unit of the sensor"
        for name, ratio in ratios.items()
        if abs(ratio - 1) > _SAME
    ]


def _metres_of(world: WorldMap, sensors: SensorSuite) -> Iterator[tuple[str, float]]:
    """Length of the unit of the map [m] by each sensor that tells it."""
    for sensor in sensors.sensors:
        metres = None
        if isinstance(sensor, Odometer):
            metres = _by_distances(world, sensor)
        elif isinstance(sensor, Gps | Ins):
            metres = _by_places(world, sensor)
        if metres is not None:
            yield sensor.name, metres


def _by_distances(world: WorldMap, odometer: Odometer) -> float | None:
    """The median over the steps from keyframe to keyframe: a slip of some does not count."""
    ratios = []
    for before, after in pairwise(world.keyframes):
        start, end = before.pose, after.pose
        told = odometer.between(before.t_s, after.t_s, start[:, :3].T @ end[:, :3])
        step = float(np.linalg.norm(end[:, 3] - start[:, 3]))
        if told is not None and min(told, step) > LEAST_STEP_M:
            ratios.append(told / step)
    return float(np.median(ratios)) if len(ratios) >= _FEWEST_STEPS else None


def _by_places(world: WorldMap, sensor: Gps | Ins) -> float | None:
    """The scale of the similarity between the keyframes and where the sensor has them."""
    pairs = [(keyframe.pose, _place(sensor, keyframe.t_s, keyframe.pose)) for keyframe in world.keyframes]
    known = [(pose, place) for pose, place in pairs if place is not None]
    if len(known) < _FEWEST_STEPS:
        return None
    poses, places = (np.array(values) for values in zip(*known, strict=True))
    try:
        found = register_by_positions(poses, places, len(places), UP)
    except InvalidArgument:
        return None
    return found.similarity.scale if found.relative_sigma <= _OPEN_SCALE else None


def _place(sensor: Gps | Ins, t_s: float, pose: FloatArray) -> FloatArray | None:
    if isinstance(sensor, Gps):
        return sensor.at(t_s, pose[:, :3])
    found = sensor.at(t_s)
    return None if found is None else found[:, 3]
