"""Clock of an odometer that has no gyroscope beside it, by the directions of travel from frame to frame."""

from __future__ import annotations

from sfmcpp.geometry.direction_of_travel import refine_travel
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common
from sfmcpp.model.rigs import relative
from sfmcpp.sensors import Turn, check_directions
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite

# More steps would not determine the clock better, and would take memory for as long as a run lasts.
_MOST_STEPS = 10_000


def remember_step(
    result: SlamResult, before: Frame, after: Frame, pose: FloatArray, sensors: SensorSuite
) -> None:
    """Keep the motion between two consecutive frames, refined by the tracks they share, for odometer clocks.

    Parameters
    ----------
    result : SlamResult
        The run so far, which has a pose of the frame before.
    before, after : Frame
        Consecutive frames; the first is the last keyframe, or lies between keyframes.
    pose : (3, 4) float64
        Of the frame after, world_from_camera.
    sensors : SensorSuite
        Whose `steps` grow.
    """
    world = result.world
    if world is None or len(sensors.steps) >= _MOST_STEPS or not _odometers(sensors):
        return
    known = result.path.between.get(before.number, world.keyframes[-1].pose)
    in_before, in_after = common(before.view, after.view)
    pixels = before.view.pixels[in_before], after.view.pixels[in_after]
    found = refine_travel(*pixels, world.intrinsics[0], relative(known[None], pose[None])[0])
    if found is not None:
        motion = found.rotation, found.direction, found.covariance
        sensors.steps.append(Turn(before.t_s, after.t_s, *motion))


def set_odometer_clocks(sensors: SensorSuite) -> list[str]:
    """Move the stamps of odometers to where their directions are the camera's; a sentence for each."""
    warnings = []
    for odometer in _odometers(sensors):
        assert odometer.mounting is not None
        clock = check_directions(odometer.stream, odometer.mounting, sensors.steps)
        if clock.is_off:
            sensors.move_stamps([odometer.name], clock.offset_s)
            warnings.append(f"{odometer.name}: {clock.complaint}")
    return warnings


def _odometers(sensors: SensorSuite) -> list[Odometer]:
    """Odometers of velocities, whose directions determine the clock; none if a gyroscope does."""
    if sensors.of_type(Gyroscope):
        return []
    return [s for s in sensors.of_type(Odometer) if s.stream.kind == "velocity" and s.mounting is not None]
