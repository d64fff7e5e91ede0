"""Positions whose degrees were rounded, as by a spreadsheet or by EXIF of whole seconds."""

from __future__ import annotations

import numpy as np

from sfmcpp.sensors.gps import geodetic_of
from sfmcpp.sfm.positions import Positions

# By what degrees may be rounded, and in words, the coarsest first; finer ones are finer than receivers are.
_STEPS = (
    *((10.0**-k, f"{10.0**-k:.{k}f}°") for k in (0, 1)),
    (1 / 60, "whole minutes"),
    (0.01, "0.01°"),
    (1 / 600, "0.1 minutes"),
    (0.001, "0.001°"),
    (1 / 3600, "whole seconds"),
    (1 / 6000, "0.01 minutes"),
    (0.0001, "0.0001°"),
)
# Of the degrees: what they lose in metres and back is less, and receivers tell no less.
_EQUAL_DEG = 2e-9
# Fewer may be round by chance.
_FEWEST = 3
_METRES_PER_DEGREE = 111_200.0


def doubt_of_rounding(positions: Positions) -> list[str]:
    """Warn of latitudes and longitudes that all are multiples of more than a receiver's accuracy.

    Parameters
    ----------
    positions : Positions
        With or without a latitude; those that are unknown tell nothing.

    Returns
    -------
    list of str
        The warning, if there is one.
    """
    metres = positions.metres[positions.known]
    metres = metres[np.isfinite(metres).all(axis=1)]
    if not positions.geodetic or len(metres) < _FEWEST:
        return []
    degrees = geodetic_of(metres, positions.origin)[:, :2]
    for step, words in _STEPS:
        if (np.abs(degrees - step * np.rint(degrees / step)) < _EQUAL_DEG).all():
            north_m = step * _METRES_PER_DEGREE
            return [
                f"latitudes and longitudes of the positions are rounded to {words}, {north_m:.0f} m to the "
                "north: place, scale and direction are no more exact; give all digits"
            ]
    return []
