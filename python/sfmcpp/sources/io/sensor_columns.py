"""Columns that a CSV file of sensor measurements can have: names, units and what they are turned into."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import pi

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LENGTH = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
_SPEED = {"m/s": 1.0, "km/h": 1 / 3.6}
_RATE = {"rad/s": 1.0, "deg/s": pi / 180}
_ANGLE = {"rad": 1.0, "deg": pi / 180}
_DEGREES = {"deg": 1.0, "rad": 180 / pi}
_NUMBER = {"": 1.0, "1": 1.0}

# Unit of a group of columns, and the columns that belong together.
GROUPS: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "time": (_TIME, ("t",)),
    "speed": (_SPEED, ("speed",)),
    "distance": (_LENGTH, ("distance",)),
    "velocity": (_SPEED, ("vx", "vy", "vz")),
    "angular_rate": (_RATE, ("wx", "wy", "wz")),
    "position": (_LENGTH, ("x", "y", "z")),
    "quaternion": (_NUMBER, ("qw", "qx", "qy", "qz")),
    "rotation_vector": (_ANGLE, ("rx", "ry", "rz")),
    "latitude_longitude": (_DEGREES, ("lat", "lon")),
    "height": (_LENGTH, ("height",)),
}

# Names in EuRoC's imu0/data.csv and a few common ones.
_ALIASES = {"time": "t", "timestamp": "t", "alt": "height", "latitude": "lat", "longitude": "lon"}
_ALIASES |= {f"w_RS_S_{axis}": f"w{axis}" for axis in "xyz"}
# The thesis (§5.3.4.2) uses no accelerations, and nor does this package.
_UNUSED = {"ax", "ay", "az", "a_RS_S_x", "a_RS_S_y", "a_RS_S_z"}

_HEADER = re.compile(r"#?\s*([^\[\]]+?)\s*(?:\[\s*([^\]]*?)\s*\])?\s*")


@dataclass(frozen=True)
class Column:
    """A column of a file: what it holds and the factor that makes its unit ours."""

    group: str
    name: str
    factor: float


def parse_column(header: str) -> Column | None:
    """Understand the header of a column, such as ``speed [km/h]``.

    Returns
    -------
    Column or None
        None for accelerations, which are not used.

    Raises
    ------
    ValueError
        If the name or the unit is unknown; the message lists the known ones.
    """
    match = _HEADER.fullmatch(header)
    if match is None:
        raise ValueError(f"column {header!r}: must be a name with a unit, such as 'speed [m/s]'")
    name, unit = _ALIASES.get(match[1], match[1]), _normal_unit(match[2] or "")
    if name in _UNUSED:
        return None
    for group, (units, names) in GROUPS.items():
        if name in names:
            return Column(group, name, _factor(header, unit, units))
    known = ", ".join(name for _, names in GROUPS.values() for name in names)
    raise ValueError(f"column {header!r} is unknown: must be one of {known}")


def _factor(header: str, unit: str, units: dict[str, float]) -> float:
    if unit not in units:
        what = f"has the unknown unit {unit!r}" if unit else "names no unit"
        raise ValueError(f"column {header!r} {what}: must be one of {', '.join(f'[{u}]' for u in units)}")
    return units[unit]


def _normal_unit(unit: str) -> str:
    return unit.replace(" s^-1", "/s").replace("°", "deg").replace(" ", "")
