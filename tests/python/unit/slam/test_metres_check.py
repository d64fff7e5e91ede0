"""Metres in which a camera on wheels is as high as a house, or points are a hand away, are told."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gps, MotionSensor, Odometer, WorldMap
from sfmcpp.slam.metres_check import height_and_distance, warn_of_metres
from sfmcpp.slam.sensor_suite import SensorSuite
from winding import AT_CAMERA, sound_run, winding

# Points are up to 1.5 m below the camera, and up to 4 m above, evenly: a tenth of them below this [m].
LOWEST_TENTH_M = 1.5 - 0.1 * 5.5
UP = np.array([0.0, -1.0, 0.0])


@cache
def found() -> WorldMap:
    world = sound_run("odometer").world
    assert world is not None
    return world


def scaled(factor: float) -> WorldMap:
    world = deepcopy(found())
    world.transform(Similarity(factor, np.eye(3), np.zeros(3)))
    return world


def warnings(factor: float, *sensors: MotionSensor) -> list[str]:
    return warn_of_metres(scaled(factor), SensorSuite(sensors))


@pytest.mark.parametrize("factor", [1.0, 6.0])
def test_the_lowest_points_are_as_far_below_as_they_are(factor: float) -> None:
    measured = height_and_distance(scaled(factor), UP)
    assert measured is not None
    height_m, distance_m = measured
    assert height_m == pytest.approx(factor * LOWEST_TENTH_M, rel=0.3)
    # Beside the way by 3 to 12 m, and 5 to 25 m ahead of the first that sees them.
    assert 3 * factor < distance_m < 12 * factor


@pytest.mark.parametrize(
    "mounting", [None, AT_CAMERA, Mounting.forward_looking()], ids=["none", "camera", "forward"]
)
def test_only_metres_that_are_too_long_or_too_short_are_told(mounting: Mounting | None) -> None:
    odometer = Odometer(winding().odometer, mounting=mounting)
    assert [warnings(factor, odometer) for factor in (0.1, 1.0, 2.5)] == [[], [], []]
    (high,) = warnings(10.0, odometer)
    assert high.startswith("odometer: by its metres the camera is ")
    assert high.endswith(" m above the lowest points around it: are its speeds km/h, declared as m/s?")
    (near,) = warnings(1e-3, odometer)
    assert near.endswith("m away: are they metres, declared as millimetres?")


def test_cameras_of_other_sensors_may_fly() -> None:
    drive = winding()
    gps = Gps(SensorStream(np.arange(0.0, 10.0, 0.1), drive.truth[:, :, 3], "position"))
    assert warnings(10.0, Odometer(drive.odometer), gps) == []
    assert warnings(10.0) == []


def test_few_points_tell_nothing() -> None:
    world = deepcopy(found())
    world.points[np.flatnonzero(world.known)[99:]] = np.nan
    assert height_and_distance(world, UP) is None
