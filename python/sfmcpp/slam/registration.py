"""Registration of the map in the sensors' world: metric scale, frame of positions (thesis §5.3.3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Registration, register_by_distances, register_by_poses, register_by_positions
from sfmcpp.sensors.registration import LARGEST_RELATIVE_SIGMA
from sfmcpp.slam.fusion import presumed_weights
from sfmcpp.slam.motion_sensors import METRIC_KINDS, Gps, Gyroscope, Ins, Odometer
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.stereo import metres_per_unit
from sfmcpp.slam.world_map import Keyframe, WorldMap

# What the scale may be off before positions count: with less of a way the map would be stretched by noise.
_RELATIVE_SIGMA = 0.03
# Fewer keyframes than a setting asks for will do at the end of a run, but not fewer than these.
_FEWEST_AT_END = 4
# A map has drifted from the sensor when a fit of its last keyframes leaves this part of their distance to it.
_DRIFT_RATIO = 0.5
# Most keyframes that such a fit looks back on.
_LOOK_BACK = 80
# With a lever arm the rotation is needed to tell where the camera is, and the other way round.
_ROUNDS = 3
# In the sensors' world.
_UP = np.array([0.0, 0.0, 1.0])


def place_in_world(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Bring the map into the sensors' world (thesis §5.3.3), or back to it where it has drifted from it.

    Parameters
    ----------
    result : SlamResult
        The run so far; its map, and the frames between keyframes, move.
    sensors : SensorSuite
        What tells where it is.
    settings : SlamSettings
        How many keyframes it takes, and whether drift is corrected.
    """
    world = result.world
    assert world is not None
    if result.metric:
        _correct_drift(result, world, sensors, settings)
        return
    similarity = registration(world, sensors, settings)
    if similarity is None:
        return
    world.transform(similarity)
    result.path.transform(similarity)
    constrain_past(world, sensors, settings)
    world.metric = result.metric = True


def place_at_end(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> list[str]:
    """Bring the map of a finished run into the sensors' world, by the few keyframes that there are.

    Parameters
    ----------
    result : SlamResult
        The run; its map, and the frames between keyframes, move.
    sensors : SensorSuite
        What tells where it is.
    settings : SlamSettings
        How many keyframes it took on the way.

    Returns
    -------
    list of str
        Why the map has no metres, a sentence; empty if it has, or no sensor is in metres.
    """
    world = result.world
    asked = [sensor for sensor in sensors.sensors if not isinstance(sensor, Gyroscope)]
    if world is None or result.metric or not asked:
        return []
    told = _told(world.keyframes, sensors)
    for count in range(min(settings.registration_keyframes, told), _FEWEST_AT_END - 1, -1):
        place_in_world(result, sensors, replace(settings, registration_keyframes=count))
        if result.metric:
            return []
    names = " and ".join(sensor.name for sensor in asked)
    if told < _FEWEST_AT_END:
        return [
            f"{names}: tells of {told} of the map's {len(world.keyframes)} keyframes: must be "
            f"{_FEWEST_AT_END} or more to scale it to metres"
        ]
    return [
        f"{names}: measures too little motion, or another than the images, to scale the map to metres: check "
        "clock, mounting, unit and noise"
    ]


def _told(keyframes: Sequence[Keyframe], sensors: SensorSuite) -> int:
    """Keyframes of which a sensor measures, not predicts, the place, or the distance from one that counts."""
    spans = [s.believed.t_s[[0, -1]] for s in sensors.sensors if isinstance(s, Gps | Ins)]
    places = sum(any(first <= k.t_s <= last for first, last in spans) for k in keyframes)
    steps = [sensors.distance(a.t_s, b.t_s, a.pose[:, :3].T @ b.pose[:, :3]) for a, b in pairwise(keyframes)]
    known = sum(step is not None for step in steps)
    return max(places, known + (known > 0))


def _correct_drift(result: SlamResult, world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> None:
    found = correction(world, sensors, settings)
    if found is None:
        return
    world.move_recent(found.first, found.similarity)
    result.path.transform(found.similarity, world.keyframes[found.first].frame)
    result.corrections.append(world.keyframes[-1].frame)


def registration(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> Similarity | None:
    """Find what brings the map into the sensors' world, world_from_map.

    Poses decide, else positions, else right images, else distances: a map in metres alone could not take
    positions later.

    Parameters
    ----------
    world : WorldMap
        The map so far, in a frame and a unit of its own.
    sensors : SensorSuite
        The sensors.
    settings : SlamSettings
        How many keyframes it takes.

    Returns
    -------
    Similarity or None
        None as long as there are too few keyframes, or they do not tell it.
    """
    way = _registration_method(sensors, _WAYS)
    scale = metres_per_unit(world) if way in (None, _scale_by_distances) else None
    if scale is not None:
        return Similarity(scale, np.eye(3), np.zeros(3))
    found = _fit_by_method(way, world.keyframes, sensors, settings.registration_keyframes)
    return None if found is None else found.similarity


def constrain_past(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Let sensors in metres constrain the keyframes of a map that has just come into metres, too.

    Only where what they declare counts: not beside constant weights, nor without bounds.
    """
    if not settings.trusts_declared:
        return
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=True)
        in_metres = [m for m in measured if m.kind in METRIC_KINDS]
        keyframe.constraints += presumed_weights(world, keyframe, before, in_metres)


@dataclass(frozen=True, eq=False)
class Correction:
    """What brings a map that has drifted back: the keyframes from `first` on, and how they move."""

    first: int
    similarity: Similarity


def correction(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> Correction | None:
    """Find how the last keyframes move where poses, positions or distances say that the map has drifted.

    Images hold a keyframe to the map, and cross-validation by these images takes the side of the map: what an
    absolute sensor says against a map that has drifted as a whole would never get a weight.

    Parameters
    ----------
    world : WorldMap
        The map, registered before.
    sensors : SensorSuite
        The sensors.
    settings : SlamSettings
        How many keyframes it takes.

    Returns
    -------
    Correction or None
        None if no sensor tells, the last keyframes are as near to it as they can be, or nobody asks for it.
    """
    if not settings.correct_drift or settings.weights == "none":
        return None
    way = _registration_method(sensors, _WAYS if settings.correct_scale else _ABSOLUTE)
    start = max(world.part_start, len(world.keyframes) - _LOOK_BACK)
    fewest = settings.registration_keyframes
    for first in range(len(world.keyframes) - fewest, start - 1, -fewest):
        found = _fit_by_method(way, world.keyframes[first:], sensors, fewest)
        if found is not None:
            return Correction(first, found.similarity) if found.drifted else None
    return None


# Poses of the map and what a sensor says of them, from the keyframes it covers and the rotation so far.
_Way = Callable[[Sequence[Keyframe], SensorSuite, int], "_Fit | None"]


@dataclass(frozen=True, eq=False)
class _Fit:
    """A similarity world_from_map, and the root mean squares before and after it [m]."""

    similarity: Similarity
    before_m: float
    after_m: float

    @property
    def drifted(self) -> bool:
        return self.after_m < _DRIFT_RATIO * self.before_m


def _registration_method(sensors: SensorSuite, ways: Mapping[type, _Way]) -> _Way | None:
    """The first of the ways that a sensor gives."""
    kinds = {type(sensor) for sensor in sensors.sensors}
    return next((way for kind, way in ways.items() if kind in kinds), None)


def _fit_by_method(
    way: _Way | None, keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int
) -> _Fit | None:
    try:
        return None if way is None else way(keyframes, sensors, fewest)
    except InvalidArgument:
        return None


def _fit(registered: Registration, before_m: FloatArray) -> _Fit:
    """Make it of a registration and the residuals (n,) before it, positions or steps as its own."""
    return _Fit(registered.similarity, float(np.sqrt(np.mean(before_m**2))), registered.rmse_m)


def _fit_by_poses(keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int) -> _Fit | None:
    pairs = [(k.pose, pose) for k in keyframes if (pose := sensors.pose(k.t_s)) is not None]
    if len(pairs) < fewest:
        return None
    seen, measured = (np.stack(poses) for poses in zip(*pairs, strict=True))
    registered = register_by_poses(seen, measured, len(pairs))
    if registered.relative_sigma > _RELATIVE_SIGMA:
        return None
    return _fit(registered, np.linalg.norm(seen[:, :, 3] - measured[:, :, 3], axis=1))


def _fit_by_positions(keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int) -> _Fit | None:
    """Fit to positions; on a straight way the camera is taken to be upright."""
    gps = sensors.of_type(Gps)[0]
    rotation = np.eye(3)
    for _ in range(_ROUNDS):
        at = [(k.pose, gps.at(k.t_s, rotation @ k.pose[:, :3])) for k in keyframes]
        pairs = [(seen, centre) for seen, centre in at if centre is not None]
        if len(pairs) < fewest:
            return None
        seen, centres = (np.stack(part) for part in zip(*pairs, strict=True))
        registered = register_by_positions(seen, centres, len(pairs), up=_UP, up_in_camera=gps.up_in_camera)
        if registered.relative_sigma > _RELATIVE_SIGMA:
            return None
        rotation = registered.similarity.rotation
    return _fit(registered, np.linalg.norm(seen[:, :, 3] - centres, axis=1))


def _scale_by_distances(keyframes: Sequence[Keyframe], sensors: SensorSuite, count: int) -> _Fit | None:
    """Ratio of the mean steps (eq. 5.19) of the last keyframes in a row, whose distances must be known."""
    last = keyframes[-count:]
    found = [sensors.distance(a.t_s, b.t_s, a.pose[:, :3].T @ b.pose[:, :3]) for a, b in pairwise(last)]
    distances = np.array([d for d in found if d is not None])
    if len(last) < count or len(distances) < len(found):
        return None
    sigma_m = max(odometer.sigma_m or 0.0 for odometer in sensors.of_type(Odometer))
    if not distances.sum() > sigma_m * np.sqrt(len(distances)) / LARGEST_RELATIVE_SIGMA:
        return None
    poses = np.stack([k.pose for k in last])
    registered = register_by_distances(poses, distances, count)
    return _fit(registered, np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1) - distances)


# The best first.
_ABSOLUTE: dict[type, _Way] = {Ins: _fit_by_poses, Gps: _fit_by_positions}
_WAYS = {**_ABSOLUTE, Odometer: _scale_by_distances}
