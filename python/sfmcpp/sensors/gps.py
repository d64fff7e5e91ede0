"""Satellite positions: conversion to local metric coordinates, interpolation.

WGS 84 after NIMA TR8350.2, "Department of Defense World Geodetic System 1984", third edition: semi-major axis
and flattening of table 3.1, geodetic to Cartesian coordinates of its section 4.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import require_positive
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors.stream import measured_at, require_kind

SEMI_MAJOR_AXIS_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
_ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
# Each iteration for a latitude reduces its error by the squared eccentricity, 1/150.
_ROUNDS = 8
# Fewest positions that can be judged.
LEAST_POSITIONS = 5
# Latitudes and longitudes declared as metres: all within this of each other, which is less than any path in
# metres, and so many times farther from zero.
_DEGREES_WITHIN, _DEGREES_FROM_ZERO = 0.1, 100.0
# Radians taken for degrees: below these, and all within so much as read, a 57th of what they are then.
_MOST_RADIANS, _RADIANS_WITHIN_M = np.array([np.pi / 2, np.pi]), 2_000.0
# A parabola is fitted to positions within this time [s], at least so many, at most so many on either side.
_SMOOTHED_WITHIN_S, _LEAST_SMOOTHED, _MOST_SMOOTHED = 0.5, 5, 10
# Relative error of that time where stamps are rounded: since 1970 a second has no more than 2²² parts.
_ROUNDING = 1e-5
# Largest variance about the parabola, in units of the declared one: above it the motion is no parabola.
_LARGEST_VARIANCE_RATIO = 2.0
# Of a vehicle that brakes or turns, between two positions.
_ACCELERATION_M_S2 = 1.0
# No metric coordinates of the Earth are larger, not even with the number of their zone before them.
_FARTHEST_M = 1e8


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


def position_sigma(stream: SensorStream, time_s: float, sigma_m: float | None) -> float | None:
    """Standard deviation along each axis of :func:`position_at` [m], where that of a position is `sigma_m`.

    Between positions that are far apart a vehicle may turn, and beyond the ends of a stream also the noise of
    the last two grows: that of a straight line through both, and what an acceleration adds.
    """
    if sigma_m is None or len(stream) < 2:
        return sigma_m
    after = int(np.clip(np.searchsorted(stream.t_s, time_s), 1, len(stream) - 1))
    start_s, end_s = stream.t_s[after - 1 : after + 1].tolist()
    share = (time_s - start_s) / (end_s - start_s)
    bent_m = 0.5 * _ACCELERATION_M_S2 * abs((time_s - start_s) * (time_s - end_s))
    return float(np.hypot(sigma_m * max(1.0, np.hypot(share, 1 - share)), bent_m))


@checked()
def smoothed_positions(stream: SensorStream, sigma_m: float = 1.0) -> SensorStream:
    """Replace each position by the parabola fitted to those within half a second, if it fits.

    At most ten are taken on either side. The path of a vehicle deviates from the parabola by a decimetre or
    two. White noise at ten positions a second is halved; errors that last longer remain.

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"position"``.
    sigma_m : float
        Standard deviation of a position along each axis [m].

    Returns
    -------
    SensorStream
        With the same stamps. A position is unchanged if fewer than five are within half a second, or if their
        mean squared distance from the parabola is more than twice what `sigma_m` explains.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind, or `sigma_m` is not positive.
    """
    require_kind(stream, "position")
    require_positive("sigma_m", sigma_m)
    within_s = _SMOOTHED_WITHIN_S * (1 + _ROUNDING)
    count = min(int(within_s / stream.period_s), _MOST_SMOOTHED) if len(stream) > 1 else 0
    if count < 2:
        return stream
    about = np.arange(len(stream))[:, None] + np.arange(-count, count + 1)
    rows = np.clip(about, 0, len(stream) - 1)
    away = (stream.t_s[rows] - stream.t_s[:, None]) / _SMOOTHED_WITHIN_S
    within = (about == rows) & (np.abs(away) <= 1 + _ROUNDING)
    enough = np.count_nonzero(within, axis=1) >= _LEAST_SMOOTHED
    away, within, rows = away[enough], within[enough, :, None], rows[enough]
    powers = within * np.stack([np.ones_like(away), away, away**2], axis=-1)
    offsets = within * (stream.values[rows] - stream.values[enough, None])  # small, wherever the origin is
    transposed = np.swapaxes(powers, 1, 2)
    parabolas = np.linalg.solve(transposed @ powers, transposed @ offsets)
    freedom = 3 * (np.count_nonzero(within, axis=(1, 2)) - 3)
    squares = np.sum((offsets - powers @ parabolas) ** 2, axis=(1, 2))
    on_one = squares <= _LARGEST_VARIANCE_RATIO * sigma_m**2 * freedom
    values = stream.values.copy()
    values[enough] += np.where(on_one[:, None], parabolas[:, 0], 0.0)
    return replace(stream, values=values)


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
        If the stream is of another kind, or `origin` is not one.
    """
    require_kind(stream, "geodetic")
    start = stream.values[0] if origin is None else finite_array("origin", origin, (3,))
    local = east_north_up(stream.values, start)
    return replace(stream, values=local, kind="position")


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


def between_origins(source: WorldOrigin, target: WorldOrigin) -> Similarity:
    """Rigid motion from the world of one origin to that of another, exact for tangent planes, too.

    Parameters
    ----------
    source, target : WorldOrigin
        Both geodetic, or both in one metric frame.

    Returns
    -------
    Similarity
        target_from_source.

    Raises
    ------
    InvalidArgument
        If one is geodetic and the other is not, or a latitude is beyond ±90°.
    """
    if source.geodetic != target.geodetic:
        kinds = ("a latitude and longitude", "x, y, z")
        here, there = kinds if source.geodetic else kinds[::-1]
        raise InvalidArgument(f"origin: that of one world is {here}, of the other {there}: must be alike")
    if not source.geodetic:
        return Similarity(1.0, np.eye(3), source.place - target.place)
    axes, others = (_axes_east_north_up(origin.place) for origin in (source, target))
    offset = earth_centred(source.place[None])[0] - earth_centred(target.place[None])[0]
    return Similarity(1.0, others @ axes.T, others @ offset)


def middle_of(geodetic: FloatArray) -> FloatArray:
    """Median (3,) of latitudes, longitudes [deg] and heights [m] (n, 3), on either side of longitude 180°."""
    eastward = geodetic[:, 1] % 360.0
    middle, across = np.median(geodetic, axis=0), float(np.median(eastward))
    spread, spread_across = (
        float(np.median(np.abs(longitudes - about)))
        for longitudes, about in ((geodetic[:, 1], middle[1]), (eastward, across))
    )
    if spread_across < 0.5 * spread:  # not by rounding alone
        middle[1] = (across + 180.0) % 360.0 - 180.0
    return np.asarray(middle)


def require_metres(rows: FloatArray) -> None:
    """Raise InvalidArgument if positions (n, 3) look like latitudes and longitudes, or like millimetres."""
    usual = np.median(rows, axis=0) if len(rows) else np.zeros(3)  # one that is lost may be anywhere
    if not (np.abs(usual) <= _FARTHEST_M).all():
        found = ", ".join(f"{value:g}" for value in usual)
        raise InvalidArgument(
            f"gps: x, y, z are {found} m (median): must be at most {_FARTHEST_M:g} m; are they millimetres?"
        )
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


def doubt_of_radians(origin: FloatArray, local_m: FloatArray) -> list[str]:
    """Warn of latitudes and longitudes that seem to be in radians.

    Below ±π/2 and ±π all is open sea, off West Africa: who is there has to know that the warning is wrong.

    Parameters
    ----------
    origin : (3,) float64
        Latitude, longitude, as read [deg], and height [m] amid the positions.
    local_m : (n, 3) float64
        The positions, east, north, up of there [m]; not a number where unknown.

    Returns
    -------
    list of str
        The warning, if there is one.
    """
    known = local_m[np.isfinite(local_m).all(axis=1), :2]
    is_small = len(known) > 1 and float(np.ptp(known, axis=0).max()) < _RADIANS_WITHIN_M
    elsewhere = np.rad2deg(origin[:2])
    is_by_zero = (np.abs(elsewhere) < _MOST_RADIANS).all()  # in either unit
    if not is_small or is_by_zero or (np.abs(origin[:2]) > _MOST_RADIANS).any():
        return []
    return [
        f"latitudes and longitudes, about {origin[0]:.4g} and {origin[1]:.4g}, seem to be radians: as "
        f"degrees they are a small place in the sea off West Africa, as radians one at {elsewhere[0]:.4g}°, "
        f"{elsewhere[1]:.4g}°; put [rad] behind the names of their columns, or ignore this if it is that sea"
    ]


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
