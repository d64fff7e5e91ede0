"""Resolution of an odometer: the step of its values, and how often they are measured anew.

Encoders count ticks, buses carry speeds in steps of 1 km/h, and loggers repeat the last value until there is
a new one: changes from sample to sample are then larger than those of the vehicle.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.sensors.stream import rows_of_repeats

# Fewer distances between levels, or changes, may be those of a fault.
_FEWEST_LEVELS, _FEWEST_CHANGES = 4, 20
# Levels are on a grid if they are as far apart as its lines to this share of the step; rounded ones are.
_ON_LINE = 0.1
# Values that differ by less than this share of the largest are the same, but for rounding.
_ROUNDING = 1e-6
# Speeds in coarser steps are none: a little above 1 knot, the coarsest unit [m/s].
_LARGEST_STEP_M_S = 0.55
# Values are repeated at most so often, and for so long [s]: those on a grid are also the same by chance.
_MOST_REPEATS, _LONGEST_HELD_S, _LONGEST_ON_GRID_S = 100, 1.1, 0.1


def step_of(stream: SensorStream) -> float:
    """By how much the step of its values may change the speed from sample to sample [m/s]; 0 without one."""
    if stream.kind == "distance":
        tick_m = _grid(np.abs(np.diff(stream.values[:, 0])))
        period_s = stream.period_s
        return 2.0 * tick_m / period_s if period_s > 0 else 0.0  # both ends of either way are rounded
    step = max(_grid(np.abs(column)) for column in stream.values.T)
    return step if step <= _LARGEST_STEP_M_S else 0.0


def _grid(values: FloatArray) -> float:
    """The step of a grid that all values (n,), not negative, are on; 0 if there is none."""
    levels = np.unique(values)
    apart = np.diff(levels)
    apart = apart[apart > _ROUNDING * levels[-1]]
    if len(apart) < _FEWEST_LEVELS:
        return 0.0
    multiples = np.round(apart / apart.min())
    step = float(apart.sum() / multiples.sum())
    return step if np.abs(apart / step - multiples).max() <= _ON_LINE else 0.0


def measured_anew(t_s: FloatArray, speeds: FloatArray, step_m_s: float) -> IndexArray:
    """Samples of a speed (n,) in steps of that size or none, that do not repeat the one before, (m,).

    Where it is constant for longer than it is usually repeated, it was measured so: one sample is taken for
    each such time.
    """
    whole = np.arange(len(speeds), dtype=np.int32)
    begins, following = rows_of_repeats(speeds)
    lengths = np.diff(begins)
    if len(lengths) < _FEWEST_CHANGES:
        return whole
    period_s = float(np.median(np.diff(t_s)))
    usual = int(np.quantile(lengths, 0.25, method="lower"))
    if step_m_s > 0:
        usual = min(usual, int(_LONGEST_ON_GRID_S / period_s))
    if usual < 2 or usual > _MOST_REPEATS or usual * period_s > _LONGEST_HELD_S:
        return whole
    since = whole - np.repeat(begins, following - begins)
    return np.asarray(whole[since % usual == 0])
