"""Bias of angular rates that changes evenly, as of a gyroscope that warms up, from rotations of images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.rate_bias import LARGEST_RAD_S, cauchy_loss, durations_s, error_scale, rotation_errors
from sfmcpp.sensors.stream import require_kind
from sfmcpp.sensors.turn import Turn, times_of

# Fewest pairs of images, half of them on either side of a leap.
_FEWEST, _FEWEST_BESIDE = 16, 4
# Least gain in log-likelihood over a constant bias, with Cauchy's density. Fault-free gyroscopes of KITTI's
# 0001, 0027, 0036 and 0039 came to 5.6 at most, as with stamps half a second off, a bias throughout or one of
# 5°/s for a fifth of the run; with a drift by 3°/s to 16 to 30.
_GAIN = 12.0
# Rounds of reweighting; leaps are tried after so many of the pairs at most.
_ROUNDS, _MOST_LEAPS = 12, 24


@dataclass(frozen=True, eq=False)
class RateDrift:
    """A bias of angular rates that changes evenly.

    Attributes
    ----------
    middle_s : float
        A time [s].
    rate_rad_s : (3,) float64
        The bias then, in the axes of the body [rad/s].
    change_rad_s2 : (3,) float64
        By how much it grows [rad/s²].
    seconds : float
        For how long it was seen to [s].
    """

    middle_s: float
    rate_rad_s: FloatArray
    change_rad_s2: FloatArray
    seconds: float

    def at(self, t_s: FloatArray) -> FloatArray:
        """The bias (n, 3) at times (n,) [rad/s]."""
        return np.asarray(self.rate_rad_s + (t_s - self.middle_s)[:, None] * self.change_rad_s2)

    @property
    def complaint(self) -> str:
        """A clause that describes it."""
        change = np.degrees(np.linalg.norm(self.change_rad_s2)) * self.seconds
        return f"its bias changes by {change:.1f}°/s in {self.seconds:.0f} s"


@checked()
def find_drift(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> RateDrift | None:
    """Find a bias that changes evenly by the rotations of pairs of images.

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
    RateDrift or None
        None where there are fewer than sixteen turns, where a constant bias explains them about as well, or
        where a leap from one bias to another does better: that is no drift.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    covered = [turn for turn in turns if stream.covers(turn.start_s, turn.end_s)]
    if len(covered) < _FEWEST:
        return None
    errors, lengths_s = rotation_errors(stream, mounting, covered, np.zeros(1))[0], durations_s(covered)
    t_s = times_of(covered).mean(axis=1)
    middle_s, seconds = float(t_s.mean()), float(np.ptp(t_s))
    line, left = _fitted(errors, lengths_s, t_s - middle_s)
    scale = error_scale(left)
    gain = cauchy_loss(_fitted(errors, lengths_s)[1], scale) - cauchy_loss(left, scale)
    if gain < _GAIN or np.abs(line[0]).max() > LARGEST_RAD_S:
        return None
    step = -(-(len(covered) - 2 * _FEWEST_BESIDE) // _MOST_LEAPS)
    leaps = t_s[_FEWEST_BESIDE : len(covered) - _FEWEST_BESIDE : step]
    left_by_leaps = (_fitted(errors, lengths_s, (t_s > leap).astype(float))[1] for leap in leaps)
    if min(cauchy_loss(beside, scale) for beside in left_by_leaps) < cauchy_loss(left, scale):
        return None
    rate, change = line @ mounting.camera_from_body
    return RateDrift(middle_s, rate, change, seconds)


@checked()
def without_drift(stream: SensorStream, drift: RateDrift) -> SensorStream:
    """The stream without a bias that changes.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``.
    drift : RateDrift
        What to take from its rates.

    Returns
    -------
    SensorStream

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "angular_rate")
    return replace(stream, values=stream.values - drift.at(stream.t_s))


def _fitted(
    errors: FloatArray, lengths_s: FloatArray, course: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """A constant rate, and one times `course` (n,), that explain rotation vectors (n, 3); the lengths left.

    By iteratively reweighted least squares with Cauchy's weights.
    """
    columns = [np.ones(len(errors)), *([] if course is None else [course])]
    design, rates = np.stack(columns, axis=1), errors / lengths_s[:, None]
    found = np.zeros((len(columns), 3))
    found[0] = np.median(rates, axis=0)
    for _ in range(_ROUNDS):
        left = np.linalg.norm(errors - lengths_s[:, None] * (design @ found), axis=1)
        scale = error_scale(left)
        weighted = (lengths_s**2 / (1 + (left / (2 * scale)) ** 2))[:, None] * design
        found = np.linalg.solve(design.T @ weighted, weighted.T @ rates)
    return found, np.linalg.norm(errors - lengths_s[:, None] * (design @ found), axis=1)
