"""What an odometer shows by itself, and sensors without what was wrong of them, on the right mounting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Slip, Turn, without_slip
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


def corrected(
    sensor: MotionSensor, stretches: Sequence[Gap], slips: Mapping[str, Slip], turns: Mapping[str, FloatArray]
) -> MotionSensor | None:
    """A sensor without what was wrong of it; None if nothing is left.

    Parameters
    ----------
    sensor : MotionSensor
        As it was.
    stretches : sequence of Gap
        Where its samples are wrong.
    slips : mapping of str to Slip
        What odometers slip by, by name.
    turns : mapping of str to (3, 3) float64
        By what the mountings of odometers are to be turned, by name.

    Returns
    -------
    MotionSensor or None
    """
    sound = _without_stretches(_without_slip(sensor, slips.get(sensor.name)), stretches)
    return None if sound is None else _with_turned_mounting(sound, turns.get(sensor.name))


def _with_turned_mounting(sensor: MotionSensor, turn: FloatArray | None) -> MotionSensor:
    if turn is None or not isinstance(sensor, Odometer) or sensor.mounting is None:
        return sensor
    mounted = replace(sensor.mounting, camera_from_body=turn @ sensor.mounting.camera_from_body)
    return replace(sensor, mounting=mounted)


def _without_slip(sensor: MotionSensor, slip: Slip | None) -> MotionSensor:
    if slip is None or not isinstance(sensor, Odometer):
        return sensor
    return replace(sensor, stream=without_slip(sensor.stream, slip))


def _without_stretches(sensor: MotionSensor, stretches: Sequence[Gap]) -> MotionSensor | None:
    if not isinstance(sensor, STAMPED):
        return sensor
    rest: SensorStream | None = sensor.stream
    for stretch in stretches:
        rest = rest and rest.without(stretch)
    if rest is sensor.stream:
        return sensor
    return None if rest is None else replace(sensor, stream=rest)
