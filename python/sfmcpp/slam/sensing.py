"""What a sensor says of the camera's motion between two frames, as a constraint of thesis table 5.1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sfmcpp.model import SensorStream
from sfmcpp.model.problem import FloatArray
from sfmcpp.sensors import Mounting, rotation_increment, travelled_distance


@dataclass(frozen=True, eq=False)
class Measurement:
    """One constraint between two keyframes.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    kind : str
        Row of thesis table 5.1: ``"scale"`` (the distance of the centres) or
        ``"displacement-rotation-log"`` (the rotation previous_from_this of the camera).
    value : float or (3, 3) float64
        Distance [m], or rotation.
    sigma : float
        What the sensor may be off [m or rad]: not for the weight, only for telling a conflict.
    """

    sensor: str
    kind: str
    value: float | FloatArray
    sigma: float


class MotionSensor(Protocol):
    """A sensor of motion: anything with a name and a measurement between two times.

    Parameters
    ----------
    *args, **kwargs
        Those of the class that follows this protocol.
    """

    @property
    def name(self) -> str:
        """Name in reports."""

    def between(self, start_s: float, end_s: float) -> Measurement | None:
        """Measurement of the motion between two times [s]; None where the stream does not cover them."""


@dataclass(frozen=True, eq=False)
class Odometer:
    """Distances: constrains the scale ‖c_i − c_{i−1}‖ (thesis eq. 5.20).

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    name : str
        Name in reports.
    sigma_m, relative_sigma : float
        What a distance may be off: a length [m], and a share of the distance.
    """

    stream: SensorStream
    name: str = "odometer"
    sigma_m: float = 0.02
    relative_sigma: float = 0.03

    def between(self, start_s: float, end_s: float) -> Measurement | None:
        """Distance travelled [m]; the arc stands for the chord, which keyframes are close enough for."""
        distance = travelled_distance(self.stream, start_s, end_s)
        if distance is None:
            return None
        sigma_m = float(np.hypot(self.sigma_m, self.relative_sigma * distance))
        return Measurement(self.name, "scale", abs(distance), sigma_m)


@dataclass(frozen=True, eq=False)
class Gyroscope:
    """Rotations: constrains the rotation from one keyframe to the next (thesis eq. 5.21).

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``.
    mounting : Mounting
        How the camera sits on the body.
    name : str
        Name in reports.
    sigma_rad : float
        What the rotation from one keyframe to the next may be off, about each axis [rad].
    """

    stream: SensorStream
    mounting: Mounting
    name: str = "gyro"
    sigma_rad: float = 0.003

    def between(self, start_s: float, end_s: float) -> Measurement | None:
        """Rotation of the camera, previous_from_this."""
        turn = rotation_increment(self.stream, start_s, end_s)
        if turn is None:
            return None
        rotation = self.mounting.camera_rotation(turn)
        return Measurement(self.name, "displacement-rotation-log", rotation, self.sigma_rad)


class SensorSuite:
    """The sensors of a run, asked together.

    Parameters
    ----------
    sensors : sequence of MotionSensor
        May be empty.
    """

    def __init__(self, sensors: Sequence[MotionSensor] = ()) -> None:
        self.sensors = tuple(sensors)
        # The map has no metres until it is registered.
        self.metric = False

    @property
    def gives_scale(self) -> bool:
        """Whether any sensor measures distances."""
        return any(isinstance(sensor, Odometer) for sensor in self.sensors)

    def between(self, start_s: float, end_s: float) -> list[Measurement]:
        """All measurements of an interval that can constrain the map as it is: no distances before metres."""
        found = [sensor.between(start_s, end_s) for sensor in self.sensors]
        return [m for m in found if m is not None and (self.metric or m.kind != "scale")]

    def distance(self, start_s: float, end_s: float) -> float | None:
        """Measured distance [m], whether or not the map is metric."""
        for sensor in self.sensors:
            if isinstance(sensor, Odometer) and (found := sensor.between(start_s, end_s)) is not None:
                return float(found.value)
        return None

    def rotation(self, start_s: float, end_s: float) -> FloatArray | None:
        """Measured rotation previous_from_this of the camera."""
        for sensor in self.sensors:
            if isinstance(sensor, Gyroscope) and (found := sensor.between(start_s, end_s)) is not None:
                return np.asarray(found.value)
        return None
