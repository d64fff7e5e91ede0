"""Sensors as they should have been: without what was wrong of them, and on a mounting that is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Turn
from sfmcpp.slam.motion_sensors import Gps, Gyroscope, Ins, MotionSensor, Odometer

# Those whose stream can be replaced.
STAMPED = (Odometer, Gyroscope, Gps, Ins)


def camera_steps(odometer: Odometer, turns: Sequence[Turn]) -> tuple[FloatArray, FloatArray]:
    """Steps (n, 3) of the camera by an odometer, and their directions by the images."""
    compared = [
        (odometer.measure(turn.start_s, turn.end_s, turn.rotation, turn.rotation), turn) for turn in turns
    ]
    known = [
        (np.asarray(measured.value)[:, 3], turn.direction)
        for measured, turn in compared
        if measured is not None and measured.kind == "displacement-pose" and not measured.doubtful
    ]
    steps, directions = np.array(known).reshape(-1, 2, 3).swapaxes(0, 1)
    return steps, directions


def with_turned_mounting(sensor: MotionSensor, turns: Mapping[str, FloatArray]) -> MotionSensor:
    """An odometer with a corrected rotation of its mounting."""
    turn = turns.get(sensor.name)
    if turn is None or not isinstance(sensor, Odometer) or sensor.mounting is None:
        return sensor
    mounted = replace(sensor.mounting, camera_from_body=turn @ sensor.mounting.camera_from_body)
    return replace(sensor, mounting=mounted)


def without_stretches(sensor: MotionSensor, stretches: Sequence[Gap]) -> MotionSensor | None:
    """A sensor without the samples of some stretches; None if nothing is left."""
    if not isinstance(sensor, STAMPED):
        return sensor
    rest: SensorStream | None = sensor.stream
    for stretch in stretches:
        rest = rest and rest.without(stretch)
    if rest is sensor.stream:
        return sensor
    return None if rest is None else replace(sensor, stream=rest)
