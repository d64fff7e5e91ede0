"""All sensors of a run, asked together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import RotationCheck, check_rotations, describe_coverage, describe_gaps
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.fusing import Fused
from sfmcpp.slam.sensing import METRIC_KINDS, Gps, Gyroscope, Ins, Measurement, MotionSensor, Odometer
from sfmcpp.slam.world_map import Keyframe

_Answer = TypeVar("_Answer")
# Those whose stream can be replaced.
_Stamped = (Odometer, Gyroscope, Gps, Ins)


class SensorSuite:
    """The sensors of a run, asked together.

    Parameters
    ----------
    sensors : sequence of MotionSensor
        May be empty. Of two that can tell the same, the first that covers the time is asked.
    """

    def __init__(self, sensors: Sequence[MotionSensor] = ()) -> None:
        self._given = self.sensors = tuple(sensors)
        # Names of those that disagreed with the images the last time they were compared.
        self.in_conflict: frozenset[str] = frozenset()
        self._experience: dict[str, Experience] = {}
        # Seconds by which the stamps of each have been moved.
        self._moved_s: dict[str, float] = {}
        # Whether no clock is in doubt any more.
        self._in_time = not any(isinstance(sensor, Gyroscope) for sensor in self.sensors)

    def state(self) -> dict[str, Any]:
        """What it has learned from the keyframes so far."""
        learnt = {"in_conflict": self.in_conflict, "experience": self._experience}
        return learnt | {"moved_s": dict(self._moved_s), "in_time": self._in_time}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state; the sensors are as they were given."""
        self._move_stamps(state["moved_s"])
        self.in_conflict, self._experience = state["in_conflict"], state["experience"]
        self._in_time = state["in_time"]

    def feed(self, name: str, t_s: FloatArray, values: FloatArray) -> None:
        """More measurements of the sensor of that name, later than those it has."""
        known = [sensor.name for sensor in self._given if isinstance(sensor, _Stamped)]
        if name not in known:
            raise InvalidArgument(f"name = {name!r}: must be one of {', '.join(known) or 'no sensor'}")
        self._given = tuple(
            replace(sensor, stream=sensor.stream.extended(t_s, values))
            if isinstance(sensor, _Stamped) and sensor.name == name
            else sensor
            for sensor in self._given
        )
        self._move_stamps({})

    def measure(
        self,
        start_s: float,
        end_s: float,
        rotation: FloatArray,
        *,
        metric: bool,
        previous: FloatArray | None = None,
    ) -> list[Measurement]:
        """All that can constrain the map as it is: nothing in metres before it has metres.

        `rotation` and `previous` are those of the keyframe and of the one before, world_from_camera.
        """
        turn = self._turn(start_s, end_s, None if previous is None else previous.T @ rotation)
        found = [
            sensor.measure(start_s, end_s, rotation, turn)
            if isinstance(sensor, Odometer)
            else sensor.measure(start_s, end_s, rotation)
            for sensor in self.sensors
        ]
        return [
            m if m.sigma is not None else replace(m, sigma=self._of(m.sensor).sigma)
            for m in found
            if m is not None and (metric or m.kind not in METRIC_KINDS)
        ]

    def since(self, last: Keyframe, time_s: float, pose: FloatArray, *, metric: bool) -> list[Measurement]:
        """All that can constrain a camera of about that pose beside the keyframe before it."""
        rotation, previous = pose[:, :3], last.pose[:, :3]
        return self.measure(last.t_s, time_s, rotation, metric=metric, previous=previous)

    def learn(self, fused: Fused) -> None:
        """Remember how the sensors compared with the images; doubtful ones are named already."""
        self.in_conflict = frozenset(s.name for s in fused.selections if s.conflict.conflicting)
        for constraint, selection in zip(fused.constraints, fused.selections, strict=False):
            if not constraint.measurement.doubtful:
                self._of(selection.name).add(selection.conflict)

    @property
    def in_time(self) -> bool:
        """Whether every clock that can be compared with the camera's has been, and is right."""
        return self._in_time

    def set_clocks(self, vision: Trajectory, largest_offset_s: float) -> list[str]:
        """Move the stamps of a gyroscope to where its rotations are the camera's, if these tell.

        Streams of the same stamps come from the same clock, and are moved with it.

        Parameters
        ----------
        vision : Trajectory
            Rotations that the images alone say.
        largest_offset_s : float
            Offsets up to this are tried [s].

        Returns
        -------
        list of str
            What was moved, a sentence for each.
        """
        gyros = [sensor for sensor in self.sensors if isinstance(sensor, Gyroscope)]
        checks = [check_rotations(s.stream, s.mounting, vision, largest_offset_s) for s in gyros]
        found = [(s, c) for s, c in zip(gyros, checks, strict=True) if c.is_off and c.agrees]
        self._in_time = all(c.is_determined and c.agrees and not c.is_off for c in checks)
        return [self._set_clock(gyro, check) for gyro, check in found]

    def _set_clock(self, gyro: Gyroscope, check: RotationCheck) -> str:
        alike = [
            sensor.name
            for sensor in self.sensors
            if isinstance(sensor, _Stamped) and np.array_equal(sensor.stream.t_s, gyro.stream.t_s)
        ]
        self._move_stamps({name: self._moved_s.get(name, 0.0) + check.offset_s for name in alike})
        for name in alike:
            self._experience.pop(name, None)
        self.in_conflict -= set(alike)
        return f"{' and '.join(alike)}: {check.clock}: {check.offset_s:.2f} s are added to the stamps"

    def _move_stamps(self, seconds: Mapping[str, float]) -> None:
        """Move those of each sensor of these names by so much from where they were given."""
        self._moved_s.update(seconds)
        self.sensors = tuple(
            replace(sensor, stream=sensor.stream.shifted(self._moved_s[sensor.name]))
            if isinstance(sensor, _Stamped) and sensor.name in self._moved_s
            else sensor
            for sensor in self._given
        )

    def _of(self, name: str) -> Experience:
        return self._experience.setdefault(name, Experience())

    def remarks(self) -> list[str]:
        """What is wrong with the streams by themselves, a sentence each: gaps, and speeds that leap."""
        doubts = [
            f"stream {sensor.stream.name!r}: the speed leaps as no vehicle's can; {stretch} "
            + ("inertia carries it" if stretch in sensor.carried_stretches else "it gets no weight")
            for sensor in self.sensors
            if isinstance(sensor, Odometer)
            for stretch in sensor.doubtful_stretches
        ]
        return describe_gaps([sensor.stream for sensor in self.sensors]) + doubts

    def shortcomings(self, start_s: float, end_s: float, *, metric: bool) -> list[str]:
        """What the streams lack of a run over these times, a sentence each; `metric`: the map has metres."""
        lacking = describe_coverage([sensor.stream for sensor in self.sensors], start_s, end_s)
        tells_metres = [sensor.name for sensor in self.sensors if not isinstance(sensor, Gyroscope)]
        if metric or not tells_metres:
            return lacking
        names = " and ".join(tells_metres)
        return [*lacking, f"{names}: tells too little of a motion to bring the map to metres"]

    def complaints(self, vision: Trajectory) -> list[str]:
        """What a whole run tells of the sensors, a sentence each: conflicts, and what nobody declared.

        Of a gyroscope also its clock, its unit and its axes.
        """
        learnt = [found for name, known in self._experience.items() for found in known.describe(name)]
        checks = {
            sensor.name: check_rotations(sensor.stream, sensor.mounting, vision)
            for sensor in self.sensors
            if isinstance(sensor, Gyroscope)
        }
        return learnt + [found for name, check in checks.items() if (found := check.complaint(name))]

    def distance(self, start_s: float, end_s: float, turn: FloatArray | None = None) -> float | None:
        """Distance between two times [m]; `turn` start_from_end of the camera, where no gyroscope tells."""
        turn = self._turn(start_s, end_s, turn)
        answers = (s.between(start_s, end_s, turn) for s in self.sensors if isinstance(s, Odometer))
        return _first_known(answers)

    def _turn(self, start_s: float, end_s: float, seen: FloatArray | None) -> FloatArray | None:
        turn = self.rotation(start_s, end_s)
        return seen if turn is None else turn

    def rotation(self, start_s: float, end_s: float) -> FloatArray | None:
        """Rotation start_from_end of the camera, by a gyroscope that agrees with the images."""
        asked = [s for s in self.sensors if isinstance(s, Gyroscope) and s.name not in self.in_conflict]
        answers = (s.between(start_s, end_s) for s in asked)
        return _first_known(answers)

    def centre(self, time_s: float, rotation: FloatArray) -> FloatArray | None:
        """Centre of the camera in the sensors' world [m]."""
        answers = (s.at(time_s, rotation) for s in self.sensors if isinstance(s, Gps))
        return _first_known(answers)

    def pose(self, time_s: float) -> FloatArray | None:
        """Pose of the camera in the sensors' world."""
        answers = (s.at(time_s) for s in self.sensors if isinstance(s, Ins))
        return _first_known(answers)


def _first_known(answers: Iterable[_Answer | None]) -> _Answer | None:
    return next((answer for answer in answers if answer is not None), None)
