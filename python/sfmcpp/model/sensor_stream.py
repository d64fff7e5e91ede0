"""The measurements of one sensor over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, require_increasing, shaped_array
from sfmcpp.model.checks import require_not_negative
from sfmcpp.model.sensor_kinds import Limit, SensorKind, sensor_kind

# A gap of up to this many usual periods is bridged unless the stream says otherwise.
BRIDGED_PERIODS = 5.0


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
        return f"{self.end_s - self.start_s:.3f} s from {self.start_s:.3f} to {self.end_s:.3f} s"


@dataclass(frozen=True, eq=False)
class SensorStream:
    """Time-stamped measurements of one sensor, checked once.

    Unordered or duplicate stamps, numbers that are not finite and units that cannot be right are errors. Gaps
    are none: one of at most `max_gap_s` is bridged by interpolation, a longer one gives no measurement for
    any interval that touches it (see :meth:`gaps`, :meth:`covers`).

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

    def __post_init__(self) -> None:
        kind = sensor_kind(self.kind)
        check_fields(self, "name")
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

    def gaps(self) -> tuple[Gap, ...]:
        """All stretches between samples longer than `max_gap_s`."""
        long = np.flatnonzero(np.diff(self.t_s) > self.max_gap_s)
        return tuple(Gap(float(self.t_s[i]), float(self.t_s[i + 1])) for i in long)

    def covers(self, start_s: float, end_s: float) -> bool:
        """Whether the whole of [`start_s`, `end_s`] is measured, bridged or predicted."""
        first, last = self.t_s[0] - self.max_gap_s, self.t_s[-1] + self.max_gap_s
        if not first <= start_s <= end_s <= last:
            return False
        return not any(gap.start_s < end_s and start_s < gap.end_s for gap in self.gaps())

    def shifted(self, clock_offset_s: float) -> SensorStream:
        """The same measurements with `clock_offset_s` added to every stamp: camera time − sensor time."""
        if not np.isfinite(clock_offset_s):
            raise InvalidArgument(f"clock_offset_s = {clock_offset_s}: must be finite")
        return replace(self, t_s=self.t_s + clock_offset_s)

    def extended(self, t_s: FloatArray, values: FloatArray) -> SensorStream:
        """These measurements and later ones; the default of `max_gap_s` is that of all of them."""
        given = self.max_gap_s != BRIDGED_PERIODS * self.period_s
        stamps = np.concatenate([self.t_s, finite_array("t_s", t_s, (ANY,))])
        more = shaped_array("values", _columns(values, self.values.shape[1]), (ANY, self.values.shape[1]))
        rows = np.concatenate([self.values, more])
        largest = {} if given else {"max_gap_s": None}
        return replace(self, t_s=stamps, values=rows, **largest)  # type: ignore[arg-type]

    def without(self, stretch: Gap) -> SensorStream | None:
        """Leave out the measurements of a stretch, both ends included; None if none are left."""
        kept = (self.t_s < stretch.start_s) | (self.t_s > stretch.end_s)
        return replace(self, t_s=self.t_s[kept], values=self.values[kept]) if kept.any() else None

    def __repr__(self) -> str:
        span = f"{self.t_s[0]:.3f} to {self.t_s[-1]:.3f} s"
        return f"SensorStream({self.name!r}: {len(self)} of {self.kind}, {span}, {len(self.gaps())} gaps)"


def _columns(given: FloatArray, width: int) -> FloatArray:
    """A row of numbers as a column, where there is one."""
    return np.reshape(given, (-1, 1)) if width == 1 and np.ndim(given) == 1 else given


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
