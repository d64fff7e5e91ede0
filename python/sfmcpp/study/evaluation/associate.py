"""Association of estimated poses with true ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_one_of
from sfmcpp.sensors import interpolate_poses

# As evo's default.
NEAREST_WITHIN_S = 0.01
INTERPOLATED_WITHIN_S = 0.5
MATCHES = ("nearest", "interpolate")
# Fewer of the poses that might have a partner tell little of a trajectory.
_FEW = 0.5
# Of stamps in another unit the time covered is about so many times as long, and so are steps, but for the
# rates of the two.
_UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
_ABOUT, _OTHER_RATE = 3.0, 30.0

Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Matched:
    """Pairs of poses: row i of one belongs to row i of the other.

    Attributes
    ----------
    estimate, truth : Trajectory
        As many poses each.
    """

    estimate: Trajectory
    truth: Trajectory

    def __len__(self) -> int:
        return len(self.estimate)


@checked()
def associate(
    estimate: Trajectory, truth: Trajectory, match: str = "nearest", max_difference_s: float | None = None
) -> Matched:
    """Pair the poses of two trajectories by time; by order, if one of them has no times.

    Parameters
    ----------
    estimate, truth : Trajectory
        The two.
    match : str
        ``"nearest"``: each pose of the shorter one with the pose nearest in time of the longer one, as evo
        does. ``"interpolate"``: the truth interpolated to the time of each estimated pose, as the thesis does
        (§5.4.1).
    max_difference_s : float, optional
        How far in time the nearest pose may be [s]. Default: 0.01 for ``"nearest"``, 0.5 for
        ``"interpolate"``.

    Returns
    -------
    Matched

    Raises
    ------
    InvalidArgument
        If nothing matches; stamps are not in seconds, as a factor of 1000 tells; one has no times and the
        other not as many poses; or an option breaks its rule.
    """
    require_one_of("match", match, MATCHES)
    if not (estimate.stamped and truth.stamped):
        return _matched_by_order(estimate, truth)
    _require_seconds(estimate, truth)
    if match == "interpolate":
        return _matched_by_interpolation(estimate, truth, _limit(max_difference_s, INTERPOLATED_WITHIN_S))
    return _matched_by_time(estimate, truth, _limit(max_difference_s, NEAREST_WITHIN_S))


def warning_of_few(estimate: Trajectory, truth: Trajectory, matched: int, match: str) -> str:
    """Warn where most poses of the time that both trajectories cover have no partner; empty if not.

    Parameters
    ----------
    estimate, truth : Trajectory
        As :func:`associate` has taken them.
    matched : int
        How many pairs it has found.
    match : str
        How it has looked for them.
    """
    if not (estimate.stamped and truth.stamped):
        return ""
    start, end = max(estimate.t_s[0], truth.t_s[0]), min(estimate.t_s[-1], truth.t_s[-1])
    counts = [int(np.count_nonzero((t_s >= start) & (t_s <= end))) for t_s in (estimate.t_s, truth.t_s)]
    if matched >= _FEW * min(counts):
        return ""
    remedy = "--match interpolate, or a larger " if match == "nearest" else "a larger "
    return (
        f"only {matched:,} poses are matched, of {counts[0]:,} estimated and {counts[1]:,} true ones while "
        f"both tell: all errors are of these; {remedy}--max-difference-s matches more"
    )


def nearest_rows(t_s: FloatArray, times_s: FloatArray) -> Rows:
    """Row of the stamp nearest to each of several times.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], increasing, n ≥ 1.
    times_s : (m,) float64
        Times [s].

    Returns
    -------
    (m,) int64
    """
    after = np.clip(np.searchsorted(t_s, times_s), 1, max(len(t_s) - 1, 1))
    before = after - 1
    if len(t_s) == 1:
        return np.zeros(len(times_s), dtype=np.int64)
    return np.where(times_s - t_s[before] <= t_s[after] - times_s, before, after)


def _limit(given: float | None, default: float) -> float:
    limit = default if given is None else given
    if not (np.isfinite(limit) and limit >= 0):
        raise InvalidArgument(f"max_difference_s = {limit}: must be finite and not negative")
    return limit


def _matched_by_order(estimate: Trajectory, truth: Trajectory) -> Matched:
    if len(estimate) != len(truth):
        raise InvalidArgument(
            f"truth: has {len(truth)} poses and the estimate {len(estimate)}: must be as many, since one of "
            "them has no times to match by"
        )
    return Matched(estimate, truth)


def _matched_by_time(estimate: Trajectory, truth: Trajectory, limit_s: float) -> Matched:
    swap = len(estimate) > len(truth)
    short, long = (truth, estimate) if swap else (estimate, truth)
    rows = nearest_rows(long.t_s, short.t_s)
    difference = np.abs(long.t_s[rows] - short.t_s)
    kept = _closest_of_each(rows, difference, limit_s)
    _require_some(kept, estimate, truth, limit_s)
    one, other = short.at(kept), long.at(rows[kept])
    return Matched(other, one) if swap else Matched(one, other)


def _closest_of_each(rows: Rows, difference: FloatArray, limit_s: float) -> Rows:
    """Of all that chose the same row, the one nearest to it; none beyond the limit."""
    order = np.lexsort((difference, rows))
    first = np.concatenate([[True], np.diff(rows[order]) > 0])
    chosen = np.sort(order[first])
    return np.asarray(chosen[difference[chosen] <= limit_s])


def _matched_by_interpolation(estimate: Trajectory, truth: Trajectory, limit_s: float) -> Matched:
    times = estimate.t_s
    inside = (times >= truth.t_s[0]) & (times <= truth.t_s[-1])
    near = np.abs(truth.t_s[nearest_rows(truth.t_s, times)] - times) <= limit_s
    kept = np.flatnonzero(inside & near)
    _require_some(kept, estimate, truth, limit_s)
    poses = interpolate_poses(truth.t_s, truth.poses, times[kept])
    return Matched(estimate.at(kept), Trajectory(times[kept], poses))


def _require_some(kept: Rows, estimate: Trajectory, truth: Trajectory, limit_s: float) -> None:
    if not len(kept):
        raise InvalidArgument(
            f"truth: no pose within {limit_s} s of any of the estimate: times go from {truth.t_s[0]:.6f} to "
            f"{truth.t_s[-1]:.6f} s, those of the estimate from {estimate.t_s[0]:.6f} to "
            f"{estimate.t_s[-1]:.6f} s"
        )


def _require_seconds(estimate: Trajectory, truth: Trajectory) -> None:
    """Refuse stamps in another unit: a few of them may still fall on those of the other trajectory."""
    if min(len(estimate), len(truth)) < 2:
        return
    lasts, steps = ([measure(t.t_s) for t in (estimate, truth)] for measure in (np.ptp, _usual_step))
    which = ("estimate", "truth") if lasts[0] > lasts[1] else ("truth", "estimate")
    longer, finer = max(lasts) / min(lasts), steps[lasts.index(max(lasts))] / steps[lasts.index(min(lasts))]
    for factor, unit in _UNITS.items():
        if 1 / _ABOUT < longer / factor < _ABOUT and finer > factor / _OTHER_RATE:
            raise InvalidArgument(
                f"{which[0]}: lasts {longer:,.0f} times as long as the {which[1]}, and so do its steps: must "
                f"have stamps in seconds, these seem to be {unit}"
            )


def _usual_step(t_s: FloatArray) -> float:
    return float(np.median(np.diff(t_s)))
