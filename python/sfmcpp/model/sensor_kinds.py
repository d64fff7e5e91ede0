"""The kinds of measurements a sensor stream can hold: columns, units, and what is physically plausible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import looked_up

# Faster than any road vehicle or train the package is meant for.
FASTEST_M_S = 100.0
# Just above ±2000 °/s, the widest range of common MEMS gyroscopes.
FASTEST_RAD_S = 35.0
# Ways are judged over as long [s]: from sample to sample the noise of a fast sensor is a speed of its own.
_PACE_OVER_S = 1.0
# The longest rotation vector that is not a repetition.
FULL_TURN_RAD = 2 * np.pi

# The largest magnitude found, of stamps and values, and the row it belongs to.
Measure = Callable[[FloatArray, FloatArray], tuple[float, int]]


@dataclass(frozen=True)
class Limit:
    """A magnitude that no sensor in the right unit exceeds.

    Attributes
    ----------
    what : str
        What is measured, for messages.
    largest : float
        Largest plausible magnitude.
    unit : str
        Its unit.
    hint : str
        The wrong unit that is most often behind a larger one.
    measure : callable
        Magnitude and row at fault, from stamps (n,) [s] and values (n, k).
    """

    what: str
    largest: float
    unit: str
    hint: str
    measure: Measure


@dataclass(frozen=True)
class SensorKind:
    """One kind of measurement.

    Attributes
    ----------
    name : str
        Its name.
    columns : tuple of str
        Meaning and unit of each column of the values.
    limits : tuple of Limit
        What is checked of each stream of this kind.
    """

    name: str
    columns: tuple[str, ...]
    limits: tuple[Limit, ...]


def _largest_norm(columns: slice) -> Measure:
    def measure(_: FloatArray, values: FloatArray) -> tuple[float, int]:
        norms = np.linalg.norm(values[:, columns], axis=1)
        row = int(np.argmax(norms))
        return float(norms[row]), row

    return measure


def _median_pace(columns: slice) -> Measure:
    """Median speed over a second, where there is motion: one leap is an outlier, not a wrong unit."""

    def measure(t_s: FloatArray, values: FloatArray) -> tuple[float, int]:
        later = np.searchsorted(t_s, t_s + _PACE_OVER_S)
        first = np.flatnonzero(later < len(t_s))
        if not len(first):
            first = np.arange(min(1, len(t_s) - 1))
        last = np.minimum(later[first], len(t_s) - 1)
        with np.errstate(over="ignore"):
            ways = values[last, columns] - values[first, columns]
            pace = np.linalg.norm(ways, axis=1) / (t_s[last] - t_s[first])
        moving = pace[pace > 0]
        if not len(moving):
            return 0.0, 0
        median = float(np.median(moving))
        return median, int(first[np.argmax(pace >= median)])

    return measure


_SPEED = Limit("speed", FASTEST_M_S, "m/s", "km/h, mm/s", _largest_norm(slice(0, 3)))
_RATE = Limit("angular rate", FASTEST_RAD_S, "rad/s", "degrees/s", _largest_norm(slice(0, 3)))
_PACE = Limit("median speed over a second", FASTEST_M_S, "m/s", "mm, cm, km", _median_pace(slice(0, 3)))
_TURN = Limit("rotation vector", FULL_TURN_RAD, "rad", "degrees", _largest_norm(slice(0, 3)))
_POSE_TURN = Limit("rotation vector", FULL_TURN_RAD, "rad", "degrees", _largest_norm(slice(3, 6)))
_LATITUDE = Limit("latitude", 90.0, "deg", "metres, or are its columns swapped", _largest_norm(slice(0, 1)))
_LONGITUDE = Limit("longitude", 360.0, "deg", "metres", _largest_norm(slice(1, 2)))

_POSITION = ("x [m]", "y [m]", "z [m]")
_ROTATION = ("rx [rad]", "ry [rad]", "rz [rad]")

SENSOR_KINDS: dict[str, SensorKind] = {
    kind.name: kind
    for kind in (
        SensorKind("speed", ("speed [m/s]",), (_SPEED,)),
        SensorKind("distance", ("travelled distance [m]",), (_PACE,)),
        SensorKind("velocity", ("vx [m/s]", "vy [m/s]", "vz [m/s]"), (_SPEED,)),
        SensorKind("angular_rate", ("wx [rad/s]", "wy [rad/s]", "wz [rad/s]"), (_RATE,)),
        SensorKind("orientation", _ROTATION, (_TURN,)),
        SensorKind("position", _POSITION, (_PACE,)),
        SensorKind("pose", _POSITION + _ROTATION, (_PACE, _POSE_TURN)),
        SensorKind("geodetic", ("latitude [deg]", "longitude [deg]", "height [m]"), (_LATITUDE, _LONGITUDE)),
    )
}

# Kinds of stream that each sensor of a drive can use, the best first.
SENSORS: dict[str, tuple[str, ...]] = {
    "odometer": ("distance", "speed", "velocity"),
    "imu": ("angular_rate", "orientation"),
    "ins": ("pose",),
    "gps": ("position", "geodetic"),
}


def sensor_kind(name: str) -> SensorKind:
    """Look a kind of measurement up by name.

    Parameters
    ----------
    name : str
        One of the keys of `SENSOR_KINDS`.

    Returns
    -------
    SensorKind
        Its columns and limits.

    Raises
    ------
    InvalidArgument
        If there is no kind of that name.
    """
    return looked_up("kind", name, SENSOR_KINDS)
