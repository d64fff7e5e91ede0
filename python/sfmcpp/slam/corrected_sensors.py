"""The sensors for a second run: without the faults that the first one found, on the right mounting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import RateAxes, Slip, with_axes, without_slip
from sfmcpp.sensors.rate_drift import RateDrift, without_drift
from sfmcpp.slam.measurement import MotionSensor
from sfmcpp.slam.motion_sensors import STAMPED, Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.sensor_faults import dead_odometers, misaligned_odometers, misread_gyroscopes
from sfmcpp.slam.sensor_suite import SensorSuite


def corrected_in_hindsight(sensors: SensorSuite) -> tuple[MotionSensor, ...] | None:
    """The sensors as they should have been from the start.

    They are on the camera's clock and mounting, in the axes and the unit that images show, without biases,
    drifts and slips, and without what a sensor of motion measured while the images contradicted it: not at
    once where a mounting or axes were wrong, as conflicts may come from that. Positions and poses keep all
    samples: a map drifts off them by itself, and would not return without them.

    Parameters
    ----------
    sensors : SensorSuite
        Those of a finished run, which do not change.

    Returns
    -------
    tuple of MotionSensor or None
        None where the run found nothing wrong.
    """
    turns, misread = misaligned_odometers(sensors), misread_gyroscopes(sensors)
    # A dead, slipping or misaligned odometer bends the map, and so do rates in wrong axes, or with a bias
    # that changes: conflicts then say nothing against sensors.
    is_bent = turns or misread or sensors.slips or sensors.drifts
    wrong = dead_odometers(sensors, sensors.turns) or ({} if is_bent else _denied_stretches(sensors))
    late = {*sensors.moved_s, *sensors.biases.late, *sensors.drifts, *sensors.slips}
    if not {*wrong, *turns, *misread, *late}:
        return None
    kept = []
    # Clocks and biases that rates in wrong axes have told are none.
    for given in sensors.given if misread else sensors.sensors:
        name = given.name
        sensor = _read_rightly(given, misread.get(name))
        even = _without_drift(_without_slip(sensor, sensors.slips.get(name)), sensors.drifts.get(name))
        sound = _without_stretches(even, wrong.get(name, ()))
        if sound is not None:
            kept.append(_with_turned_mounting(sound, turns.get(name)))
    return tuple(kept)


def _denied_stretches(sensors: SensorSuite) -> dict[str, tuple[Gap, ...]]:
    """Where the images contradict sensors of motion, by name."""
    of_motion = [sensor.name for sensor in sensors.sensors if not isinstance(sensor, Gps | Ins)]
    return {
        name: (stretch,)
        for name, known in sensors.experience.items()
        if name in of_motion and (stretch := known.denied)
    }


def _with_turned_mounting(sensor: MotionSensor, turn: FloatArray | None) -> MotionSensor:
    if turn is None or not isinstance(sensor, Odometer) or sensor.mounting is None:
        return sensor
    mounted = replace(sensor.mounting, camera_from_body=turn @ sensor.mounting.camera_from_body)
    return replace(sensor, mounting=mounted)


def _read_rightly(sensor: MotionSensor, axes: RateAxes | None) -> MotionSensor:
    if axes is None or not isinstance(sensor, Gyroscope):
        return sensor
    return replace(sensor, stream=with_axes(sensor.stream, axes))


def _without_slip(sensor: MotionSensor, slip: Slip | None) -> MotionSensor:
    if slip is None or not isinstance(sensor, Odometer):
        return sensor
    return replace(sensor, stream=without_slip(sensor.stream, slip))


def _without_drift(sensor: MotionSensor, drift: RateDrift | None) -> MotionSensor:
    if drift is None or not isinstance(sensor, Gyroscope):
        return sensor
    return replace(sensor, stream=without_drift(sensor.stream, drift))


def _without_stretches(sensor: MotionSensor, stretches: Sequence[Gap]) -> MotionSensor | None:
    """The sensor without the samples in some stretches; None if no sample is left."""
    if not isinstance(sensor, STAMPED):
        return sensor
    rest: SensorStream | None = sensor.stream
    for stretch in stretches:
        rest = rest and rest.without(stretch)
    if rest is sensor.stream:
        return sensor
    return None if rest is None else replace(sensor, stream=rest)
