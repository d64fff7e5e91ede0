"""Frozen odometers: one that repeats its last value while the body goes on at another speed."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sensors.speed_leaps import STANDING_M_S
from sfmcpp.sensors.stream import repeats, require_kind, rows_of_repeats

# A value that is repeated for less time moves the body little, whatever its speed is [s].
_LEAST_S = 0.5
# Values on a coarse grid and those of a logger are repeated at more than this share of the samples; at least
# so many others must show that these are not. Among them such a row may come by chance with this probability.
_MOST_REPEATED, _FEWEST_OTHERS, _CHANCE = 0.2, 20, 1e-3
# After it the value leaps by so many of the largest usual changes (this quantile of them).
_LEAP, _USUAL = 3.0, 0.99
# Without a value after it, the others must scatter: without noise a speed may be constant to the last digit.
# Of white noise the medians of second and first differences have the ratio 1.7, of smooth speeds nearly zero.
_SCATTER = 0.5


@checked()
def frozen_stretches(stream: SensorStream) -> tuple[Gap, ...]:
    """Stretches in which the last value is repeated though the body has another speed at their end.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"speed"`` or ``"velocity"``.

    Returns
    -------
    tuple of Gap
        From the last sample that was measured to the first that is again; beyond the stream where none is.
        Empty where the samples are often repeated, as those on a coarse grid, or those of a logger.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "speed", "velocity")
    begins, following = rows_of_repeats(stream.values)
    held_s = stream.t_s[following - 1] - stream.t_s[begins]
    moving = np.linalg.norm(stream.values, axis=1) > STANDING_M_S
    long = np.flatnonzero((held_s >= _LEAST_S) & moving[begins])
    if not len(long):
        return ()
    within = np.zeros(len(stream), dtype=bool)
    for k in long:
        within[begins[k] + 1 : following[k]] = True
    others = _Others(stream.values, repeats(stream.values), moving & ~within)
    frozen = [(begins[k], following[k]) for k in long if others.rule_out(begins[k], following[k])]
    return tuple(_gap(stream, first, end) for first, end in frozen)


def _gap(stream: SensorStream, first: int, end: int) -> Gap:
    after_s = stream.t_s[end] if end < len(stream) else stream.t_s[-1] + stream.max_gap_s
    return Gap(float(stream.t_s[first]), float(after_s))


class _Others:
    """What the samples of a stream do outside of rows of equal ones.

    `values` (n, k) are the samples, `same` (n,) those that repeat the one before, `counted` (n,) the others.
    """

    def __init__(self, values: FloatArray, same: BoolArray, counted: BoolArray) -> None:
        self._values, self._count = values, int(np.count_nonzero(counted))
        self._repeated = float(np.mean(same[counted])) if self._count else 1.0
        steps = np.linalg.norm(np.diff(values, axis=0), axis=1)[counted[1:] & counted[:-1]]
        bends = np.linalg.norm(np.diff(values, 2, axis=0), axis=1)[counted[2:] & counted[1:-1] & counted[:-2]]
        enough = len(bends) > 0
        self._usual = float(np.quantile(steps, _USUAL)) if enough else np.inf
        self._scatters = enough and float(np.median(bends)) > _SCATTER * float(np.median(steps))

    def rule_out(self, first: int, end: int) -> bool:
        """Whether equal samples from `first` to before `end` cannot have been measured."""
        if self._count < _FEWEST_OTHERS or self._repeated > _MOST_REPEATED:
            return False
        share = max(self._repeated, 1 / self._count)
        if self._count * share ** (end - first - 1) > _CHANCE:
            return False
        if end == len(self._values):
            return self._scatters
        return bool(np.linalg.norm(self._values[end] - self._values[first]) > _LEAP * self._usual)
