"""All sensors of a run: what they measure, on the camera's clock and without their biases."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Gap, SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame
from sfmcpp.sensors import (
    RateBias,
    RotationCheck,
    Slip,
    Turn,
    check_rotations,
    check_turns,
    without_bias,
    without_spikes,
)
from sfmcpp.sensors.odometer import stops_on_the_way
from sfmcpp.sensors.rate_drift import RateDrift, find_drift
from sfmcpp.slam.experience import Experience, informed
from sfmcpp.slam.fusion import Fused
from sfmcpp.slam.measurement import METRIC_KINDS, PLACE_KINDS, Measurement, MotionSensor
from sfmcpp.slam.motion_sensors import STAMPED, Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.rate_biases import RateBiases, RatesAtRest
from sfmcpp.slam.world_map import Keyframe

_Answer = TypeVar("_Answer")
_Sensor = TypeVar("_Sensor", Odometer, Gyroscope, Gps, Ins)
# A gyroscope with a bias is none of a navigation unit: its rotations wander by so much more [rad/√s].
_WALK_RAD_SQRT_S = 0.004
# A body that an odometer moves faster than this does not rest, whatever the images show [m/s].
_AT_REST_M_S = 0.2
# A clock is estimated from the rotations of so many pairs of images, the latest.
_LAST_TURNS = 48
# Clock offsets up to this are tried [s].
_LARGEST_OFFSET_S = 1.0
# Attributes that change with the keyframes, and at the end of a run.
_STATE = (
    "in_conflict",
    "experience",
    "moved_s",
    "in_time",
    "biases",
    "slips",
    "drifts",
    "turns",
    "turns_until_s",
    "steps",
)


@dataclass(frozen=True, eq=False)
class _Corrected:
    """Sensors with their corrections, which are made where they are asked for: many feeds come between."""

    given: tuple[MotionSensor, ...]
    moved_s: Mapping[str, float]
    biases: Mapping[str, RateBias]

    @cached_property
    def sensors(self) -> tuple[MotionSensor, ...]:
        return tuple(map(self._corrected, self.given))

    @cached_property
    def in_step(self) -> dict[str, SensorStream]:
        """Streams on the camera's clock, as far as that is known; rates without their spikes."""
        return {s.name: self._on_camera_clock(s.name, s.stream) for s in self.given if isinstance(s, STAMPED)}

    def _corrected(self, sensor: MotionSensor) -> MotionSensor:
        if not (has_rates(sensor) or (isinstance(sensor, STAMPED) and sensor.name in self.moved_s)):
            return sensor
        in_step = replace(sensor, stream=self.in_step[sensor.name])
        bias = self.biases.get(sensor.name)
        return _without_bias(in_step, bias) if bias is not None and has_rates(in_step) else in_step

    def _on_camera_clock(self, name: str, stream: SensorStream) -> SensorStream:
        sound = without_spikes(stream) if stream.kind == "angular_rate" else stream
        moved_s = self.moved_s.get(name)
        return sound if moved_s is None else sound.shifted(moved_s)


class SensorSuite:
    """The sensors of a run with their corrections.

    Parameters
    ----------
    sensors : sequence of MotionSensor
        May be empty. Of two that can tell the same, the first that covers the time is asked.

    Raises
    ------
    InvalidArgument
        If two have the same name, by which clocks, biases and conflicts are known.
    """

    def __init__(self, sensors: Sequence[MotionSensor] = ()) -> None:
        names = [sensor.name for sensor in sensors]
        for name in names:
            if (count := names.count(name)) > 1:
                raise InvalidArgument(f"sensors: {count} are named {name!r}, must have names of their own")
        self.given = tuple(sensors)  # without corrections
        # Names of those that the images deny up to the latest keyframe: at one alone the images may be wrong.
        self.in_conflict: frozenset[str] = frozenset()
        # How each compared with the images so far, by name.
        self.experience: dict[str, Experience] = {}
        # What was added to the stamps of each, by name [s].
        self.moved_s: dict[str, float] = {}
        # What was subtracted from the rates of each gyroscope.
        self.biases = RateBiases()
        # Slow slips of odometers and biases that change, by name; known at the end of the run.
        self.slips: dict[str, Slip] = {}
        self.drifts: dict[str, RateDrift] = {}
        # Motions by pairs of images, in the order of time, and the time of the last image compared [s].
        self.turns: list[Turn] = []
        self.turns_until_s = -np.inf
        # Motions from frame to frame with their covariances.
        self.steps: list[Turn] = []
        # Whether every clock that can be compared with the camera's has been, and is right.
        self.in_time = not any(isinstance(sensor, Gyroscope) for sensor in self.given)
        self._apply_corrections()

    @property
    def sensors(self) -> tuple[MotionSensor, ...]:
        """The sensors with their corrections."""
        return self._corrected.sensors

    def of_type(self, kind: type[_Sensor]) -> list[_Sensor]:
        """The sensors of a class, with their corrections."""
        return [sensor for sensor in self.sensors if isinstance(sensor, kind)]

    def state(self) -> dict[str, Any]:
        """State gained from the keyframes so far, for checkpoints."""
        return {name: copy(getattr(self, name)) for name in _STATE}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state; the sensors are as they were given."""
        for name in _STATE:
            setattr(self, name, state[name])
        self._apply_corrections()

    def feed(self, name: str, t_s: ArrayLike, values: ArrayLike) -> None:
        """More measurements of the sensor of that name, later than those it has."""
        known = [sensor.name for sensor in self.given if isinstance(sensor, STAMPED)]
        if name not in known:
            raise InvalidArgument(f"name = {name!r}: must be one of {', '.join(known) or 'no sensor'}")
        self.given = tuple(
            replace(sensor, stream=sensor.stream.extended(t_s, values))
            if isinstance(sensor, STAMPED) and sensor.name == name
            else sensor
            for sensor in self.given
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
        """Ask all sensors about a keyframe.

        Parameters
        ----------
        start_s, end_s : float
            Times of the keyframe before and of this one [s].
        rotation : (3, 3) float64
            World_from_camera of this one, as far as it is known.
        metric : bool
            Whether the map is in metres; measurements in metres are left out until it is.
        previous : (3, 3) float64, optional
            World_from_camera of the keyframe before, for odometers without a gyroscope beside them.

        Returns
        -------
        list of Measurement
            With estimated standard deviations where none is declared.
        """
        turn = self._turns_or_seen(start_s, end_s, None if previous is None else previous.T @ rotation)
        found = [
            sensor.measure(start_s, end_s, rotation, turn)
            if isinstance(sensor, Odometer)
            else sensor.measure(start_s, end_s, rotation)
            for sensor in self.sensors
        ]
        return [
            informed(m, self._experience_of(m.sensor), start_s, end_s)
            for m in found
            if m is not None and (metric or m.kind not in METRIC_KINDS)
        ]

    def since(self, last: Keyframe, time_s: float, pose: FloatArray, *, metric: bool) -> list[Measurement]:
        """Ask all sensors about a camera at a time [s], roughly at `pose` (3, 4), since a keyframe."""
        rotation, previous = pose[:, :3], last.pose[:, :3]
        return self.measure(last.t_s, time_s, rotation, metric=metric, previous=previous)

    def learn(self, fused: Fused, stretch: Gap, *, moved_back: bool = False) -> None:
        """Remember how the sensors compared with the images at a keyframe, over the time to it.

        Not those whose own stream is in doubt there: a warning names them already. Where the map was
        `moved_back` to positions, it was not these that were wrong.
        """
        for constraint, selection in zip(fused.constraints, fused.selections, strict=False):
            if not constraint.measurement.doubtful:
                known = self._experience_of(selection.name)
                known.add(selection.conflict, stretch, refuted=fused.images_wrong)
                if moved_back and constraint.measurement.kind in PLACE_KINDS:
                    known.explain()
        self.in_conflict = frozenset(name for name, known in self.experience.items() if known.is_denied)

    def set_clocks(self, vision: Trajectory | None = None) -> list[str]:
        """Set the clocks of gyroscopes by the rotations of the camera, where these determine them.

        Streams with the same stamps come from the same clock, and are moved with it.

        Parameters
        ----------
        vision : Trajectory, optional
            Rotations of the camera by the images alone. Default: those of the latest pairs of images.

        Returns
        -------
        list of str
            A sentence for each clock that was off.
        """
        gyros = self.of_type(Gyroscope)
        checks = [
            check_turns(s.stream, s.mounting, self.turns[-_LAST_TURNS:], _LARGEST_OFFSET_S)
            if vision is None
            else check_rotations(s.stream, s.mounting, vision, _LARGEST_OFFSET_S)
            for s in gyros
        ]
        found = [(s, c) for s, c in zip(gyros, checks, strict=True) if c.is_off and c.agrees]
        self.in_time = all(c.is_determined and c.agrees and not c.is_off for c in checks)
        return [told for gyro, check in found for told in self._set_clock(gyro, check)]

    def _set_clock(self, gyro: Gyroscope, check: RotationCheck) -> list[str]:
        """A sentence for the clock that is set; none where it has just been set with that of another."""
        alike = [
            sensor.name
            for sensor in self.sensors
            if isinstance(sensor, STAMPED) and np.array_equal(sensor.stream.t_s, gyro.stream.t_s)
        ]
        if not alike:
            return []
        self.move_stamps(alike, check.offset_s)
        return [f"{' and '.join(alike)}: {check.clock}: {check.offset_s:.2f} s are added to the stamps"]

    def move_stamps(self, names: Collection[str], offset_s: float) -> None:
        """Add `offset_s` to the stamps of the sensors of these names [s]."""
        self.moved_s |= {name: self.moved_s.get(name, 0.0) + offset_s for name in names}
        self._apply_corrections()
        self._forget_experience(names)

    def refine_clocks(self, vision: Trajectory) -> None:
        """Set once more the clocks of gyroscopes that were off, by the rotations of the whole run.

        In a turn of 1 rad/s a hundredth of a second is 10 mrad.
        """
        for gyro in self.of_type(Gyroscope):
            if gyro.name in self.moved_s:
                check = check_rotations(gyro.stream, gyro.mounting, vision)
                if check.is_determined and check.agrees:
                    self._set_clock(gyro, check)

    @property
    def compares_pairs(self) -> bool:
        """Whether pairs of images can show the bias, the mounting or the axes of any sensor."""
        return any(has_rates(sensor) or isinstance(sensor, Odometer | Gps) for sensor in self.sensors)

    def remove_biases(self, turns: Sequence[Turn], until_s: float) -> bool:
        """Estimate the biases of gyroscopes anew with further pairs of images, and subtract them.

        Parameters
        ----------
        turns : sequence of Turn
            Motions by pairs of images, later than those so far; pairs that determine none are left out.
        until_s : float
            Time of the last image of these pairs [s].

        Returns
        -------
        bool
            Whether any rates have changed.
        """
        self.turns, self.turns_until_s = [*self.turns, *turns], until_s
        return self._learn_biases()

    def rests_before(self, frame: Frame | None) -> bool:
        """Whether rates have changed, as the camera stood still until the next `frame`, or the end."""
        if not any(map(has_rates, self.given)):
            return False
        rest = self.biases.standstill.take(frame)
        if rest is None or self._drives(rest):
            return False
        self.biases.rests.append(rest)
        return self._learn_biases()

    def _drives(self, rest: Gap) -> bool:
        """Whether an odometer says so, as behind a lorry that fills the image."""
        distance = self.distance(rest.start_s, rest.end_s)
        return distance is not None and distance > _AT_REST_M_S * (rest.end_s - rest.start_s)

    def _learn_biases(self) -> bool:
        """Estimate the biases of gyroscopes, and subtract them; whether any rates have changed."""
        before, changed = set(self.biases.known), False
        for sensor in self.given:
            if has_rates(sensor):
                changed |= self.biases.learn(
                    sensor.name, self._resting(sensor.name), sensor.mounting, self.turns
                )
        if changed:
            self._apply_corrections()
            self._forget_experience(self.biases.known.keys() - before)
        return changed

    def _resting(self, name: str) -> RatesAtRest:
        """Rates by the rests so far, computed once for each: most keyframes are none."""
        known = self._at_rest.get(name)
        if known is None or known.rests != len(self.biases.rests):
            known = self._at_rest[name] = RatesAtRest.of(self._corrected.in_step[name], self.biases.rests)
        return known

    def find_drifts(self) -> None:
        """Find gyroscopes whose bias changes, by all pairs of images of the run."""
        found = {s.name: find_drift(s.stream, s.mounting, self.turns) for s in self.sensors if has_rates(s)}
        self.drifts = {name: drift for name, drift in found.items() if drift is not None}

    def _apply_corrections(self) -> None:
        """Make the sensors those given, with their clocks set, and without spikes and biases of rates."""
        self._corrected = _Corrected(self.given, dict(self.moved_s), dict(self.biases.known))
        self._at_rest: dict[str, RatesAtRest] = {}

    def _forget_experience(self, names: Collection[str]) -> None:
        """Discard the knowledge about sensors that have been corrected."""
        for name in names:
            self.experience.pop(name, None)
        self.in_conflict -= set(names)

    def _experience_of(self, name: str) -> Experience:
        return self.experience.setdefault(name, Experience())

    def ends_s(self) -> dict[str, float]:
        """Time of the last measurement of each sensor as it was given [s], by name."""
        return {sensor.name: float(sensor.stream.t_s[-1]) for sensor in self.given}

    def distance(self, start_s: float, end_s: float, turn: FloatArray | None = None) -> float | None:
        """Distance between two times [m], by an odometer.

        A lever arm needs the rotation start_from_end of the camera: that of a gyroscope, else `turn` (3, 3).
        """
        turn = self._turns_or_seen(start_s, end_s, turn)
        return _first_not_none(s.between(start_s, end_s, turn) for s in self.of_type(Odometer))

    def _turns_or_seen(self, start_s: float, end_s: float, seen: FloatArray | None) -> FloatArray | None:
        """Rotations (n, 3, 3) of the camera from the start to each of the stops on the way; else `seen`."""
        stops_s = stops_on_the_way(start_s, end_s)
        turns = [turn for stop_s in stops_s if (turn := self.rotation(start_s, stop_s)) is not None]
        return np.stack(turns) if len(turns) == len(stops_s) else seen

    def rotation(self, start_s: float, end_s: float) -> FloatArray | None:
        """Rotation (3, 3) start_from_end of the camera, by a gyroscope that agrees with the images."""
        agreeing = [s for s in self.of_type(Gyroscope) if s.name not in self.in_conflict]
        return _first_not_none(s.between(start_s, end_s) for s in agreeing)

    def centre(self, time_s: float, rotation: FloatArray) -> FloatArray | None:
        """Centre (3,) of the camera in the sensors' world [m], at the rotation (3, 3) world_from_camera."""
        return _first_not_none(s.at(time_s, rotation) for s in self.of_type(Gps))

    def pose(self, time_s: float) -> FloatArray | None:
        """Pose (3, 4) of the camera in the sensors' world, world_from_camera."""
        return _first_not_none(s.at(time_s) for s in self.of_type(Ins))


def has_rates(sensor: MotionSensor) -> TypeGuard[Gyroscope]:
    """Whether a sensor measures angular rates, which may have spikes and a bias."""
    return isinstance(sensor, Gyroscope) and sensor.stream.kind == "angular_rate"


def _without_bias(gyro: Gyroscope, bias: RateBias) -> Gyroscope:
    """The gyroscope without a bias, as one whose bias changes."""
    walk = max(gyro.drift_rad_sqrt_s, _WALK_RAD_SQRT_S)
    return replace(gyro, stream=without_bias(gyro.stream, bias), drift_rad_sqrt_s=walk)


def _first_not_none(answers: Iterable[_Answer | None]) -> _Answer | None:
    return next((answer for answer in answers if answer is not None), None)
