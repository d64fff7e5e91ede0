"""Positions from the centre of the Earth (ECEF), where z points to the pole and not up."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.gps import SEMI_MAJOR_AXIS_M, geodetic_of

# No camera is so far above or below the ellipsoid, and no z that is a height is so large [m].
_HIGHEST_M = 20_000.0


def doubt_of_geocentric(places: FloatArray) -> list[str]:
    """Warn of x, y, z that lie on the surface of the Earth as seen from its centre.

    Parameters
    ----------
    places : (n, 3) float64
        As given [m]; not a number where unknown.

    Returns
    -------
    list of str
        The warning, if there is one.
    """
    known = places[np.isfinite(places).all(axis=1)]
    if not len(known):
        return []
    x, y, z = np.median(known, axis=0)
    if not _HIGHEST_M < abs(z) < 2 * SEMI_MAJOR_AXIS_M:
        return []
    # East, north and up of latitude and longitude 0 are y, z and x.
    latitude, longitude, height = geodetic_of([[y, z, x - SEMI_MAJOR_AXIS_M]], [0.0, 0.0, 0.0])[0]
    if abs(height) > _HIGHEST_M:
        return []
    return [
        f"x, y, z of the positions, about {x:.0f}, {y:.0f}, {z:.0f} m, are those of {latitude:.4f}°, "
        f"{longitude:.4f}° from the centre of the Earth (geocentric, ECEF): z of the result points to the "
        "pole, not up; give lat, lon, height for a model that is east, north, up"
    ]
