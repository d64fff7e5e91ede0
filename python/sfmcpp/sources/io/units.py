"""Units in the headers of CSV files, such as ``[km/h]``, and the factors that make them ours."""

from __future__ import annotations

import math

# The foot of 1959; maps of the United States may be in feet of their survey, which differ by 4 m in 2,000 km.
LENGTH = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "us-ft": 1200 / 3937}
DEGREES = {"deg": 1.0, "rad": 180 / math.pi}

_ALIASES = {"°": "deg", "degree": "deg", "degrees": "deg", "decimaldegrees": "deg", "radians": "rad"}
_ALIASES |= dict.fromkeys(("metre", "metres", "meter", "meters"), "m")
_ALIASES |= {"foot": "ft", "feet": "ft", "usft": "us-ft", "ftus": "us-ft", "us-feet": "us-ft"}


def unit_factor(header: str, unit: str, units: dict[str, float]) -> float:
    """Look up the factor of `unit`, which stands in the header of a column.

    Raises
    ------
    ValueError
        If it is unknown or empty; the message lists the known ones.
    """
    normal = unit.replace(" s^-1", "/s").replace("°/", "deg/").replace(" ", "")
    normal = _ALIASES.get(normal.lower(), normal)
    if normal not in units:
        what = f"has the unknown unit {unit!r}" if unit else "names no unit"
        raise ValueError(f"column {header!r} {what}: must be one of {', '.join(f'[{u}]' for u in units)}")
    return units[normal]
