"""What an odometer shows by itself, and sensors without what was wrong of them, on the right mounting."""

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
# Jumps of a speed that are told one by one.
_MOST_TOLD = 3


def speed_jumps(odometer: Odometer) -> list[str]:
    """A sentence for each stretch, one for all where there are many."""
    stretches = odometer.doubtful_stretches
    told = f"stream {odometer.stream.name!r}: the speed jumps by more than a vehicle can; "
    if len(stretches) > _MOST_TOLD:
        rule = "they are bridged by inertia or get no weight"
        return [f"{told}in {len(stretches)} stretches, first {stretches[0]}, {rule}"]
    return [
        f"{told}{gap} it {'is bridged by inertia' if gap in odometer.carried_stretches else 'gets no weight'}"
        for gap in stretches
    ]


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
