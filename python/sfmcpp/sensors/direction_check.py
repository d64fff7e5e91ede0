"""Clock of an odometer by the changes of its direction of travel.

In a bend, and where the body pitches, a velocity changes its direction in the body's axes, and so does the
step of the camera between two images. Speeds determine the clock less well, as the scale of images drifts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.mounting import Mounting
from sfmcpp.sensors.stream import clock_text, measured_at, require_kind
from sfmcpp.sensors.turn import CLOCK_OFFSETS_S, Turn, rotations_of, times_of

_FEWEST_STEPS = 40
# Offsets that differ by no more count as the same [s].
_SAME_S = 0.15
# By how much the log-likelihood of all other offsets must be lower: three standard deviations.
_MARGIN = 4.5
# A regular sway looks the same a period later: all other offsets must explain less than this share of what
# the best one explains beyond the median of all. On parts of 0001, 0036 and 0039 they explained 0.25 to 0.43,
# with a simulated sway of one frequency 0.71 or more.
_SHARE_OF_OTHERS = 0.6
# Standard deviation of a direction beyond that by the pixels [rad], and factors on the latter. The likeliest
# are taken.
_EXTRA_RAD, _FACTORS = np.radians([0.05, 0.1, 0.2, 0.4, 0.8]), (1.0, 1.5, 2.5)
# Degrees of freedom of Student's distribution, and the error to which larger ones are cut [rad].
_FREEDOM, _LARGEST_ERROR_RAD = 4.0, 0.05
# Directions tell no clock if more than this share of the errors about an axis is cut: with a car ahead in
# simulated bends 0.45 are, on parts of 0001, 0036 and 0039 with clocks that are found 0.13 at most.
_MOST_CUT = 1 / 3
# A slower body has no direction of travel.
_SLOWEST_M_S = 0.5
# Errors that last longer than this are those of the mounting, or of a velocity that stays level while the
# body pitches with the road [s]. Of windows from 0.2 s to none, those of 0.3 and 0.4 s determined most clocks
# on parts of 0001, 0027, 0036 and 0039.
_WINDOW_S = 0.35
# Steps are compared in blocks of at most so many, as the window is a dense matrix.
_LARGEST_BLOCK = 256


@dataclass(frozen=True)
class DirectionClock:
    """Clock of an odometer beside the camera's.

    Attributes
    ----------
    steps : int
        Pairs of images compared.
    offset_s : float
        What to add to the odometer's stamps [s].
    margin : float
        By how much the logarithm of the likelihood falls to that of any offset further than 0.15 s away.
    gain : float
        By how much it falls to the median of all offsets.
    """

    steps: int = 0
    offset_s: float = 0.0
    margin: float = 0.0
    gain: float = 0.0

    @property
    def is_off(self) -> bool:
        """Whether it is known to be off by more than is tolerated."""
        least = max(_MARGIN, (1 - _SHARE_OF_OTHERS) * self.gain)
        return abs(self.offset_s) > _SAME_S and self.margin > least

    @property
    def complaint(self) -> str:
        """What the clock is, beside the camera's."""
        clock = clock_text(self.offset_s, _SAME_S, "the camera's")
        return f"by its directions {clock}: {self.offset_s:.2f} s are to be added to the stamps"


@checked()
def check_directions(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> DirectionClock:
    """Compare directions of an odometer's velocities with those of pairs of images, over offsets up to 1 s.

    Errors of the mounting, and others that change slowly, do not matter.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"velocity"``.
    mounting : Mounting
        How the camera sits on the body.
    turns : sequence of Turn
        Short steps with their `covariance`; some may be wrong. Those without a direction are left out.

    Returns
    -------
    DirectionClock
        It tells nothing where the stream covers fewer than forty of them at every offset, where the largest
        offset is the best, nor where a third of the directions are off by too much about an axis even at the
        best. It is not said to be off where another offset explains nearly as much, as with a regular sway.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "velocity")
    reach_s = float(CLOCK_OFFSETS_S[-1])
    known = [t for t in turns if np.isfinite(t.direction).all() and np.isfinite(t.covariance).all()]
    covered = [t for t in known if stream.covers(t.start_s - reach_s, t.end_s + reach_s)]
    if len(covered) < _FEWEST_STEPS:
        return DirectionClock(len(covered))
    steps = _steps_at_offsets(stream, mounting, covered)
    moves = (np.linalg.norm(steps, axis=2) > _SLOWEST_M_S).all(axis=0)
    if np.count_nonzero(moves) < _FEWEST_STEPS:
        return DirectionClock(int(np.count_nonzero(moves)))
    blocks = np.array_split(np.flatnonzero(moves), np.ceil(np.count_nonzero(moves) / _LARGEST_BLOCK))
    cost = np.sum([_costs(steps[:, block], [covered[k] for k in block]) for block in blocks], axis=0)
    best = int(np.argmin(cost))
    if not 0 < best < len(cost) - 1 or _are_often_cut(
        steps[best, moves], [t for t, moved in zip(covered, moves, strict=True) if moved]
    ):
        return DirectionClock(int(np.count_nonzero(moves)))
    others = np.abs(CLOCK_OFFSETS_S - CLOCK_OFFSETS_S[best]) > _SAME_S
    falls = float(cost[others].min() - cost[best]), float(np.median(cost) - cost[best])
    return DirectionClock(int(np.count_nonzero(moves)), float(CLOCK_OFFSETS_S[best]), *falls)


def _steps_at_offsets(stream: SensorStream, mounting: Mounting, turns: Sequence[Turn]) -> FloatArray:
    """Mean velocities (offsets, n, 3) of the camera in its axes at the start, each offset added to stamps."""
    start, end = times_of(turns).T
    body = mounting.camera_from_body.T @ rotations_of(turns) @ mounting.camera_from_body
    middles = (0.5 * (start + end) - CLOCK_OFFSETS_S[:, None]).ravel()
    velocities = measured_at(stream, middles).reshape(len(CLOCK_OFFSETS_S), len(turns), 3)
    halfway = so3.exp(0.5 * so3.log(body))
    lever = (body @ mounting.lever_arm_m - mounting.lever_arm_m) / (end - start)[:, None]
    travelled = np.einsum("nij,onj->oni", halfway, velocities) + lever
    return np.asarray(travelled @ mounting.camera_from_body.T)


def _are_often_cut(steps: FloatArray, turns: Sequence[Turn]) -> bool:
    """Whether about either axis many errors of steps (n, 3) are beyond the largest one that counts.

    What is left of them then are cuts, whose likelihood has a best offset by chance: the steps of a slow
    drone with a fast camera are as long as the noise of the points. And what is seen goes with the body, as a
    car ahead does: a turn of both looks like a step to the side. Where the body nods, this follows the rate
    of the angle, and the direction the angle itself, which together look like a clock that is off.
    """
    errors = _errors_across(steps[None], turns)[0]
    cut = np.abs(_about_median(errors)) > _LARGEST_ERROR_RAD
    return bool(cut.mean(axis=-1).max() > _MOST_CUT)


def _costs(steps: FloatArray, turns: Sequence[Turn]) -> FloatArray:
    """Negative log-likelihood (offsets,) of directions, of both coordinates across the way."""
    errors, sigmas = _errors_across(steps, turns)
    middles_s = np.array([0.5 * (turn.start_s + turn.end_s) for turn in turns])
    return np.asarray(sum(_cost_of_errors(e, s, middles_s) for e, s in zip(errors, sigmas, strict=True)))


def _errors_across(steps: FloatArray, turns: Sequence[Turn]) -> tuple[FloatArray, FloatArray]:
    """Errors (2, offsets, n) about both axes across the way [rad], and their sigmas (2, n) by the images."""
    told = steps / np.linalg.norm(steps, axis=2, keepdims=True)
    seen = np.stack([turn.direction for turn in turns])
    middle = np.median(seen, axis=0)
    across = np.linalg.svd(middle[None])[2][1:]
    sigmas = np.sqrt(np.einsum("ki,nij,kj->kn", across, np.stack([t.covariance for t in turns]), across))
    # The error across one axis turns about the other.
    return np.einsum("ki,oni->kon", across, np.cross(told, seen)), sigmas[::-1]


def _about_median(errors: FloatArray) -> FloatArray:
    return np.asarray(errors - np.median(errors, axis=-1, keepdims=True))


def _cost_of_errors(errors: FloatArray, sigmas: FloatArray, t_s: FloatArray) -> FloatArray:
    """Negative log-likelihood (offsets,) of `errors` (offsets, n) about their running mean."""
    near = np.clip(_about_median(errors), -_LARGEST_ERROR_RAD, _LARGEST_ERROR_RAD)
    window = np.exp(-0.5 * ((t_s[:, None] - t_s) / _WINDOW_S) ** 2)
    costs = []
    for extra, factor in product(_EXTRA_RAD, _FACTORS):
        scale = np.hypot(factor * sigmas, extra)
        weights = window / scale**2
        ratios = (near - near @ (weights / weights.sum(axis=1, keepdims=True)).T) / scale
        costs.append((0.5 * (_FREEDOM + 1) * np.log1p(ratios**2 / _FREEDOM) + np.log(scale)).sum(axis=1))
    return np.asarray(np.min(costs, axis=0))
