"""Checks of a sensor's rotations against the camera's: clock offset, unit, axes.

The rotation from one pose of the camera to the next is compared with the sensor's over the same interval,
moved by an offset of the clock. All three axes and a robust cost: among the noisy poses of a real run the
magnitudes of the rates do not correlate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.geometry.parabola import parabola_minimum
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_positive
from sfmcpp.sensors.inertial import rotations_at_samples
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.stream import clock_text, interpolate_rotations, is_coarse, require_kind
from sfmcpp.sensors.turn import Turn, rotations_of, times_of

# A clock offset with a larger standard deviation counts as unknown [s].
_LARGEST_SIGMA_S = 0.02
# Offsets up to this cost no accuracy that could be measured on real drives [s].
_TOLERATED_OFFSET_S = 0.1
# Fewest intervals between poses, and pairs of images, which are less noisy.
_FEWEST_INTERVALS = 16
_FEWEST_TURNS = 6
# The share of the intervals, those with the largest rotations, in which sensor and camera are compared: in
# the others the noise of the camera's poses is larger than the rotations.
_LARGEST_TURNS = 0.25
# Offsets are tried in steps of this [s].
_STEP_S = 0.01
_DEGREES = 180 / np.pi
# Rotations compared at a time, of all offsets and intervals.
_MOST_TOGETHER = 1 << 17
# Error over rotation: about √2 if axes are wrong, 1 if the sensor is noise only, less if it is right.
_WRONG, _RIGHT = 1.15, 0.5
# Smaller rotations of the camera from pose to pose may be the noise of its poses, and prove nothing.
_LEAST_TURN_RAD = float(np.radians(0.3))


@dataclass(frozen=True)
class RotationCheck:
    """How a sensor's rotations compare with those of the camera.

    Attributes
    ----------
    intervals : int
        Pairs of poses compared.
    offset_s : float
        What to add to the sensor's stamps [s]: the argument of :meth:`SensorStream.shifted`.
    sigma_s : float
        What `offset_s` may be off [s]: infinite where the rate never changes, or its samples are coarse: what
        they leave out looks like another clock.
    turned_rad : float
        Median rotation from pose to pose that the camera saw, where the sensor's are largest [rad].
    error_rad : float
        Median angle between the camera's rotation and the sensor's there [rad].
    unit_factor : float
        180/π or π/180 where the sensor's rates explain the camera's rotations only divided by it, else 1.
    """

    intervals: int
    offset_s: float = 0.0
    sigma_s: float = np.inf
    turned_rad: float = 0.0
    error_rad: float = 0.0
    unit_factor: float = 1.0

    @property
    def is_determined(self) -> bool:
        """Whether the offset of the clock is known."""
        return self.sigma_s <= _LARGEST_SIGMA_S

    @property
    def is_off(self) -> bool:
        """Whether the clock is known to be off by more than is tolerated."""
        return self.is_determined and abs(self.offset_s) > _TOLERATED_OFFSET_S + 2 * self.sigma_s

    @property
    def agrees(self) -> bool:
        """Whether at that offset the sensor's rotations explain those of the camera, as they are given."""
        return self.unit_factor == 1 and self.error_rad < _RIGHT * self.turned_rad

    @property
    def clock(self) -> str:
        """What the clock is, beside the camera's."""
        return clock_text(self.offset_s, self.sigma_s, "the camera's")

    def complaint(self, name: str) -> str:
        """The fault of the sensor of that name and its remedy; empty if none is found."""
        if self.unit_factor != 1:
            given, declared = ("degrees", "radians") if self.unit_factor > 1 else ("radians", "degrees")
            return (
                f"{name}: its rates are {self.unit_factor:.3g} times those of the camera: "
                f"{given} declared as {declared}?"
            )
        if self.turned_rad > _LEAST_TURN_RAD and self.error_rad > _WRONG * self.turned_rad:
            return (
                f"{name}: in the strongest turns its rotations differ by {np.degrees(self.error_rad):.2g}° "
                f"from those of the camera ({np.degrees(self.turned_rad):.2g}°): check the declared axes, "
                "mounting and unit"
            )
        return f"{name}: {self.clock}: add {self.offset_s:.2f} s to its stamps" if self.is_off else ""


@checked()
def check_rotations(
    stream: SensorStream, mounting: Mounting, vision: Trajectory, largest_offset_s: float = 0.5
) -> RotationCheck:
    """Compare a sensor's rotations with those between the poses of a camera.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``.
    mounting : Mounting
        How the camera sits on the body.
    vision : Trajectory
        Poses of the camera, of all frames of a run: those of keyframes alone are fewer and tell less. The
        sensor may have taken part in them.
    largest_offset_s : float
        Offsets from minus to plus this are tried [s].

    Returns
    -------
    RotationCheck
        It tells nothing where the stream covers fewer than sixteen of the intervals at every offset.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `largest_offset_s` is not positive.
    """
    require_kind(stream, "angular_rate", "orientation", "pose")
    require_positive("largest_offset_s", largest_offset_s)
    times = np.stack([vision.t_s[:-1], vision.t_s[1:]], axis=1)
    reach = np.array([-largest_offset_s, largest_offset_s])
    covered = np.array([stream.covers(*span) for span in times + reach], dtype=bool)
    seen = (np.swapaxes(vision.rotations[:-1], 1, 2) @ vision.rotations[1:])[covered]
    if len(seen) < _FEWEST_INTERVALS:
        return RotationCheck(len(seen))
    offsets = _offsets(largest_offset_s)
    factors = (1.0, _DEGREES, 1 / _DEGREES) if stream.kind == "angular_rate" else (1.0,)
    checks = [_compare_with_stream(stream, f, mounting, times[covered], seen, offsets) for f in factors]
    best = min(checks, key=_misfit)
    return best if _misfit(best) < _RIGHT * min(1.0, _misfit(checks[0])) else checks[0]


@checked()
def check_turns(
    stream: SensorStream, mounting: Mounting, turns: Sequence[Turn], largest_offset_s: float = 0.5
) -> RotationCheck:
    """Compare a sensor's rotations with those of pairs of images.

    They are fewer than those between poses, but independent of each other and of the map, which follows the
    sensor: six are enough where the rate changes. The unit is taken to be right.

    Parameters
    ----------
    stream, mounting, largest_offset_s
        See :func:`check_rotations`.
    turns : sequence of Turn
        Some of which may be wrong.

    Returns
    -------
    RotationCheck
        It tells nothing where the stream covers fewer than six at every offset.

    Raises
    ------
    InvalidArgument
        As :func:`check_rotations`.
    """
    require_kind(stream, "angular_rate", "orientation", "pose")
    require_positive("largest_offset_s", largest_offset_s)
    covered = [t for t in turns if stream.covers(t.start_s - largest_offset_s, t.end_s + largest_offset_s)]
    if len(covered) < _FEWEST_TURNS:
        return RotationCheck(len(covered))
    times, seen = times_of(covered), rotations_of(covered)
    return _compare_with_stream(stream, 1.0, mounting, times, seen, _offsets(largest_offset_s))


def _offsets(largest_s: float) -> FloatArray:
    steps = round(largest_s / _STEP_S)
    return np.linspace(-steps, steps, 2 * steps + 1) * _STEP_S


def _misfit(check: RotationCheck) -> float:
    return check.error_rad / check.turned_rad if check.turned_rad > 0 else np.inf


def _compare_with_stream(
    stream: SensorStream,
    factor: float,
    mounting: Mounting,
    times: FloatArray,
    seen: FloatArray,
    offsets: FloatArray,
) -> RotationCheck:
    """Compare a stream, its rates divided by `factor`, with rotations (n, 3, 3) between `times` (n, 2)."""
    absolute = _rotations_about(stream, times, offsets, factor)
    errors = np.empty((len(offsets), len(seen), 3))
    for some in _pieces(len(offsets), len(seen)):
        turns = _turns_of(absolute, mounting, times, offsets[some])
        errors[some] = so3.log(np.swapaxes(seen, 1, 2) @ turns)
    best, offset_s, sigma_s = _best_offset(errors, offsets)
    if is_coarse(stream):
        sigma_s = np.inf
    claimed = so3.rotation_angle(_turns_of(absolute, mounting, times, offsets[best : best + 1])[0])
    largest = claimed >= np.quantile(claimed, 1 - _LARGEST_TURNS)
    turned, error = (float(np.median(so3.rotation_angle(r[largest]))) for r in (seen, so3.exp(errors[best])))
    return RotationCheck(len(seen), offset_s, sigma_s, turned, error, factor)


def turns_at_offsets(
    stream: SensorStream, mounting: Mounting, times: FloatArray, offsets: FloatArray, factor: float = 1.0
) -> FloatArray:
    """Rotations (offsets, n, 3, 3) of the camera between `times` (n, 2), each offset added to the stamps."""
    return _turns_of(_rotations_about(stream, times, offsets, factor), mounting, times, offsets)


def _pieces(offsets: int, intervals: int) -> list[slice]:
    """Offsets compared together: a run of an hour has 40,000 intervals, with 290 MB of matrices."""
    count = max(1, _MOST_TOGETHER // intervals)
    return [slice(first, first + count) for first in range(0, offsets, count)]


def _rotations_about(
    stream: SensorStream, times: FloatArray, offsets: FloatArray, factor: float
) -> tuple[FloatArray, FloatArray]:
    """Stamps (n,) about some times, and the rotations (n, 3, 3) start_from_body there."""
    reach_s = np.abs(offsets).max() + stream.max_gap_s
    first = np.searchsorted(stream.t_s, times.min() - reach_s, side="left")
    last = np.searchsorted(stream.t_s, times.max() + reach_s, side="right")
    stream = stream.only(slice(first, last))
    return stream.t_s, rotations_at_samples(stream, 1 / factor)


def _turns_of(
    absolute: tuple[FloatArray, FloatArray], mounting: Mounting, times: FloatArray, offsets: FloatArray
) -> FloatArray:
    """Rotations (offsets, n, 3, 3) of the camera, as :func:`turns_at_offsets`."""
    shifted = times - offsets[:, None, None]
    start, end = (interpolate_rotations(*absolute, shifted[..., k].ravel()) for k in (0, 1))
    return mounting.camera_rotation(np.swapaxes(start, 1, 2) @ end).reshape(len(offsets), -1, 3, 3)


def _best_offset(errors: FloatArray, offsets: FloatArray) -> tuple[int, float, float]:
    """Row of the best offset by Cauchy's loss, the offset itself between the rows, its deviation [s].

    `errors` (offsets, n, 3) are rotation vectors [rad].
    """
    angles = np.linalg.norm(errors, axis=2)
    # Without any noise all weights would be one or zero.
    scale = max(float(np.median(angles, axis=1).min()), 1e-6)
    cost = np.log1p((angles / scale) ** 2).sum(axis=1)
    best = int(np.argmin(cost))
    if not 0 < best < len(offsets) - 1:
        return best, float(offsets[best]), np.inf
    slope = (errors[best + 1] - errors[best - 1]) / (offsets[best + 1] - offsets[best - 1])
    weight = 1 / (1 + (angles[best] / scale) ** 2)
    information = float(weight @ (slope**2).sum(axis=1))
    variance = float(weight @ angles[best] ** 2) / (3 * weight.sum())
    vertex, _ = parabola_minimum(*cost[best - 1 : best + 2])
    sigma = np.sqrt(variance / information) if information > 0 else np.inf
    return best, float(offsets[best] + _STEP_S * vertex), float(sigma)
