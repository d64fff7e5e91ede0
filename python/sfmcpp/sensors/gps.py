"""Satellite positions: geodetic coordinates made local and metric, positions at any time.

WGS 84 after NIMA TR8350.2, "Department of Defense World Geodetic System 1984", third edition: semi-major axis
and flattening of table 3.1, geodetic to Cartesian coordinates of its section 4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.sensor_kinds import FASTEST_M_S
from sfmcpp.sensors.stream import measured_at, require_kind

SEMI_MAJOR_AXIS_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
_ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
# Each round of a latitude leaves a 150th of its error, the squared eccentricity.
_ROUNDS = 8
# What honest positions may be off, the two of a way together, and the least that counts as σ [m].
_NOISE_SIGMAS, _LEAST_SIGMA_M = 10.0, 1.0
# More leaps are noise, and not looked at.
_MOST_LEAPS = 1000
# Fewer positions leave nothing to judge them by.
LEAST_POSITIONS = 5
# Degrees taken for metres: horizontally all within this of each other, which is less than a way or a baseline
# of photos, and so many times farther from zero.
_DEGREES_WITHIN, _DEGREES_FROM_ZERO = 0.1, 100.0


@checked()
def position_at(stream: SensorStream, time_s: float) -> FloatArray | None:
    """Position at a time: linear between fixes, at constant velocity after the last one.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``; see :func:`local_positions` for one of kind ``"geodetic"``.
    time_s : float
        When [s].

    Returns
    -------
    (3,) float64 or None
        Position [m] in the stream's world; None if the stream does not cover that time.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "position")
    if not stream.covers(time_s, time_s):
        return None
    return np.asarray(measured_at(stream, np.array([time_s]))[0])


@checked()
def without_leaps(stream: SensorStream, sigma_m: float | None = None) -> SensorStream:
    """Leave out positions that no vehicle could have got to from the others, as of fixes that were lost.

    Of all the ways through the stream that a vehicle can have gone, that with most positions is kept.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"`` or ``"pose"``.
    sigma_m : float, optional
        What a position may be off, along each axis [m]; less than a metre, or None, counts as one.

    Returns
    -------
    SensorStream
        The same one where nothing is left out.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "position", "pose")
    t_s, places = stream.t_s, stream.values[:, :3]
    noise_m = _NOISE_SIGMAS * max(sigma_m or 0.0, _LEAST_SIGMA_M)
    leaps = 1 + np.flatnonzero(~_reachable(t_s[:-1], places[:-1], t_s[1:], places[1:], noise_m))
    if not 0 < len(leaps) <= _MOST_LEAPS:
        return stream
    first, last = np.concatenate([[0], leaps]), np.concatenate([leaps, [len(t_s)]]) - 1
    counts = last - first + 1
    before = np.full(len(first), -1)
    for k in range(1, len(first)):
        possible = _reachable(t_s[last[:k]], places[last[:k]], t_s[first[k]], places[first[k]], noise_m)
        best = int(np.argmax(np.where(possible, counts[:k], 0)))
        if possible[best]:
            before[k] = best
            counts[k] += counts[best]
    kept, at = np.zeros(len(t_s), dtype=bool), int(np.argmax(counts))
    while at >= 0:
        kept[first[at] : last[at] + 1] = True
        at = int(before[at])
    return replace(stream, t_s=t_s[kept], values=stream.values[kept])


def _reachable(
    start_s: FloatArray, start: FloatArray, end_s: FloatArray | float, end: FloatArray, noise_m: float
) -> NDArray[np.bool_]:
    """Whether a vehicle can get from one place to another in the time."""
    way = np.linalg.norm(end - start, axis=1)
    return np.asarray(way <= FASTEST_M_S * (end_s - start_s) + noise_m)


@checked()
def local_positions(stream: SensorStream, origin: ArrayLike | None = None) -> SensorStream:
    """Turn latitude, longitude and height into metres east, north and up of an origin.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"geodetic"``.
    origin : (3,) array-like, optional
        Latitude [deg], longitude [deg], height above the ellipsoid [m]. Default: the first sample.

    Returns
    -------
    SensorStream
        Of kind ``"position"``.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `origin` is none.
    """
    require_kind(stream, "geodetic")
    start = stream.values[0] if origin is None else finite_array("origin", origin, (3,))
    local = east_north_up(stream.values, start)
    return SensorStream(stream.t_s, local, "position", stream.name, stream.max_gap_s)


def east_north_up(geodetic: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Cartesian coordinates in the plane tangent to the ellipsoid at an origin.

    Parameters
    ----------
    geodetic : (n, 3) array-like
        Latitude [deg], longitude [deg], height above the ellipsoid [m].
    origin : (3,) array-like
        The same of the origin.

    Returns
    -------
    (n, 3) float64
        East, north, up [m].

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or a latitude is beyond ±90°.
    """
    start = finite_array("origin", origin, (3,))
    offset = earth_centred(geodetic) - earth_centred(start[None])
    return np.asarray(offset @ _axes_east_north_up(start).T)


def earth_centred(geodetic: ArrayLike) -> FloatArray:
    """Earth-centred, Earth-fixed coordinates.

    Parameters
    ----------
    geodetic : (n, 3) array-like
        Latitude [deg], longitude [deg], height above the ellipsoid [m].

    Returns
    -------
    (n, 3) float64
        x, y, z [m].

    Raises
    ------
    InvalidArgument
        If the shape is wrong, a number is not finite, or a latitude is beyond ±90°.
    """
    geodetic = finite_array("geodetic", geodetic, (ANY, 3))
    if (np.abs(geodetic[:, 0]) > 90).any():
        row = int(np.argmax(np.abs(geodetic[:, 0])))
        raise InvalidArgument(f"geodetic[{row}]: latitude {geodetic[row, 0]}°, must be from -90° to 90°")
    latitude, longitude = np.deg2rad(geodetic[:, 0]), np.deg2rad(geodetic[:, 1])
    height = geodetic[:, 2]
    normal = SEMI_MAJOR_AXIS_M / np.sqrt(1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    from_axis = (normal + height) * np.cos(latitude)
    z = (normal * (1 - _ECCENTRICITY_SQUARED) + height) * np.sin(latitude)
    return np.stack([from_axis * np.cos(longitude), from_axis * np.sin(longitude), z], axis=1)


def require_metres(rows: FloatArray) -> None:
    """Refuse latitudes and longitudes, (n, 3) with any heights, under the names of x and y."""
    plane = rows[rows[:, :2].any(axis=1), :2]  # where a receiver had no fix there are zeros
    if len(plane) < LEAST_POSITIONS:
        return
    middle, extent = np.median(plane, axis=0), float(np.ptp(plane, axis=0).max())
    small = 0 < extent < _DEGREES_WITHIN and np.linalg.norm(middle) > _DEGREES_FROM_ZERO * extent
    if small and np.abs(middle).max() <= 180 and np.abs(middle).min() <= 90:
        raise InvalidArgument(
            f"gps: x and y are {middle[0]:.6g} and {middle[1]:.6g} to within {extent:.2g}, which look like "
            "degrees: must be metres, or be named lat, lon, height (geodetic=True)"
        )


def geodetic_of(local: ArrayLike, origin: ArrayLike) -> FloatArray:
    """Latitude, longitude and height of places in a tangent plane: :func:`east_north_up` backwards.

    Parameters
    ----------
    local : (n, 3) array-like
        East, north, up [m].
    origin : (3,) array-like
        Latitude, longitude [deg], height above the ellipsoid [m] of the origin.

    Returns
    -------
    (n, 3) float64
        Latitude, longitude [deg] and height above the ellipsoid [m].

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or a latitude is beyond ±90°.
    """
    start = finite_array("origin", origin, (3,))
    offset = finite_array("local", local, (ANY, 3)) @ _axes_east_north_up(start)
    x, y, z = (earth_centred(start[None]) + offset).T
    from_axis = np.hypot(x, y)
    latitude = np.arctan2(z, from_axis)
    for _ in range(_ROUNDS):
        normal = SEMI_MAJOR_AXIS_M / np.sqrt(1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + _ECCENTRICITY_SQUARED * normal * np.sin(latitude), from_axis)
    sine = np.sin(latitude)
    to_surface = SEMI_MAJOR_AXIS_M * np.sqrt(1 - _ECCENTRICITY_SQUARED * sine**2)
    height = from_axis * np.cos(latitude) + z * sine - to_surface
    return np.stack([np.rad2deg(latitude), np.rad2deg(np.arctan2(y, x)), height], axis=1)


def _axes_east_north_up(origin: FloatArray) -> FloatArray:
    """Rows: unit vectors east, north, up at the origin, Earth-centred."""
    latitude, longitude = np.deg2rad(origin[:2])
    sine, cosine = np.sin(latitude), np.cos(latitude)
    s, c = np.sin(longitude), np.cos(longitude)
    return np.array([[-s, c, 0.0], [-sine * c, -sine * s, cosine], [cosine * c, cosine * s, sine]])
