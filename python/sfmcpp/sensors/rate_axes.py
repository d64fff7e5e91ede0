"""Angular rates in other axes or another unit than declared, by the rotations of pairs of images.

A file in which turns to the right are positive, whose columns are those of other axes, or whose degrees are
called radians agrees with the images once it is read as it was meant. Few ways to mean it are usual: any
order and signs of the three axes, in radians or degrees.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.sensor_stream import FASTEST_RAD_S
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.rate_bias import LARGEST_RAD_S, cauchy_loss, constant_rate, durations_s, error_scale
from sfmcpp.sensors.stream import require_kind
from sfmcpp.sensors.turn import CLOCK_OFFSETS_S, Turn, rotations_of, times_of

# Fewest pairs of images, and most, which are spread over the run.
_FEWEST, _MOST = 6, 256
# By how much other axes must be likelier than the declared ones, whatever the clock or a bias, and than a
# stream that tells nothing. Of thirteen fault-free parts and changes of 0001, 0027, 0036 and 0039 none came
# to 0.3, nor did those with clocks half a second off, biases of 5°/s, or mountings turned by 15°; reversed,
# permuted and in degrees all but those of 0027, where the road is straight, came to 15 to 350.
_GAIN = 12.0
_DEGREES = 180 / np.pi
_NAMES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class RateAxes:
    """How angular rates must be read.

    Attributes
    ----------
    axes : (3, 3) float64
        Of the body, by the axes as given: 1, −1 and 0.
    factor : float
        What the rates are divided by: 1, 180/π where degrees are declared as radians, π/180 where radians are
        as degrees.
    """

    axes: FloatArray
    factor: float = 1.0

    @property
    def is_as_declared(self) -> bool:
        """Whether nothing is wrong."""
        return self.factor == 1 and bool(np.array_equal(self.axes, np.eye(3)))

    @property
    def complaint(self) -> str:
        """A clause that names the fault."""
        return " and ".join(filter(None, (self._unit_text, self._axes_text)))

    @property
    def _unit_text(self) -> str:
        if self.factor == 1:
            return ""
        given, declared = ("degrees", "radians") if self.factor > 1 else ("radians", "degrees")
        return f"its rates are {self.factor:.3g} times those of the camera: {given} declared as {declared}?"

    @property
    def _axes_text(self) -> str:
        if np.array_equal(self.axes, np.eye(3)):
            return ""
        if np.array_equal(self.axes, -np.eye(3)):
            return "its rates have the opposite sign of the camera's: are turns to the right positive?"
        signs = np.diag(self.axes)
        if signs.all():
            which = " and ".join(name for name, sign in zip(_NAMES, signs, strict=True) if sign < 0)
            return f"its rates about {which} have the opposite sign of the camera's: check the declared axes"
        rows = np.abs(self.axes).argmax(axis=0)
        meant = [("−" if self.axes[row, k] < 0 else "") + _NAMES[row] for k, row in enumerate(rows)]
        return (
            f"its rates wx, wy, wz are those about {', '.join(meant)} of the body by the images: check the "
            "declared axes and mounting"
        )


@checked()
def find_rate_axes(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> RateAxes | None:
    """Find the axes and the unit in which angular rates explain the rotations of pairs of images.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    mounting : Mounting
        How the camera sits on the body.
    turns : sequence of Turn
        Of a whole run, some of which may be wrong.

    Returns
    -------
    RateAxes or None
        None where the declared ones are right, for all that the turns show: fewer than six that the stream
        covers with a second on both sides, or rotations that the declared axes with another clock or a bias,
        or no rates at all, explain about as well.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    reach_s = float(CLOCK_OFFSETS_S[-1])
    covered = [turn for turn in turns if stream.covers(turn.start_s - reach_s, turn.end_s + reach_s)]
    some = covered[:: max(1, len(covered) // _MOST)]
    if len(some) < _FEWEST:
        return None
    # Rotation vectors of small turns are integrals of rates, in any axes and unit.
    told = _integrals(stream, times_of(some) - CLOCK_OFFSETS_S[:, None, None])
    seen = so3.log(rotations_of(some)) @ mounting.camera_from_body
    ways = list(_ways(float(np.abs(stream.values).max())))
    lefts = [_left_at_best_clock(seen, told, way) for way in ways]
    best = int(np.argmin([np.median(left) for left in lefts]))
    scale = error_scale(lefts[best])
    losses = [float(cauchy_loss(left, scale)) for left in lefts]
    best = int(np.argmin(losses))
    others = [*_by_declared(seen, told, durations_s(some)), np.linalg.norm(seen, axis=1)]
    least = min(float(cauchy_loss(left, scale)) for left in others)
    return None if ways[best].is_as_declared or losses[best] > least - _GAIN else ways[best]


@checked()
def with_axes(stream: SensorStream, axes: RateAxes) -> SensorStream:
    """The stream as it must be read.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    axes : RateAxes
        What its axes and its unit are.

    Returns
    -------
    SensorStream
        In the axes of the body and in rad/s.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    return replace(stream, values=stream.values @ axes.axes.T / axes.factor)


def _ways(largest: float) -> Iterator[RateAxes]:
    """All orders and signs of the axes in either unit, without those that no gyroscope can measure."""
    for factor in (1.0, _DEGREES, 1 / _DEGREES):
        if factor >= 1 or largest / factor <= FASTEST_RAD_S:
            for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
                yield RateAxes(np.diag(signs) @ np.eye(3)[list(order)], factor)


def _integrals(stream: SensorStream, times_s: FloatArray) -> FloatArray:
    """Integrals (…, 3) of the rates between times (…, 2) [rad]."""
    steps = 0.5 * (stream.values[1:] + stream.values[:-1]) * np.diff(stream.t_s)[:, None]
    whole = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    at = np.stack([np.interp(times_s, stream.t_s, column) for column in whole.T], axis=-1)
    return np.asarray(at[..., 1, :] - at[..., 0, :])


def _left_at_best_clock(seen: FloatArray, told: FloatArray, way: RateAxes) -> FloatArray:
    """Lengths (n,) of what is left of rotation vectors (n, 3) at the best of the offsets (k, n, 3)."""
    lefts = np.linalg.norm(seen - told @ way.axes.T / way.factor, axis=2)
    return np.asarray(lefts[int(np.argmin(np.median(lefts, axis=1)))])


def _by_declared(seen: FloatArray, told: FloatArray, lengths_s: FloatArray) -> Iterator[FloatArray]:
    """Lengths (n,) of what the axes as declared leave: at each clock offset, and with a bias."""
    yield from np.linalg.norm(seen - told, axis=2)
    errors = seen - told[len(told) // 2]
    rate, _ = constant_rate(errors, lengths_s)
    if np.linalg.norm(rate) <= LARGEST_RAD_S:
        yield np.linalg.norm(errors - lengths_s[:, None] * rate, axis=1)
