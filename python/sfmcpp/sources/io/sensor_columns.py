"""Columns of a sensor file: their names, the units that they may have, and what they measure together."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from sfmcpp.sources.io.csv_text import DEGREES, LENGTH, match_of_header, unit_factor

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SPEED = {"m/s": 1.0, "km/h": 1 / 3.6, "cm/s": 1e-2, "mm/s": 1e-3, "ft/s": 0.3048}
_SPEED |= {"mph": 0.44704, "kn": 1852 / 3600}
_RATE = {"rad/s": 1.0, "deg/s": math.pi / 180}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180}
_NUMBER = {"": 1.0, "1": 1.0}

# Unit of a group of columns, and the columns that belong together.
GROUPS: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "time": (_TIME, ("t",)),
    "speed": (_SPEED, ("speed",)),
    "distance": (LENGTH, ("distance",)),
    "velocity": (_SPEED, ("vx", "vy", "vz")),
    "angular_rate": (_RATE, ("wx", "wy", "wz")),
    "position": (LENGTH, ("x", "y", "z")),
    "quaternion": (_NUMBER, ("qw", "qx", "qy", "qz")),
    "rotation_vector": (_ANGLE, ("rx", "ry", "rz")),
    "latitude_longitude": (DEGREES, ("lat", "lon")),
    "height": (LENGTH, ("height",)),
}

# What to do where a file has a part of a group.
ADVICE = {
    "time": ": where it has another name, say --sensor-column 't [s]=NAME'",
    "velocity": ": a speed along the body's x axis alone is the column 'speed'",
    "angular_rate": ": write 0 there if the body turns about one axis alone",
    "position": ": write 0 there if heights were not measured, on level ground",
}

# Names in EuRoC's imu0/data.csv and a few common ones.
_ALIASES = {"time": "t", "timestamp": "t", "latitude": "lat", "longitude": "lon", "lng": "lon"}
_ALIASES |= dict.fromkeys(("alt", "altitude", "elevation"), "height")
_ALIASES |= {f"w_RS_S_{axis}": f"w{axis}" for axis in "xyz"}
_NAMES = {name: name for _, names in GROUPS.values() for name in names} | _ALIASES
KNOWN = {name.lower(): known for name, known in _NAMES.items()}  # in whatever case a file has them
# The thesis (§5.3.4.2) uses no accelerations, and nor does this package.
_UNUSED = {"ax", "ay", "az", "a_RS_S_x", "a_RS_S_y", "a_RS_S_z"}

# Groups that make a kind of measurement which has not the name of one; each way by itself.
_GROUPS_OF_KIND: dict[str, tuple[tuple[str, ...], ...]] = {
    "orientation": (("quaternion",), ("rotation_vector",)),
    "pose": (("position", "quaternion"), ("position", "rotation_vector")),
    "geodetic": (("latitude_longitude", "height"),),
}

# A unit stands in brackets of either kind.
HEADER = re.compile(r"#?\s*([^\[\]()]+?)\s*(?:\[\s*([^\]]*?)\s*\]|\(\s*([^)]*?)\s*\))?\s*")


def is_foreign(header: str) -> bool:
    """Whether a column is left out, such as a temperature, or one without a name."""
    match = match_of_header(HEADER, header)
    return not header or (match is not None and match[1].lower() not in KNOWN)


@dataclass(frozen=True)
class Column:
    """A column of a file: what it holds and the factor that makes its unit ours."""

    group: str
    name: str
    factor: float


def groups_of(kind: str) -> set[str]:
    """All groups of columns that may give a kind of measurement."""
    return {group for way in _GROUPS_OF_KIND.get(kind, ((kind,),)) for group in way}


def columns_of(kind: str) -> str:
    """Names of the columns that give a kind of measurement, in words."""
    groups = _GROUPS_OF_KIND.get(kind, ((kind,),))
    return " or ".join(" ".join(name for group in way for name in GROUPS[group][1]) for way in groups)


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
    match = match_of_header(HEADER, header)
    if match is None:
        raise ValueError(f"column {header!r}: must be a name with a unit, such as 'speed [m/s]'")
    name, unit = KNOWN.get(match[1].lower(), match[1]), match[2] or match[3] or ""
    if name in _UNUSED:
        return None
    for group, (units, names) in GROUPS.items():
        if name in names:
            return Column(group, name, unit_factor(header, unit, units))
    known = ", ".join(name for _, names in GROUPS.values() for name in names)
    raise ValueError(
        f"column {header!r} is unknown: must be one of {known}, with its unit: 't [s]', 'speed [km/h]'; "
        f"or say which it is: --sensor-column 'NAME [UNIT]={header}'"
    )
