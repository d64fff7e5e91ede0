"""Registration of the map in the sensors' world: metric scale, frame of positions (thesis §5.3.3)."""

from __future__ import annotations

import math
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
from sfmcpp.slam.measurement import METRIC_KINDS
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.stereo import metres_per_unit
from sfmcpp.slam.world_map import Keyframe, WorldMap

# Largest relative standard deviation of the scale of a registration by positions or poses: on a shorter path
# noise would stretch the map.
_RELATIVE_SIGMA = 0.03
# At the end of a run fewer keyframes than the setting asks for will do, but not fewer than these.
_FEWEST_AT_END = 4
# The map has drifted from a sensor if its last keyframes are farther from it than by noise, and a fit leaves
# less than this share of that. Within the noise, a similarity fits the few positions of a second too well: of
# a GPS once a second it scaled maps that were right to half a metre by 0.8 to 1.1.
_DRIFT_RATIO = 0.5
# Steps farther than this share of their mean from the measured ones, root mean square, tell no scale: it has
# changed between them.
_LARGEST_SCATTER = 0.5
# Such a fit uses at most so many keyframes.
_LOOK_BACK = 80
# Rounds: with a lever arm, the centre of the camera depends on the rotation, and this on the centres.
_ROUNDS = 3
# In the sensors' world.
UP = np.array([0.0, 0.0, 1.0])


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
    measured = _num_measured(world.keyframes, sensors)
    for count in range(min(settings.registration_keyframes, measured), _FEWEST_AT_END - 1, -1):
        place_in_world(result, sensors, replace(settings, registration_keyframes=count))
        if result.metric:
            return []
    names = " and ".join(sensor.name for sensor in asked)
    if measured < _FEWEST_AT_END:
        return [
            f"{names}: tells of {measured} of the map's {len(world.keyframes)} keyframes: must be "
            f"{_FEWEST_AT_END} or more to scale it to metres"
        ]
    return [
        f"{names}: measures too little motion, or another than the images, to scale the map to metres: check "
        "clock, mounting, unit and noise"
    ]


def _num_measured(keyframes: Sequence[Keyframe], sensors: SensorSuite) -> int:
    """Number of keyframes whose place is measured, or that measured distances link."""
    absolute = [s for s in sensors.sensors if isinstance(s, Gps | Ins)]
    places = max((len(_measured_apart(keyframes, sensor)) for sensor in absolute), default=0)
    known = sum(distance is not None for distance in _distances_between(keyframes, sensors))
    return max(places, known + (known > 0))


def _measured_apart(keyframes: Sequence[Keyframe], sensor: Gps | Ins) -> list[Keyframe]:
    """Keyframes whose places are measured, not extrapolated, by fixes of their own.

    Of those between the same two the first: what is interpolated for the others has the same errors.
    """
    t_s = sensor.believed.t_s
    within = [keyframe for keyframe in keyframes if t_s[0] <= keyframe.t_s <= t_s[-1]]
    _, first = np.unique(np.searchsorted(t_s, [keyframe.t_s for keyframe in within]), return_index=True)
    return [within[k] for k in first]


def _distances_between(keyframes: Sequence[Keyframe], sensors: SensorSuite) -> list[float | None]:
    """Distance by the sensors from each keyframe to the next [m]; None where none measures it."""
    return [sensors.distance(a.t_s, b.t_s, a.pose[:, :3].T @ b.pose[:, :3]) for a, b in pairwise(keyframes)]


def _correct_drift(result: SlamResult, world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> None:
    found = correction(world, sensors, settings)
    if found is None:
        return
    world.move_recent(found.first, found.similarity)
    result.path.transform(found.similarity, world.keyframes[found.first].frame)
    result.corrections.append(world.keyframes[-1].frame)


def registration(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> Similarity | None:
    """Find what brings the map into the sensors' world, world_from_map.

    Poses decide, else positions, else right images, else distances: a map that is in metres already could not
    be brought into the frame of positions later.

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
        None as long as there are too few keyframes, or they do not determine it.
    """
    method = _registration_method(sensors, _METHODS)
    scale = metres_per_unit(world) if method in (None, _scale_by_distances) else None
    if scale is not None:
        return Similarity(scale, np.eye(3), np.zeros(3))
    found = _fit_by_method(method, world.keyframes, sensors, settings.registration_keyframes)
    return None if found is None else found.similarity


def constrain_past(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> None:
    """Constrain the keyframes so far of a map that has just become metric by the sensors that measure metres.

    Nothing is done unless the settings trust declared σ.
    """
    if not settings.trusts_declared:
        return
    for before, keyframe in pairwise(world.keyframes):
        measured = sensors.since(before, keyframe.t_s, keyframe.pose, metric=True)
        in_metres = [m for m in measured if m.kind in METRIC_KINDS]
        keyframe.constraints += presumed_weights(world, keyframe, before, in_metres)


@dataclass(frozen=True, eq=False)
class Correction:
    """How a map that has drifted is corrected: the keyframes from `first` on move by `similarity`."""

    first: int
    similarity: Similarity


def correction(world: WorldMap, sensors: SensorSuite, settings: SlamSettings) -> Correction | None:
    """Find how the last keyframes must move if they have drifted off poses, positions or distances together.

    Images tie a keyframe to the map, and cross-validation by these images favours the map: an absolute sensor
    would never get a weight against a map that has drifted as a whole.

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
        None if no sensor determines it, the last keyframes have not drifted, or the settings rule it out.
    """
    if not settings.correct_drift or settings.weights == "none":
        return None
    method = _registration_method(sensors, _METHODS if settings.correct_scale else _ABSOLUTE)
    start = max(world.part_start, len(world.keyframes) - _LOOK_BACK)
    fewest = settings.registration_keyframes
    for first in range(len(world.keyframes) - fewest, start - 1, -fewest):
        found = _fit_by_method(method, world.keyframes[first:], sensors, fewest)
        if found is not None:
            return Correction(first, found.similarity) if found.drifted else None
    return None


# Fits keyframes to what a sensor measured of them; None with fewer keyframes than the number given.
_FitMethod = Callable[[Sequence[Keyframe], SensorSuite, int], "_Fit | None"]


@dataclass(frozen=True, eq=False)
class _Fit:
    """A similarity world_from_map, the root mean squares before and after it, and that of noise alone [m]."""

    similarity: Similarity
    before_m: float
    after_m: float
    noise_m: float

    @property
    def drifted(self) -> bool:
        return self.before_m > self.noise_m and self.after_m < _DRIFT_RATIO * self.before_m


def _registration_method(sensors: SensorSuite, methods: Mapping[type, _FitMethod]) -> _FitMethod | None:
    """The first of the methods for which there is a sensor."""
    kinds = {type(sensor) for sensor in sensors.sensors}
    return next((method for kind, method in methods.items() if kind in kinds), None)


def _fit_by_method(
    method: _FitMethod | None, keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int
) -> _Fit | None:
    try:
        return None if method is None else method(keyframes, sensors, fewest)
    except InvalidArgument:
        return None


def _fit(registered: Registration, before_m: FloatArray, noise_m: float) -> _Fit:
    """Fit of a registration; `before_m` (n,) are the residuals before it, of positions or of steps."""
    return _Fit(registered.similarity, float(np.sqrt(np.mean(before_m**2))), registered.rmse_m, noise_m)


def _noise_m(sigma_m: float | None) -> float:
    """Distance of a place from a measured one by noise of a σ along each axis, root mean square [m]."""
    return math.sqrt(3) * (sigma_m or 0.0)


def _fit_by_poses(keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int) -> _Fit | None:
    pairs = [(k.pose, pose) for k in keyframes if (pose := sensors.pose(k.t_s)) is not None]
    if len(pairs) < fewest:
        return None
    seen, measured = (np.stack(poses) for poses in zip(*pairs, strict=True))
    registered = register_by_poses(seen, measured, len(pairs))
    if registered.relative_sigma > _RELATIVE_SIGMA:
        return None
    before_m = np.linalg.norm(seen[:, :, 3] - measured[:, :, 3], axis=1)
    return _fit(registered, before_m, _noise_m(sensors.of_type(Ins)[0].sigma_m))


def _fit_by_positions(keyframes: Sequence[Keyframe], sensors: SensorSuite, fewest: int) -> _Fit | None:
    """Fit to positions; on a straight path the camera is taken to be upright."""
    gps = sensors.of_type(Gps)[0]
    rotation = np.eye(3)
    told = _measured_apart(keyframes, gps)
    for _ in range(_ROUNDS):
        at = [(k.pose, gps.at(k.t_s, rotation @ k.pose[:, :3])) for k in told]
        pairs = [(seen, centre) for seen, centre in at if centre is not None]
        if len(pairs) < fewest:
            return None
        seen, centres = (np.stack(part) for part in zip(*pairs, strict=True))
        registered = register_by_positions(seen, centres, len(pairs), up=UP, up_in_camera=gps.up_in_camera)
        if registered.relative_sigma > _RELATIVE_SIGMA:
            return None
        rotation = registered.similarity.rotation
    before_m = np.linalg.norm(seen[:, :, 3] - centres, axis=1)
    return _fit(registered, before_m, _noise_m(gps.likely_sigma_m))


def _scale_by_distances(keyframes: Sequence[Keyframe], sensors: SensorSuite, count: int) -> _Fit | None:
    """Ratio of the mean steps (eq. 5.19) of the last keyframes in a row, whose distances must be known."""
    last = keyframes[-count:]
    found = _distances_between(last, sensors)
    distances = np.array([d for d in found if d is not None])
    if len(last) < count or len(distances) < len(found):
        return None
    sigma_m = max(odometer.sigma_m or 0.0 for odometer in sensors.of_type(Odometer))
    if not distances.sum() > sigma_m * np.sqrt(len(distances)) / LARGEST_RELATIVE_SIGMA:
        return None
    poses = np.stack([k.pose for k in last])
    registered = register_by_distances(poses, distances, count)
    if registered.rmse_m > _LARGEST_SCATTER * distances.mean():
        return None
    return _fit(registered, np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1) - distances, 0.0)


# The best first.
_ABSOLUTE: dict[type, _FitMethod] = {Ins: _fit_by_poses, Gps: _fit_by_positions}
_METHODS = {**_ABSOLUTE, Odometer: _scale_by_distances}
