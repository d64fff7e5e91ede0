"""Faults of the sensors of a run, as sentences for its warnings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Gap, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import (
    MOST_TURNS,
    RateAxes,
    Turn,
    check_rotations,
    dead_stretches,
    describe_counter_leaps,
    describe_coverage,
    describe_gaps,
    describe_spikes,
    find_misalignment,
    find_rate_axes,
)
from sfmcpp.sensors.agreement import describe_other_time
from sfmcpp.sensors.bridged_gaps import LONGEST_BRIDGED_S
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.sensor_suite import SensorSuite, has_rates

# More stretches of a kind than this are described in one sentence.
_MOST_STRETCHES = 3


def faults_of_streams(sensors: SensorSuite) -> list[str]:
    """Faults that the streams show by themselves: gaps, what lacks, and values that jump as no motion can."""
    lacking = [
        f"stream {s.stream.name!r}: left out {s.stream.left_out}"
        for s in sensors.sensors
        if s.stream.left_out
    ]
    jumps = [found for odometer in sensors.of_type(Odometer) for found in _speed_jumps(odometer)]
    jumps += [found for s in sensors.sensors if isinstance(s, Gps | Ins) for found in s.remarks()]
    jumps += [found for s in sensors.given if has_rates(s) for found in describe_spikes(s.stream)]
    rule = f"the speed is interpolated over gaps of at most {LONGEST_BRIDGED_S:g} s"
    bridged = [f"stream {s.stream.name!r}: {rule}" for s in sensors.of_type(Odometer) if s.bridged_gaps]
    return lacking + describe_gaps([sensor.stream for sensor in sensors.sensors]) + bridged + jumps


def faults_of_epochs(sensors: SensorSuite, time_s: float) -> list[str]:
    """Streams that are more than a day from the first image, which is at `time_s` [s]."""
    return [found for s in sensors.given for found in describe_other_time(s.stream, time_s)]


def faults_of_coverage(sensors: SensorSuite, start_s: float, end_s: float) -> list[str]:
    """Streams that do not cover a run from `start_s` to `end_s` [s], or are too sparse for it."""
    return describe_coverage([sensor.stream for sensor in sensors.sensors], start_s, end_s)


def faults_so_far(sensors: SensorSuite) -> list[str]:
    """Faults that can be told during a run: biases, odometers that were dead lately, conflicts."""
    return _biased_and_dead(sensors, sensors.turns[-MOST_TURNS:]) + _conflicts(sensors)


def faults_of_run(sensors: SensorSuite, vision: Trajectory) -> list[str]:
    """Faults that a whole run shows: those so far, and clocks, units, axes and mountings.

    `vision` has the rotations of the camera by the images alone.
    """
    misread = misread_gyroscopes(sensors)
    rotations = [f"{name}: {axes.complaint}" for name, axes in misread.items()]
    rotations += [
        check_rotations(gyro.stream, gyro.mounting, vision).complaint(gyro.name)
        for gyro in sensors.of_type(Gyroscope)
        if gyro.name not in misread
    ]
    turned = [
        f"{name}: its directions differ by {np.degrees(so3.rotation_angle(turn)):.1f}° from those of the "
        "camera: check the declared mounting"
        for name, turn in misaligned_odometers(sensors).items()
    ]
    biased_and_dead = _biased_and_dead(sensors, sensors.turns)
    return biased_and_dead + turned + _conflicts(sensors) + [found for found in rotations if found]


def dead_odometers(sensors: SensorSuite, turns: Sequence[Turn]) -> dict[str, tuple[Gap, ...]]:
    """Where odometers stand still while pairs of images show a step, by name."""
    found = {odometer.name: dead_stretches(odometer.stream, turns) for odometer in sensors.of_type(Odometer)}
    return {name: stretches for name, stretches in found.items() if stretches}


def misaligned_odometers(sensors: SensorSuite) -> dict[str, FloatArray]:
    """Rotations (3, 3) of the camera against the mountings of odometers, where images determine them."""
    dead = dead_odometers(sensors, sensors.turns)
    steps = {
        odometer.name: _steps_and_directions(odometer, sensors.turns[-MOST_TURNS:])
        for odometer in sensors.of_type(Odometer)
        if odometer.name not in dead
    }
    return {name: turn for name, pair in steps.items() if (turn := find_misalignment(*pair)) is not None}


def misread_gyroscopes(sensors: SensorSuite) -> dict[str, RateAxes]:
    """Axes and units of gyroscopes as they were given, where images show others than the declared ones."""
    found = {
        s.name: find_rate_axes(s.stream, s.mounting, sensors.turns) for s in sensors.given if has_rates(s)
    }
    return {name: axes for name, axes in found.items() if axes is not None}


def has_wrong_axes(sensors: SensorSuite) -> bool:
    """Whether images contradict the mounting of an odometer, or the axes or the unit of a gyroscope."""
    return bool(misaligned_odometers(sensors) or misread_gyroscopes(sensors))


def _steps_and_directions(odometer: Odometer, turns: Sequence[Turn]) -> tuple[FloatArray, FloatArray]:
    """Steps (n, 3) of the camera by an odometer [m], and their directions (n, 3) by pairs of images."""
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


def _speed_jumps(odometer: Odometer) -> list[str]:
    """A sentence for each stretch in which the speed cannot be right; one for all of a kind if many."""
    told = f"stream {odometer.stream.name!r}: the speed"
    frozen = f"{told} repeats its last value and then leaps, as if frozen; "
    jumps = f"{told} jumps by more than a vehicle can; "
    stream = odometer.stream
    return [
        *(describe_counter_leaps(stream) if stream.kind == "distance" else []),
        *_sentences(frozen, odometer.frozen_stretches, odometer),
        *_sentences(jumps, odometer.jumping_stretches, odometer),
    ]


def _sentences(told: str, stretches: Sequence[Gap], odometer: Odometer) -> list[str]:
    if len(stretches) > _MOST_STRETCHES:
        rule = "they are bridged by inertia or get no weight"
        return [f"{told}in {len(stretches)} stretches, first {stretches[0]}, {rule}"]
    return [
        f"{told}{gap} it {'is bridged by inertia' if gap in odometer.carried_stretches else 'gets no weight'}"
        for gap in stretches
    ]


def _conflicts(sensors: SensorSuite) -> list[str]:
    return [found for name, known in sensors.experience.items() for found in known.describe(name)]


def _biased_and_dead(sensors: SensorSuite, turns: Sequence[Turn]) -> list[str]:
    known = sensors.biases.known.items()
    biases = [f"{name}: {bias.complaint}" for name, bias in known if name not in sensors.drifts]
    biases += [f"{name}: {drift.complaint}" for name, drift in sensors.drifts.items()]
    dead = dead_odometers(sensors, turns).items()
    return biases + [found for name, stretches in dead for found in _dead(name, stretches)]


def _dead(name: str, stretches: Sequence[Gap]) -> list[str]:
    told = [f"for {stretch}" for stretch in stretches]
    if len(stretches) > _MOST_STRETCHES:
        longest = max(stretches, key=lambda stretch: stretch.end_s - stretch.start_s)
        told = [f"in {len(stretches)} stretches, first {stretches[0]}, longest {longest}"]
    return [f"{name}: it does not move {where}, while the images do: is it dead?" for where in told]
