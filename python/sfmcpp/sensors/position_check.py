"""Checks of positions against the camera's path: mirrored axes, clock offset.

A similarity brings a map to any positions: their unit and where they lie say nothing. What is left is the
hand of their axes and their clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import fit_similarity, so3
from sfmcpp.geometry.parabola import parabola_minimum
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.checks import require_positive
from sfmcpp.sensors.registration import UP_IN_CAMERA
from sfmcpp.sensors.stream import interpolate_vectors, require_kind

# A bend of the way is told by two chords of so many standard deviations, to some ten degrees.
_CHORD_SIGMAS = 10.0
# The largest bends are looked at: elsewhere there is noise alone.
_LARGEST_SHARE, _FEWEST_BENDS = 0.25, 4
_LEAST_BEND_RAD = float(np.radians(15.0))
# Positions are mirrored where bends to the other side leave this part of the errors at most.
_MUCH_BETTER = 1 / 3
# Offsets that are tried [s]; a way reckoned from speeds and rates is good over such a stretch.
_OFFSETS_S = np.linspace(-2.5, 2.5, 51)
_STRETCH_S, _FEWEST_FIXES = 20.0, 16
# What honest clocks are apart, and how sure it must be that it is more.
_TOLERATED_OFFSET_S, _SIGMAS = 0.25, 3.0
# Noise whose neighbours are all alike still counts as something.
_MOST_ALIKE = 0.99


@dataclass(frozen=True)
class BendCheck:
    """How the bends of positions compare with the turns of the camera.

    Attributes
    ----------
    bends : int
        Places compared.
    told_rad, seen_rad : float
        Median of the largest bends of the positions, and of the camera's turns there, without their sides.
    error_rad, mirrored_error_rad : float
        Median difference between the two, and to the other side [rad].
    """

    bends: int = 0
    told_rad: float = 0.0
    seen_rad: float = 0.0
    error_rad: float = 0.0
    mirrored_error_rad: float = 0.0

    @property
    def is_mirrored(self) -> bool:
        """Whether the positions bend to the other side."""
        bent = min(self.told_rad, self.seen_rad) > _LEAST_BEND_RAD
        return bent and self.mirrored_error_rad < _MUCH_BETTER * self.error_rad


@dataclass(frozen=True)
class PositionClock:
    """The clock of positions beside a way that was reckoned without them.

    Attributes
    ----------
    offset_s : float
        What to add to the stamps of the positions [s].
    sigma_s : float
        What `offset_s` may be off [s]: infinite where nothing tells it.
    """

    offset_s: float = 0.0
    sigma_s: float = np.inf

    @property
    def is_off(self) -> bool:
        """Whether it is known to be off by more than is tolerated."""
        return abs(self.offset_s) > _TOLERATED_OFFSET_S + _SIGMAS * self.sigma_s


@checked()
def check_bends(
    stream: SensorStream, vision: Trajectory, up_in_camera: ArrayLike = UP_IN_CAMERA, sigma_m: float = 1.0
) -> BendCheck:
    """Compare the bends of positions, seen from above, with the turns of a camera that goes where it looks.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    vision : Trajectory
        The camera's rotations, from one to the next; its centres are not looked at.
    up_in_camera : (3,) array-like
        Direction in the camera's frame that is up where it stands upright. Default: against its y axis.
    sigma_m : float
        What a position may be off, along each axis [m].

    Returns
    -------
    BendCheck
        It tells nothing of a straight way, nor of one of less than twenty standard deviations.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, a shape is wrong, or `sigma_m` is not positive.
    """
    require_kind(stream, "position")
    require_positive("sigma_m", sigma_m)
    up = finite_array("up_in_camera", up_in_camera, (3,))
    turns = so3.log(np.swapaxes(vision.rotations[:-1], 1, 2) @ vision.rotations[1:])
    heading = np.concatenate([[0.0], np.cumsum(turns @ up)])
    covered = np.array([stream.covers(t, t) for t in vision.t_s], dtype=bool)
    found = _path_bends(stream, vision.t_s[covered], heading[covered], _CHORD_SIGMAS * sigma_m)
    if len(found) < _FEWEST_BENDS:
        return BendCheck(len(found))
    sizes = np.abs(found[:, 0])
    told, seen = found[sizes >= np.quantile(sizes, 1 - _LARGEST_SHARE)].T
    return BendCheck(len(found), *np.median(np.abs([told, seen, told - seen, told + seen]), axis=1).tolist())


def _path_bends(stream: SensorStream, times: FloatArray, heading: FloatArray, chord_m: float) -> FloatArray:
    """Angles to the left (n, 2) between a chord up to a place and one from there on, and of the camera.

    The camera's is that from the middle of one chord to the middle of the other.
    """
    places = interpolate_vectors(stream.t_s, stream.values, times)[:, :2]
    found = []
    for middle in range(len(places)):
        away = np.linalg.norm(places - places[middle], axis=1) >= chord_m
        before, after = np.flatnonzero(away[:middle]), middle + np.flatnonzero(away[middle:])
        if not len(before) or not len(after):
            continue
        first, last = before[-1], after[0]
        (x, y), (u, v) = places[middle] - places[first], places[last] - places[middle]
        seen = heading[(middle + last) // 2] - heading[(first + middle) // 2]
        found.append((np.arctan2(x * v - y * u, x * u + y * v), seen))
    return np.array(found).reshape(-1, 2)


@checked()
def check_position_clock(stream: SensorStream, path: Trajectory) -> PositionClock:
    """Compare when positions bend, and change their speed, with when a reckoned way does.

    Offsets up to 2.5 s are tried, over stretches of 20 s, each brought to the positions by a similarity of
    its own: the way may drift.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    path : Trajectory
        The way of the same place, reckoned without these positions.

    Returns
    -------
    PositionClock
        It tells nothing where there are too few positions, or the way is straight and even.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "position")
    reach_s = float(_OFFSETS_S[-1])
    inside = (stream.t_s - reach_s >= path.t_s[0]) & (stream.t_s + reach_s <= path.t_s[-1])
    cost = _costs(stream.t_s[inside], stream.values[inside], path)
    best = int(np.argmin(cost))
    if not 0 < best < len(cost) - 1:
        return PositionClock()
    step_s = float(_OFFSETS_S[1] - _OFFSETS_S[0])
    beside_s, curvature = parabola_minimum(*cost[best - 1 : best + 2], step=step_s)
    if curvature <= 0:
        return PositionClock()
    return PositionClock(float(_OFFSETS_S[best]) + beside_s, float(step_s / np.sqrt(curvature)))


def _costs(t_s: FloatArray, places: FloatArray, path: Trajectory) -> FloatArray:
    """Negative log-likelihood of each offset, of all stretches that have enough positions."""
    cost = np.zeros(len(_OFFSETS_S))
    number = ((t_s - t_s[:1]) / _STRETCH_S).astype(int)
    for stretch in np.unique(number):
        part = number == stretch
        if np.count_nonzero(part) >= _FEWEST_FIXES:
            cost += _stretch_costs(t_s[part], places[part], path)
    return cost


def _stretch_costs(t_s: FloatArray, places: FloatArray, path: Trajectory) -> FloatArray:
    try:
        left = [
            _similarity_residuals(interpolate_vectors(path.t_s, path.centres, t_s + o), places)
            for o in _OFFSETS_S
        ]
    except InvalidArgument:  # it stands still, or goes straight to the last digit
        return np.zeros(len(_OFFSETS_S))
    squares = np.array([np.sum(residuals**2) for residuals in left])
    best = left[int(np.argmin(squares))]
    # Noise of receivers, and drift of the way, lasts: neighbours say the same again.
    alike = np.clip(np.sum(best[1:] * best[:-1]) / max(np.sum(best**2), 1e-300), 0.0, _MOST_ALIKE)
    count = len(t_s) * (1 - alike) / (1 + alike)
    return np.asarray(1.5 * count * np.log(np.maximum(squares, 1e-300)))


def _similarity_residuals(source: FloatArray, target: FloatArray) -> FloatArray:
    return np.asarray(fit_similarity(source, target).apply(source) - target)
