"""Metres that are hardly those of the world, at the end of a run: by right images, or by the points.

An odometer in km/h that says m/s scales a map as evenly as a right one, and inertia tells of it only where a
vehicle brakes or turns hard. But the lowest points about the way are those of the ground, and a camera on
wheels is a few metres above it at most; nor does it see points a hand away.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam.baseline_check import warn_of_baseline
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WorldMap

# Of the nearer half of the points the ground has the lowest tenth: so far below the camera are these on 0001,
# 0027, 0036, 0039 and simulated drives 1.4 to 1.8 m, where the camera is 1.65 m high.
_NEARER, _LOWEST, _FEWEST_POINTS = 0.5, 0.9, 100
# Cameras of trains and lorries are up to 4 m above the ground [m].
_HIGHEST_M = 4.5
# The usual distance of points is 7 to 16 m there; below this it is none of a camera on wheels [m].
_NEAREST_M = 0.2


def warn_of_metres(world: WorldMap | None, sensors: SensorSuite) -> list[str]:
    """Warn of metres that right images contradict, or in which points are too far below or too near.

    Parameters
    ----------
    world : WorldMap or None
        The map at the end of a run.
    sensors : SensorSuite
        What measured metres.

    Returns
    -------
    list of str
        A sentence for each sensor.
    """
    return warn_of_baseline(world, sensors) + _warn_of_unit(world, sensors)


def _warn_of_unit(world: WorldMap | None, sensors: SensorSuite) -> list[str]:
    """Of odometers alone: cameras of receivers and navigation units may fly."""
    odometers = sensors.of_type(Odometer)
    others = any(isinstance(sensor, Gps | Ins) for sensor in sensors.sensors)
    if world is None or not world.metric or world.stereo or others or not odometers:
        return []
    found = height_and_distance(world, _up_in_camera(odometers[0]))
    if found is None:
        return []
    told, (height_m, distance_m) = f"{odometers[0].name}: by its metres", found
    if height_m > _HIGHEST_M:
        high = f"{told} the camera is {height_m:.2g} m above the lowest points around it"
        return [f"{high}: are its speeds km/h, declared as m/s?"]
    if distance_m < _NEAREST_M:
        return [f"{told} points are {distance_m:.2g} m away: are they metres, declared as millimetres?"]
    return []


def height_and_distance(world: WorldMap, up: FloatArray) -> tuple[float, float] | None:
    """How far the lowest points near the way are below the camera, and how far points usually are from it.

    Parameters
    ----------
    world : WorldMap
        A map.
    up : (3,) float64
        Unit vector up, in the axes of the camera.

    Returns
    -------
    tuple of float or None
        Both in units of the map; None with fewer than a hundred points.
    """
    points, poses = world.points[world.known], world.poses
    if len(points) < _FEWEST_POINTS:
        return None
    from scipy.spatial import cKDTree  # loaded where it is used: see ARCHITECTURE.md

    away, found = cKDTree(poses[:, :, 3]).query(points)
    nearest = np.asarray(found, np.intp)
    near = away <= np.quantile(away, _NEARER)
    offsets = (points - poses[nearest, :, 3])[near]
    below = -np.einsum("nij,j,ni->n", poses[nearest[near], :, :3], up, offsets)
    return float(np.quantile(below, _LOWEST)), float(np.median(away))


def _up_in_camera(odometer: Odometer) -> FloatArray:
    """The body's z axis, or against the camera's y axis where the body has the axes of the camera."""
    mounting = odometer.mounting
    if mounting is None or np.array_equal(mounting.camera_from_body, np.eye(3)):
        return np.array([0.0, -1.0, 0.0])
    return np.asarray(mounting.camera_from_body[:, 2])
