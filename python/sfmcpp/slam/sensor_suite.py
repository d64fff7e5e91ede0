"""All sensors of a run, asked together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import check_rotations, describe_gaps
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.fusing import Fused
from sfmcpp.slam.sensing import METRIC_KINDS, Gps, Gyroscope, Ins, Measurement, MotionSensor, Odometer
from sfmcpp.slam.world_map import Keyframe

_Answer = TypeVar("_Answer")


class SensorSuite:
    """The sensors of a run, asked together.

    Parameters
    ----------
    sensors : sequence of MotionSensor
        May be empty. Of two that can tell the same, the first that covers the time is asked.
    """

    def __init__(self, sensors: Sequence[MotionSensor] = ()) -> None:
        self.sensors = tuple(sensors)
        # Names of those that disagreed with the images the last time they were compared.
        self.in_conflict: frozenset[str] = frozenset()
        self._experience: dict[str, Experience] = {}

    def state(self) -> dict[str, Any]:
        """What it has learned from the keyframes so far."""
        return {"in_conflict": self.in_conflict, "experience": self._experience}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.in_conflict, self._experience = state["in_conflict"], state["experience"]

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
