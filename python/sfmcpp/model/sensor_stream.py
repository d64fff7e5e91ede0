"""Measurements of one sensor over time, and the kinds of sensors: columns, units, plausible limits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import (
    ANY,
    BoolArray,
    FloatArray,
    finite_array,
    number_array,
    require_increasing,
    shaped_array,
)
from sfmcpp.model.checks import looked_up, require_near, require_not_negative

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
_POSITION = ("x [m]", "y [m]", "z [m]")
_ROTATION = ("rx [rad]", "ry [rad]", "rz [rad]")
# Kinds of stream that each sensor of a drive can use, the best first.
SENSORS: dict[str, tuple[str, ...]] = {
    "odometer": ("distance", "speed", "velocity"),
    "imu": ("angular_rate", "orientation"),
    "ins": ("pose",),
    "gps": ("position", "geodetic"),
}
# A gap of up to this many usual periods is bridged unless the stream says otherwise.
BRIDGED_PERIODS = 5.0
# Rounded stamps make a difference of two, and as many usual periods, wrong by less than so many last digits.
_ROUNDING = 16


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
        with np.errstate(over="ignore", invalid="ignore"):  # so late that a second later is the same number
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


class ImplausibleSample(InvalidArgument):
    """A measurement that no sensor in the declared unit makes.

    Parameters
    ----------
    message : str
        What is wrong.
    sample : int
        Row of the sample in its stream.
    """

    def __init__(self, message: str, sample: int) -> None:
        super().__init__(message)
        self.sample = sample


@dataclass(frozen=True)
class Gap:
    """A stretch without samples that is too long to be bridged.

    Attributes
    ----------
    start_s, end_s : float
        Stamps of the last sample before it and of the first one after it [s].
    """

    start_s: float
    end_s: float

    def __str__(self) -> str:
        # A little before zero, "-0.000" would look like a fault of its own.
        start_s, end_s = (round(time_s, 3) + 0.0 for time_s in (self.start_s, self.end_s))
        return f"{self.end_s - self.start_s:.3f} s from {start_s:.3f} to {end_s:.3f} s"


@dataclass(frozen=True, eq=False)
class SensorStream:
    """Time-stamped measurements of one sensor, checked once.

    Unordered or duplicate stamps, numbers that are not finite and units that cannot be right are errors. Gaps
    are none: one of at most `max_gap_s` is bridged by interpolation, a longer one gives no measurement for
    any interval that touches it (see :meth:`gaps`, :meth:`covers`). Over some of these an odometer
    interpolates its speed, with a larger standard deviation (:class:`sfmcpp.slam.Odometer`).

    Parameters
    ----------
    t_s : (n,) float64
        Time stamps [s], strictly increasing, n ≥ 1, on the camera's clock (see :meth:`shifted`).
    values : (n, k) float64
        Measurements; k and the units are those of the kind. (n,) will do where k is 1.
    kind : str
        ``"speed"`` [m/s], ``"distance"`` (travelled so far) [m], ``"velocity"`` (3, body) [m/s],
        ``"angular_rate"`` (3, body) [rad/s], ``"orientation"`` (rotation vector world_from_body) [rad],
        ``"position"`` [m], ``"pose"`` (position [m], then rotation vector [rad]) or ``"geodetic"`` (latitude,
        longitude [deg], height [m]).
    name : str
        What to call it in messages. Default: its kind.
    max_gap_s : float, optional
        Longest gap that is bridged, and how far beyond either end the motion is predicted [s]. Default: five
        times the median period.
    left_out : str, optional
        What the reader of a file left out of it, in words; a warning of every run that uses the stream.

    Raises
    ------
    InvalidArgument
        If any of this does not hold; the message names the stream, the sample and its time. Where a value is
        implausible it is an :class:`ImplausibleSample`.
    """

    t_s: FloatArray
    values: FloatArray
    kind: str
    name: str = ""
    max_gap_s: float = None  # type: ignore[assignment]
    left_out: str = ""

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            t_s: ArrayLike,
            values: ArrayLike,
            kind: str,
            name: str = "",
            max_gap_s: float | None = None,
            left_out: str = "",
        ) -> None: ...

    def __post_init__(self) -> None:
        kind = sensor_kind(self.kind)
        check_fields(self, "name", "left_out")
        object.__setattr__(self, "name", self.name or self.kind)
        try:
            self._check(kind)
        except ImplausibleSample as error:
            raise ImplausibleSample(f"stream {self.name!r}: {error}", error.sample) from None
        except InvalidArgument as error:
            raise InvalidArgument(f"stream {self.name!r}: {error}") from None

    def _check(self, kind: SensorKind) -> None:
        stamps = finite_array("t_s", self.t_s, (ANY,))
        if not len(stamps):
            raise InvalidArgument("t_s: there is no sample, must be at least one")
        require_increasing("t_s", stamps)
        object.__setattr__(self, "t_s", stamps)
        object.__setattr__(self, "values", _values(self.values, stamps, kind))
        for limit in kind.limits:
            _require_plausible(limit, stamps, self.values)
        if self.max_gap_s is None:
            object.__setattr__(self, "max_gap_s", BRIDGED_PERIODS * self.period_s)
        require_not_negative("max_gap_s", self.max_gap_s)

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def period_s(self) -> float:
        """Median time between samples [s]; 0 for a single one."""
        return float(np.median(np.diff(self.t_s))) if len(self.t_s) > 1 else 0.0

    @property
    def _rounding_s(self) -> float:
        """By how much rounded stamps may seem farther apart than they are: seconds since 1970 are coarse."""
        return _ROUNDING * float(np.spacing(np.abs(self.t_s[[0, -1]]).max()))

    @property
    def _has_default_gap(self) -> bool:
        return self.max_gap_s == BRIDGED_PERIODS * self.period_s

    def gaps(self) -> tuple[Gap, ...]:
        """All stretches between samples longer than `max_gap_s`."""
        return self._gaps

    @cached_property
    def _gaps(self) -> tuple[Gap, ...]:
        long = np.flatnonzero(np.diff(self.t_s) > self.max_gap_s + self._rounding_s)
        return tuple(Gap(float(self.t_s[i]), float(self.t_s[i + 1])) for i in long)

    def covers(self, start_s: float, end_s: float) -> bool:
        """Whether the whole of [`start_s`, `end_s`] is measured, bridged or predicted."""
        rounding_s = self._rounding_s
        beyond_s = self.max_gap_s + rounding_s
        if not self.t_s[0] - beyond_s <= start_s <= end_s <= self.t_s[-1] + beyond_s:
            return False
        return not any(
            gap.start_s + rounding_s < end_s and start_s < gap.end_s - rounding_s for gap in self.gaps()
        )

    def shifted(self, clock_offset_s: float) -> SensorStream:
        """The same measurements with `clock_offset_s` added to every stamp: camera time − sensor time."""
        if not np.isfinite(clock_offset_s):
            raise InvalidArgument(f"clock_offset_s = {clock_offset_s}: must be finite")
        largest = {"max_gap_s": None} if self._has_default_gap else {}
        return replace(self, t_s=self.t_s + clock_offset_s, **largest)  # type: ignore[arg-type]

    def extended(self, t_s: ArrayLike, values: ArrayLike) -> SensorStream:
        """These measurements and later ones; the default of `max_gap_s` is that of all of them.

        InvalidArgument if one comes more than a day after the one before: its unit is another.
        """
        stamps = np.concatenate([self.t_s, finite_array("t_s", t_s, (ANY,))])
        for before_s, after_s in pairwise(stamps[len(self) - 1 :].tolist()):
            require_near(f"stream {self.name!r}: t_s", before_s, after_s)
        more = shaped_array("values", _columns(values, self.values.shape[1]), (ANY, self.values.shape[1]))
        rows = np.concatenate([self.values, more])
        largest = {"max_gap_s": None} if self._has_default_gap else {}
        return replace(self, t_s=stamps, values=rows, **largest)  # type: ignore[arg-type]

    def without(self, stretch: Gap) -> SensorStream | None:
        """Leave out the measurements of a stretch, both ends included; None if none are left."""
        kept = (self.t_s < stretch.start_s) | (self.t_s > stretch.end_s)
        return self.only(kept) if kept.any() else None

    def only(self, kept: BoolArray | slice) -> SensorStream:
        """The measurements where `kept`, (n,) bool, is true, or those of a slice; at least one must be."""
        return replace(self, t_s=self.t_s[kept], values=self.values[kept])

    def __repr__(self) -> str:
        span = f"{self.t_s[0]:.3f} to {self.t_s[-1]:.3f} s"
        return f"SensorStream({self.name!r}: {len(self)} of {self.kind}, {span}, {len(self.gaps())} gaps)"


def _columns(given: ArrayLike, width: int) -> ArrayLike:
    """A row of numbers as a column, where there is one."""
    values = number_array("values", given)
    return values.reshape(-1, 1) if width == 1 and values.ndim == 1 else given


def _values(given: FloatArray, stamps: FloatArray, kind: SensorKind) -> FloatArray:
    width = len(kind.columns)
    values = shaped_array("values", _columns(given, width), (len(stamps), width))
    bad = ~np.isfinite(values)
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise InvalidArgument(
            f"{kind.columns[column]} of sample {row}, at {stamps[row]:.6f} s, is {values[row, column]}: "
            f"must be finite ({np.count_nonzero(bad.any(axis=1))} of {len(stamps)} samples are not); "
            "leave out samples that are missing"
        )
    return values


def _require_plausible(limit: Limit, stamps: FloatArray, values: FloatArray) -> None:
    with np.errstate(over="ignore"):
        magnitude, row = limit.measure(stamps, values)
    if magnitude > limit.largest:
        raise ImplausibleSample(
            f"{limit.what} of {magnitude:.6g} {limit.unit} at sample {row}, at {stamps[row]:.6f} s: "
            f"must be at most {limit.largest:.6g} {limit.unit}; was it given in {limit.hint}?",
            row,
        )
