"""Checks of positions against the camera's path: mirrored axes, clock offset.

A map is registered to positions by a similarity, whatever their unit, origin and axes. What can be checked is
whether their axes are right-handed, and their clock.
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

# Length of the two chords that measure a bend, in standard deviations of a position: an error of about 10°.
_CHORD_SIGMAS = 10.0
# The largest bends are compared, this share: smaller ones are noise. Fewest bends, and their least median.
_LARGEST_SHARE, _FEWEST_BENDS = 0.25, 4
_LEAST_BEND_RAD = float(np.radians(15.0))
# Positions are mirrored if the errors against the mirrored turns are at most this share of the others.
_MUCH_BETTER = 1 / 3
# Offsets that are tried [s]. Stretches over which dead reckoning hardly drifts [s]; their fewest positions.
_OFFSETS_S = np.linspace(-2.5, 2.5, 51)
_STRETCH_S, _FEWEST_FIXES = 20.0, 16
# Largest offset of clocks that are taken for synchronous [s], and significance of a larger one in σ.
_TOLERATED_OFFSET_S, _SIGMAS = 0.25, 3.0
# Upper bound of the correlation of successive errors.
_MOST_ALIKE = 0.99


@dataclass(frozen=True)
class BendCheck:
    """How the bends of positions compare with the turns of the camera.

    Attributes
    ----------
    bends : int
        Number of bends found.
    told_rad, seen_rad : float
        Median size of the largest bends of the positions, and of the camera's turns there [rad].
    error_rad, mirrored_error_rad : float
        Median size of the difference of both, and of the difference if the positions are mirrored [rad].
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
    """Clock offset of positions against a path from other sensors.

    Attributes
    ----------
    offset_s : float
        To be added to the stamps of the positions [s].
    sigma_s : float
        Standard deviation of `offset_s` [s]; infinite where it is not observable.
    """

    offset_s: float = 0.0
    sigma_s: float = np.inf

    @property
    def is_off(self) -> bool:
        """Whether the offset is significantly larger than tolerated."""
        return abs(self.offset_s) > _TOLERATED_OFFSET_S + _SIGMAS * self.sigma_s


@checked()
def check_bends(
    stream: SensorStream, vision: Trajectory, up_in_camera: ArrayLike = UP_IN_CAMERA, sigma_m: float = 1.0
) -> BendCheck:
    """Compare the bends of positions, seen from above, with the turns of a camera that looks ahead.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    vision : Trajectory
        The camera's path, of which only the rotations are used.
    up_in_camera : (3,) array-like
        Direction in the camera's frame that is up where it stands upright, of any length. Default: against
        its y axis.
    sigma_m : float
        Standard deviation of a position along each axis [m].

    Returns
    -------
    BendCheck
        Without bends if the path is straight, or shorter than twenty standard deviations.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, a shape is wrong, `up_in_camera` is zero, or `sigma_m` is not
        positive.
    """
    require_kind(stream, "position")
    require_positive("sigma_m", sigma_m)
    up = finite_array("up_in_camera", up_in_camera, (3,))
    if not up.any():
        raise InvalidArgument("up_in_camera: is zero, must be a direction")
    up = up / np.linalg.norm(up)
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
    """Angles to the left (n, 2): between the chords before and after a place, and of the camera's turn.

    The camera's turn is taken from the middle of one chord to the middle of the other.
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
    """Estimate the clock offset of positions against a path that was computed without them.

    Offsets up to 2.5 s are tried. The path may drift: each stretch of 20 s is registered to the positions by
    a similarity of its own, and the offset with the smallest residuals is chosen.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    path : Trajectory
        Path of the same place on the vehicle, computed without these positions.

    Returns
    -------
    PositionClock
        Of infinite σ if there are too few positions, or the vehicle drives straight at constant speed.

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
    before, here, after = cost[best - 1 : best + 2]
    beside_s, curvature = parabola_minimum(before, here, after, step_s)
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
    except InvalidArgument:  # no similarity: the vehicle stands still, or drives exactly straight
        return np.zeros(len(_OFFSETS_S))
    squares = np.array([np.sum(residuals**2) for residuals in left])
    best = left[int(np.argmin(squares))]
    # Errors of receivers and of the path are correlated in time: they count as fewer independent ones.
    alike = np.clip(np.sum(best[1:] * best[:-1]) / max(np.sum(best**2), 1e-300), 0.0, _MOST_ALIKE)
    count = len(t_s) * (1 - alike) / (1 + alike)
    return np.asarray(1.5 * count * np.log(np.maximum(squares, 1e-300)))


def _similarity_residuals(source: FloatArray, target: FloatArray) -> FloatArray:
    return np.asarray(fit_similarity(source, target).apply(source) - target)
