"""Consistency of streams that were measured on one body at the same time.

A unit that is wrong by a constant factor passes the limits of :class:`SensorStream` where the motion is slow:
36 km/h declared as m/s are plausible by themselves, but not beside a GPS, nor in a bend.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from itertools import combinations, pairwise

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import LONGEST_PAUSE_S
from sfmcpp.sensors.gps import local_positions
from sfmcpp.sensors.odometer import travelled_distance
from sfmcpp.sensors.speed_leaps import LARGEST_ACCELERATION_M_S2
from sfmcpp.sensors.stream import measured_at, segments

# Wrong units are factors of 3.6 and more; two fault-free sensors differ by less than this.
LARGEST_RATIO = 2.0
# Kinds of streams that measure a path, and rotations.
_PATHS = ("speed", "distance", "velocity", "position", "pose")
_ROTATIONS = ("angular_rate", "orientation", "pose")
# Motions are compared over stretches so short that a chord is about as long as its arc, in which one of the
# two sensors moves or turns by at least this; so many of them.
_STRETCH_S = 2.0
_LEAST_WAY_M = 10.0
_LEAST_TURN_RAD = float(np.deg2rad(5.0))
_FEWEST_STRETCHES, _MOST_STRETCHES = 3, 200
# No recording lasts for months [s].
LONGEST_S = 1e7
# A lateral acceleration is the median over a window of ten ticks, a second; so many seconds are computed at
# once.
_WINDOW, _TICK_S, _PIECE_S = 10, 0.1, 1e4
# Stamps above this count from 1970 [s]: if two are in different units, their ratio is one of these factors to
# a thousandth.
_EPOCH_S, _UNITS, _SAME_TIME = 1e8, (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9), 1e-3
# A recording of sensors and that of the images last equally long to this factor.
_ABOUT = 3.0

Measure = Callable[[SensorStream, float, float], float]


@checked()
def require_agreement(streams: Collection[SensorStream]) -> None:
    """Refuse streams of one body that cannot all be in the units they are declared in.

    Ways and rotations over stretches of two seconds must agree within a factor of two in the median,
    between any two streams that measure them; and no velocity may, with the angular rate, need more than
    `LARGEST_ACCELERATION_M_S2` across for a second; a speed is one along the body's x axis. A sensor that is
    wrong for a while passes: that is for its weight to tell.

    Parameters
    ----------
    streams : collection of SensorStream
        Of any kinds, on the same clock.

    Raises
    ------
    InvalidArgument
        Naming the two streams that disagree, by how much, and the units to look at; or a stream that lasts
        longer than `LONGEST_S`.
    """
    for stream in streams:
        _require_short(stream)
    local = [local_positions(stream) if stream.kind == "geodetic" else stream for stream in streams]
    _require_same_motion(local, _PATHS, _distance_between, _LEAST_WAY_M, "ways", "km/h, ft, mm or km")
    _require_same_motion(local, _ROTATIONS, _angle_between, _LEAST_TURN_RAD, "rotations", "degrees")
    for stream in local:
        for turning in local:
            if stream.kind in ("speed", "velocity") and turning.kind == "angular_rate":
                _require_drivable(stream, turning)


@checked()
def require_overlap(stream: SensorStream, first_s: float, last_s: float) -> None:
    """Refuse a stream that covers none of the time of the images: its stamps are on another clock.

    Parameters
    ----------
    stream : SensorStream
        Of any kind.
    first_s, last_s : float
        Times of the first and the last image [s].

    Raises
    ------
    InvalidArgument
        Naming both spans.
    """
    start_s, end_s = float(stream.t_s[0]), float(stream.t_s[-1])
    if start_s - stream.max_gap_s <= last_s and first_s <= end_s + stream.max_gap_s:
        return
    raise InvalidArgument(
        f"stream {stream.name!r} lasts from {start_s:.3f} to {end_s:.3f} s and the images from {first_s:.3f} "
        f"to {last_s:.3f} s: must overlap; {_unit_of_short(end_s - start_s, last_s - first_s)}"
        f"{_remedy(start_s, first_s)}"
    )


def describe_other_time(stream: SensorStream, time_s: float) -> list[str]:
    """A sentence if a stream is more than a day from an image at `time_s` [s]: its clock is another one."""
    start_s, end_s = float(stream.t_s[0]), float(stream.t_s[-1])
    if start_s - LONGEST_PAUSE_S <= time_s <= end_s + LONGEST_PAUSE_S:
        return []
    return [
        f"stream {stream.name!r} begins at {start_s:.3f} s, the images at {time_s:.3f} s: "
        f"{_remedy(start_s, time_s)}"
    ]


def _remedy(start_s: float, first_s: float) -> str:
    """What to do about a stream that starts at another time than the images [s]."""
    if max(abs(start_s), abs(first_s)) > _EPOCH_S and start_s * first_s > 0:
        for factor in _UNITS:
            ratio = start_s / first_s
            if abs(ratio / factor - 1) < _SAME_TIME:
                return (
                    f"its times are {factor:,.10g} times those of the images: check the units of both, as "
                    "[s], [ms], [us] or [ns] in a header"
                )
    return (
        f"are both on the same clock? A clock offset of {first_s - start_s:.6f} s (--clock-offset) lets them "
        "start together"
    )


def _unit_of_short(lasts_s: float, images_s: float) -> str:
    """A hint at the unit of times, if a stream is shorter than the images as one in another unit is."""
    for factor in _UNITS:
        if factor < 1 and images_s * factor / _ABOUT < lasts_s < images_s * factor * _ABOUT:
            return f"it lasts about {factor:g} times as long: check the unit of its times; "
    return ""


def _require_short(stream: SensorStream) -> None:
    lasts_s = float(stream.t_s[-1]) - float(stream.t_s[0])
    if lasts_s > LONGEST_S:
        raise InvalidArgument(
            f"stream {stream.name!r} lasts {lasts_s:.3g} s: must be at most {LONGEST_S:.0f} s; "
            "were its stamps given in ms, us or ns?"
        )


def _require_same_motion(
    streams: Sequence[SensorStream],
    kinds: tuple[str, ...],
    measure: Measure,
    least: float,
    what: str,
    hint: str,
) -> None:
    for one, other in combinations([s for s in streams if s.kind in kinds], 2):
        pairs = np.array(
            [[measure(s, *span) for s in (one, other)] for span in _common_stretches(one, other)]
        )
        pairs = pairs.reshape(-1, 2)[pairs.reshape(-1, 2).max(axis=1) >= least]
        if len(pairs) < _FEWEST_STRETCHES:
            continue
        with np.errstate(divide="ignore"):
            ratio = float(np.median(pairs[:, 0] / pairs[:, 1]))
        if not 1 / LARGEST_RATIO <= ratio <= LARGEST_RATIO:
            raise InvalidArgument(
                f"stream {one.name!r}: its {what} are {ratio:.3g} times those of stream {other.name!r}, must "
                f"be {1 / LARGEST_RATIO:g} to {LARGEST_RATIO:g} times; was one given in {hint}?"
            )


def _common_stretches(one: SensorStream, other: SensorStream) -> list[tuple[float, float]]:
    """Stretches that both cover, spread over the whole of the time they share."""
    start, end = max(one.t_s[0], other.t_s[0]), min(one.t_s[-1], other.t_s[-1])
    spans = list(pairwise(np.arange(start, end, _STRETCH_S).tolist()))
    some = spans[:: max(1, len(spans) // _MOST_STRETCHES)]
    return [span for span in some if one.covers(*span) and other.covers(*span)]


def _distance_between(stream: SensorStream, start_s: float, end_s: float) -> float:
    if stream.kind in ("position", "pose"):
        start, end = measured_at(stream, np.array([start_s, end_s]))[:, :3]
        return float(np.linalg.norm(end - start))
    return abs(travelled_distance(stream, start_s, end_s) or 0.0)


def _angle_between(stream: SensorStream, start_s: float, end_s: float) -> float:
    """Angle turned through: the mean rate times the time, so that several turns are not none."""
    if stream.kind == "angular_rate":
        middles_s, lengths_s = segments(start_s, end_s, stream)
        return float(np.linalg.norm(lengths_s @ measured_at(stream, middles_s)))
    ticks = np.linspace(start_s, end_s, round(_STRETCH_S / _TICK_S) + 1)
    rotations = so3.exp(measured_at(stream, ticks)[:, -3:])
    steps = so3.log(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])
    return float(np.linalg.norm(steps.sum(axis=0)))


def _require_drivable(speed: SensorStream, turning: SensorStream) -> None:
    """Refuse an acceleration across the motion that no body keeps up for a second."""
    start, end = max(speed.t_s[0], turning.t_s[0]), min(speed.t_s[-1], turning.t_s[-1])
    for begin in np.arange(start, end, _PIECE_S).tolist():
        times = np.arange(begin, min(begin + _PIECE_S + _WINDOW * _TICK_S, end), _TICK_S)
        if len(times) >= _WINDOW:
            _require_drivable_at(times, speed, turning)


def _require_drivable_at(times: FloatArray, speed: SensorStream, turning: SensorStream) -> None:
    velocity, rate = (measured_at(s, times) for s in (speed, turning))
    if speed.kind == "speed":
        velocity = velocity * [1.0, 0.0, 0.0]
    across = _accelerations(velocity, rate)
    for gap in (*speed.gaps(), *turning.gaps()):  # nothing was measured there
        across[(times > gap.start_s) & (times < gap.end_s)] = 0.0
    sustained = np.median(np.lib.stride_tricks.sliding_window_view(across, _WINDOW), axis=1)
    worst = int(np.argmax(sustained))
    if sustained[worst] > LARGEST_ACCELERATION_M_S2:
        pace, turn = (float(np.linalg.norm(values[worst])) for values in (velocity, rate))
        raise InvalidArgument(
            f"stream {speed.name!r} at {pace:.3g} m/s with stream {turning.name!r} at {turn:.3g} rad/s, at "
            f"{times[worst]:.3f} s: {sustained[worst]:.3g} m/s² across for a second, must be at most "
            f"{LARGEST_ACCELERATION_M_S2:g}; was one given in km/h or degrees/s?"
        )


def _accelerations(velocity: FloatArray, rate: FloatArray) -> FloatArray:
    """Accelerations (n,) that the turning of a body takes, of velocities and rates (n, 3) in its axes.

    None to lean, which turns about the motion; nor to spin while the velocity turns against the body, as a
    drone's does.
    """
    across = np.cross(rate, velocity)
    changes = np.gradient(velocity, _TICK_S, axis=0)
    return np.asarray(np.minimum(np.linalg.norm(across, axis=1), np.linalg.norm(across + changes, axis=1)))
