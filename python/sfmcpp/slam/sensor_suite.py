"""All sensors of a run, with their clocks, biases and conflicts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, TypeGuard, TypeVar

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import Gap, SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import (
    MOST_TURNS,
    RotationCheck,
    Slip,
    Turn,
    check_rotations,
    check_turns,
    dead_stretches,
    describe_coverage,
    describe_gaps,
    describe_spikes,
    find_bias,
    find_misalignment,
    without_bias,
    without_spikes,
)
from sfmcpp.sensors.agreement import describe_other_time
from sfmcpp.slam.corrected_sensors import STAMPED, camera_steps, corrected, speed_jumps
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.fusion import Fused
from sfmcpp.slam.motion_sensors import METRIC_KINDS, Gps, Gyroscope, Ins, Measurement, MotionSensor, Odometer
from sfmcpp.slam.world_map import Keyframe

_Answer = TypeVar("_Answer")
# Biases that are no further apart are one [rad/s].
_SAME_BIAS_RAD_S = float(np.radians(0.1))
# Turns that a clock is compared by.
_LAST_TURNS = 48


class SensorSuite:
    """The sensors of a run with their corrections.

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
        self.moved_s: dict[str, float] = {}
        # What was taken from the rates of each gyroscope [rad/s].
        self._biases: dict[str, FloatArray] = {}
        # Slow slips of odometers that the end of the run has shown.
        self.slips: dict[str, Slip] = {}
        # The motions that pairs of images have told, and the time up to which they were asked [s].
        self._turns: list[Turn] = []
        self.turns_until_s = -np.inf
        # Motions from frame to frame with their covariances.
        self.steps: list[Turn] = []
        # Whether no clock is in doubt any more.
        self._in_time = not any(isinstance(sensor, Gyroscope) for sensor in self.sensors)
        self._apply_corrections()

    def state(self) -> dict[str, Any]:
        """State gained from the keyframes so far, for checkpoints."""
        return {
            "in_conflict": self.in_conflict,
            "experience": self._experience,
            "moved_s": dict(self.moved_s),
            "in_time": self._in_time,
            "biases": self._biases,
            "turns": self._turns,
            "turns_until_s": self.turns_until_s,
            "steps": list(self.steps),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state; the sensors are as they were given."""
        self.moved_s, self._biases = state["moved_s"], state["biases"]
        self._turns, self.turns_until_s, self.steps = (state[k] for k in ("turns", "turns_until_s", "steps"))
        self._apply_corrections()
        self.in_conflict, self._experience = state["in_conflict"], state["experience"]
        self._in_time = state["in_time"]

    def feed(self, name: str, t_s: FloatArray, values: FloatArray) -> None:
        """More measurements of the sensor of that name, later than those it has."""
        known = [sensor.name for sensor in self._given if isinstance(sensor, STAMPED)]
        if name not in known:
            raise InvalidArgument(f"name = {name!r}: must be one of {', '.join(known) or 'no sensor'}")
        self._given = tuple(
            replace(sensor, stream=sensor.stream.extended(t_s, values))
            if isinstance(sensor, STAMPED) and sensor.name == name
            else sensor
            for sensor in self._given
        )
        self._apply_corrections()

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
        turn = self._rotation_or_seen(start_s, end_s, None if previous is None else previous.T @ rotation)
        found = [
            sensor.measure(start_s, end_s, rotation, turn)
            if isinstance(sensor, Odometer)
            else sensor.measure(start_s, end_s, rotation)
            for sensor in self.sensors
        ]
        return [
            m if m.sigma is not None else replace(m, sigma=self._experience_of(m.sensor).sigma)
            for m in found
            if m is not None and (metric or m.kind not in METRIC_KINDS)
        ]

    def since(self, last: Keyframe, time_s: float, pose: FloatArray, *, metric: bool) -> list[Measurement]:
        """All that can constrain a camera of about that pose beside the keyframe before it."""
        rotation, previous = pose[:, :3], last.pose[:, :3]
        return self.measure(last.t_s, time_s, rotation, metric=metric, previous=previous)

    def learn(self, fused: Fused, stretch: Gap) -> None:
        """Remember how the sensors compared with the images over a time; doubtful ones are named already."""
        self.in_conflict = frozenset(s.name for s in fused.selections if s.conflict.conflicting)
        for constraint, selection in zip(fused.constraints, fused.selections, strict=False):
            if not constraint.measurement.doubtful:
                self._experience_of(selection.name).add(selection.conflict, stretch)

    @property
    def in_time(self) -> bool:
        """Whether every clock that can be compared with the camera's has been, and is right."""
        return self._in_time

    def set_clocks(self, vision: Trajectory | None, largest_offset_s: float) -> list[str]:
        """Move the stamps of a gyroscope to where its rotations are the camera's, if these tell.

        Streams of the same stamps come from the same clock, and are moved with it.

        Parameters
        ----------
        vision : Trajectory or None
            Rotations that the images alone say; None: the last of those that pairs of images have told.
        largest_offset_s : float
            Offsets up to this are tried [s].

        Returns
        -------
        list of str
            What was moved, a sentence for each.
        """
        gyros = [sensor for sensor in self.sensors if isinstance(sensor, Gyroscope)]
        checks = [
            check_turns(s.stream, s.mounting, self._turns[-_LAST_TURNS:], largest_offset_s)
            if vision is None
            else check_rotations(s.stream, s.mounting, vision, largest_offset_s)
            for s in gyros
        ]
        found = [(s, c) for s, c in zip(gyros, checks, strict=True) if c.is_off and c.agrees]
        self._in_time = all(c.is_determined and c.agrees and not c.is_off for c in checks)
        return [self._set_clock(gyro, check) for gyro, check in found]

    def _set_clock(self, gyro: Gyroscope, check: RotationCheck) -> str:
        alike = [
            sensor.name
            for sensor in self.sensors
            if isinstance(sensor, STAMPED) and np.array_equal(sensor.stream.t_s, gyro.stream.t_s)
        ]
        self.move_stamps(alike, check.offset_s)
        return f"{' and '.join(alike)}: {check.clock}: {check.offset_s:.2f} s are added to the stamps"

    def move_stamps(self, names: Collection[str], offset_s: float) -> None:
        """Add as many seconds to the stamps of the sensors of these names."""
        self.moved_s |= {name: self.moved_s.get(name, 0.0) + offset_s for name in names}
        self._apply_corrections()
        self._forget_experience(names)

    def _refine_clocks(self, vision: Trajectory) -> None:
        """Set clocks that were wrong once more: hundredths of a second are ten milliradians of a turn."""
        for sensor in self.sensors:
            if isinstance(sensor, Gyroscope) and sensor.name in self.moved_s:
                check = check_rotations(sensor.stream, sensor.mounting, vision)
                if check.is_determined and check.agrees:
                    self._set_clock(sensor, check)

    @property
    def compares_pairs(self) -> bool:
        """Whether there are any whose bias, mounting or axes pairs of images can tell."""
        return any(_has_rates(sensor) or isinstance(sensor, Odometer | Gps) for sensor in self.sensors)

    @property
    def turns(self) -> tuple[Turn, ...]:
        """Rotations from pairs of images, in the order of time."""
        return tuple(self._turns)

    def remove_biases(self, turns: Sequence[Turn], until_s: float) -> bool:
        """Take from the rates of gyroscopes what pairs of images, these and those so far, say is no rotation.

        Parameters
        ----------
        turns : sequence of Turn
            What those up to `until_s` tell that tell anything.
        until_s : float
            Time of the last image [s].

        Returns
        -------
        bool
            Whether any rates have changed.
        """
        self._turns, self.turns_until_s = [*self._turns, *turns], until_s
        known = dict(self._biases)
        for sensor in self._given:
            if _has_rates(sensor):
                in_step = self._on_camera_clock(sensor.name, sensor.stream)
                self._learn_bias(sensor.name, find_bias(in_step, sensor.mounting, self._turns))
        changed = any(bias is not known.get(name) for name, bias in self._biases.items())
        if changed:
            self._apply_corrections()
            self._forget_experience(self._biases.keys() - known.keys())
        return changed

    def _learn_bias(self, name: str, found: FloatArray | None) -> None:
        known = self._biases.get(name, np.zeros(3))
        if found is not None and np.linalg.norm(found - known) > _SAME_BIAS_RAD_S:
            self._biases[name] = found

    def _apply_corrections(self) -> None:
        """Make the sensors those given, but for their clocks, spikes and biases."""
        self.sensors = tuple(
            replace(sensor, stream=self._corrected(sensor.name, sensor.stream))
            if _has_rates(sensor) or (isinstance(sensor, STAMPED) and sensor.name in self.moved_s)
            else sensor
            for sensor in self._given
        )

    def _corrected(self, name: str, stream: SensorStream) -> SensorStream:
        known = self._biases.get(name)
        in_step = self._on_camera_clock(name, stream)
        return in_step if known is None else without_bias(in_step, known)

    def _on_camera_clock(self, name: str, stream: SensorStream) -> SensorStream:
        """A stream on the clock of the camera, as far as it is known; rates without their spikes."""
        sound = without_spikes(stream) if stream.kind == "angular_rate" else stream
        moved_s = self.moved_s.get(name)
        return sound if moved_s is None else sound.shifted(moved_s)

    def _forget_experience(self, names: Collection[str]) -> None:
        """Discard the knowledge about sensors that have been corrected."""
        for name in names:
            self._experience.pop(name, None)
        self.in_conflict -= set(names)

    def _experience_of(self, name: str) -> Experience:
        return self._experience.setdefault(name, Experience())

    def remarks(self) -> list[str]:
        """What is wrong with the streams by themselves, a sentence each: gaps, and what leaps."""
        doubts = [found for s in self.sensors if isinstance(s, Odometer) for found in speed_jumps(s)]
        leaps = [found for s in self.sensors if isinstance(s, Gps | Ins) for found in s.remarks()]
        leaps += [found for s in self._given if _has_rates(s) for found in describe_spikes(s.stream)]
        return describe_gaps([sensor.stream for sensor in self.sensors]) + doubts + leaps

    def ends_s(self) -> dict[str, float]:
        """Time of the last measurement of each sensor as it was given [s], by name."""
        return {sensor.name: float(sensor.stream.t_s[-1]) for sensor in self._given}

    def elsewhere(self, time_s: float) -> list[str]:
        """Streams whose times are not those of the first image, a sentence each."""
        return [found for s in self._given for found in describe_other_time(s.stream, time_s)]

    def shortcomings(self, start_s: float, end_s: float) -> list[str]:
        """What the streams lack of a run over these times, a sentence each."""
        return describe_coverage([sensor.stream for sensor in self.sensors], start_s, end_s)

    def complaints(self, vision: Trajectory) -> list[str]:
        """What a whole run tells of the sensors, a sentence each: conflicts, and what nobody declared.

        Of a gyroscope also its clock, its unit and its axes.
        """
        checks = {
            sensor.name: check_rotations(sensor.stream, sensor.mounting, vision)
            for sensor in self.sensors
            if isinstance(sensor, Gyroscope)
        }
        turned = [
            f"{name}: its directions differ by {np.degrees(so3.rotation_angle(turn)):.1f}° from those of the "
            "camera: check the declared mounting"
            for name, turn in self._misalignments().items()
        ]
        found = [told for name, check in checks.items() if (told := check.complaint(name))]
        return self._biased_and_dead(self._turns) + turned + self._conflicts() + found

    def faults_so_far(self) -> list[str]:
        """What can be told before the end: biases, what has been dead lately, conflicts."""
        return self._biased_and_dead(self._turns[-MOST_TURNS:]) + self._conflicts()

    def _conflicts(self) -> list[str]:
        return [found for name, known in self._experience.items() for found in known.describe(name)]

    def _biased_and_dead(self, turns: Sequence[Turn]) -> list[str]:
        biases = [
            f"{name}: a bias of {np.degrees(np.linalg.norm(rate)):.1f}°/s is removed from its rates"
            for name, rate in self._biases.items()
        ]
        dead = [
            f"{name}: it does not move for {stretch}, while the images do: is it dead?"
            for name, stretches in self._dead_stretches(turns).items()
            for stretch in stretches
        ]
        return biases + dead

    def in_hindsight(self, vision: Trajectory) -> tuple[MotionSensor, ...] | None:
        """The sensors as they should have been from the start; None where the run has found nothing wrong.

        On the camera's clock, as the rotations `vision` of the whole run tell it where it was wrong, without
        their biases, and without the samples of motions that the images have denied. Positions and poses keep
        theirs: a map drifts off them by itself, and without them it would not come back.
        """
        self._refine_clocks(vision)
        misaligned = self._misalignments()
        of_motion = [sensor.name for sensor in self.sensors if not isinstance(sensor, Gps | Ins)]
        denied = {
            name: (stretch,)
            for name, known in self._experience.items()
            if name in of_motion and (stretch := known.denied)
        }
        # What a dead or a slipping odometer has bent says nothing against the others.
        wrong = self._dead_stretches(self._turns) or ({} if self.slips else denied)
        if not {*wrong, *misaligned, *self.moved_s, *self._biases, *self.slips}:
            return None
        kept = [corrected(s, wrong.get(s.name, ()), self.slips, misaligned) for s in self.sensors]
        return tuple(sensor for sensor in kept if sensor is not None)

    def _dead_stretches(self, turns: Sequence[Turn]) -> dict[str, tuple[Gap, ...]]:
        """Where odometers stand still while pairs of images tell a step."""
        odometers = [sensor for sensor in self.sensors if isinstance(sensor, Odometer)]
        found = {odometer.name: dead_stretches(odometer.stream, turns) for odometer in odometers}
        return {name: stretches for name, stretches in found.items() if stretches}

    def _misalignments(self) -> dict[str, FloatArray]:
        """Rotations of the camera against the mountings of odometers, where images determine them."""
        dead = self._dead_stretches(self._turns)
        odometers = [s for s in self.sensors if isinstance(s, Odometer) and s.name not in dead]
        steps = {odometer.name: camera_steps(odometer, self._turns[-MOST_TURNS:]) for odometer in odometers}
        return {name: turn for name, pair in steps.items() if (turn := find_misalignment(*pair)) is not None}

    def distance(self, start_s: float, end_s: float, turn: FloatArray | None = None) -> float | None:
        """Distance between two times [m]; `turn` start_from_end of the camera, where no gyroscope tells."""
        turn = self._rotation_or_seen(start_s, end_s, turn)
        answers = (s.between(start_s, end_s, turn) for s in self.sensors if isinstance(s, Odometer))
        return _first_not_none(answers)

    def _rotation_or_seen(self, start_s: float, end_s: float, seen: FloatArray | None) -> FloatArray | None:
        turn = self.rotation(start_s, end_s)
        return seen if turn is None else turn

    def rotation(self, start_s: float, end_s: float) -> FloatArray | None:
        """Rotation start_from_end of the camera, by a gyroscope that agrees with the images."""
        asked = [s for s in self.sensors if isinstance(s, Gyroscope) and s.name not in self.in_conflict]
        answers = (s.between(start_s, end_s) for s in asked)
        return _first_not_none(answers)

    def centre(self, time_s: float, rotation: FloatArray) -> FloatArray | None:
        """Centre of the camera in the sensors' world [m]."""
        answers = (s.at(time_s, rotation) for s in self.sensors if isinstance(s, Gps))
        return _first_not_none(answers)

    def pose(self, time_s: float) -> FloatArray | None:
        """Pose of the camera in the sensors' world."""
        answers = (s.at(time_s) for s in self.sensors if isinstance(s, Ins))
        return _first_not_none(answers)


def _has_rates(sensor: MotionSensor) -> TypeGuard[Gyroscope]:
    return isinstance(sensor, Gyroscope) and sensor.stream.kind == "angular_rate"


def _first_not_none(answers: Iterable[_Answer | None]) -> _Answer | None:
    return next((answer for answer in answers if answer is not None), None)
