"""Sensor measurements from CSV: a header of names with units, then one line for each time stamp.

For example::

    t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]
    0.00,36.1,0.1,0.0,-2.5
    0.04,36.0,,,

A cell left empty is a measurement that was not made at that time: sensors of different rates can share a
file. Cells may be apart by ``;`` or tabs, then with decimal commas, too. Columns of other names are left
out. EuRoC's ``imu0/data.csv`` is read as it is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from os import PathLike
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.so3 import angle_axis_from_rotation, rotation_from_quaternion
from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.sensor_stream import ImplausibleSample
from sfmcpp.sources.io.csv_text import (
    DEGREES,
    LENGTH,
    finite_number,
    match_of_header,
    numbered_lines,
    separator_of,
    unit_factor,
    with_decimal_points,
)
from sfmcpp.sources.io.number_text import number_of

UNIT_QUATERNION_TOLERANCE = 1e-2

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SPEED = {"m/s": 1.0, "km/h": 1 / 3.6}
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

_ADVICE = {"angular_rate": ": write 0 there if the body turns about one axis alone"}

# Names in EuRoC's imu0/data.csv and a few common ones.
_ALIASES = {"time": "t", "timestamp": "t", "latitude": "lat", "longitude": "lon", "lng": "lon"}
_ALIASES |= dict.fromkeys(("alt", "altitude", "elevation"), "height")
_ALIASES |= {f"w_RS_S_{axis}": f"w{axis}" for axis in "xyz"}
_NAMES = {name: name for _, names in GROUPS.values() for name in names} | _ALIASES
_KNOWN = {name.lower(): known for name, known in _NAMES.items()}  # in whatever case a file has them
# The thesis (§5.3.4.2) uses no accelerations, and nor does this package.
_UNUSED = {"ax", "ay", "az", "a_RS_S_x", "a_RS_S_y", "a_RS_S_z"}

# Groups that make a kind of measurement which has not the name of one; each way by itself.
_GROUPS_OF_KIND: dict[str, tuple[tuple[str, ...], ...]] = {
    "orientation": (("quaternion",), ("rotation_vector",)),
    "pose": (("position", "quaternion"), ("position", "rotation_vector")),
    "geodetic": (("latitude_longitude", "height"),),
}

# A unit stands in brackets of either kind.
_HEADER = re.compile(r"#?\s*([^\[\]()]+?)\s*(?:\[\s*([^\]]*?)\s*\]|\(\s*([^)]*?)\s*\))?\s*")

_LEFT_OUT = "-"  # a header that is the name of nothing

# Beside the columns, the line of the file that each row stands on.
_LINE = "line"

Table = dict[str, FloatArray]


def read_sensor_csv(
    path: str | PathLike[str],
    *,
    columns: Mapping[str, str | float] | None = None,
    max_gap_s: float | None = None,
    clock_offset_s: float = 0.0,
) -> dict[str, SensorStream]:
    """Read all the streams of a CSV file.

    Parameters
    ----------
    path : path-like
        The file; columns are ``t``; ``speed``; ``distance``; ``vx vy vz``; ``wx wy wz``; ``x y z``;
        ``qw qx qy qz`` or ``rx ry rz`` (world_from_body); ``lat lon height``, each with its unit in brackets.
    columns : mapping of str to str or float, optional
        Columns of which the file has names of its own, by ours with the unit: ``{"speed [km/h]": "Wheel"}``.
        A number that is no name stands on every line: ``{"wx [rad/s]": 0}``.
    max_gap_s : float, optional
        See :class:`SensorStream`.
    clock_offset_s : float
        Camera time − sensor time, added to every stamp [s].

    Returns
    -------
    dict of str to SensorStream
        By kind, in the units of :class:`SensorStream`. Position with orientation is a ``"pose"``.

    Raises
    ------
    DatasetError
        If the file cannot be read; no column is known; one lacks its unit or its companions; a cell is no
        finite number; the times do not increase; or a stream breaks a rule of :class:`SensorStream`, such as
        a unit that cannot be right.
    InvalidArgument
        If a key of `columns` is no column with its unit, or two are of one column; if a value is no text or
        number, or a number for all times.
    """
    source = Path(path)
    asked = [_Asked(header, own) for header, own in (columns or {}).items()]
    _require_different(asked)
    lines = numbered_lines(source)
    number, header = next(lines, (1, ""))
    separator = separator_of(header)
    headers = _split(header, separator)
    rows = [(number, _split(line, separator)) for number, line in lines]
    constants = [column for column in asked if not _renamed(source, number, headers, column)]
    known = _columns(source, number, headers, [column.column.name for column in constants])
    cells = _cells(source, known, rows, constants)
    try:
        streams = _streams(source, cells, max_gap_s)
        return {kind: stream.shifted(clock_offset_s) for kind, stream in streams.items()}
    except InvalidArgument as error:
        raise DatasetError(source, str(error)) from error


@dataclass(frozen=True)
class _Asked:
    """A column that a file has under a name of its own, or not at all."""

    header: str
    own: str | float

    def __post_init__(self) -> None:
        if not isinstance(self.own, str | Real):
            raise InvalidArgument(
                f"sensor_columns: {self.header!r} = {self.own!r}: must be a name or a number"
            )

    @cached_property
    def column(self) -> Column:
        """What it holds."""
        try:
            column = parse_column(self.header)
        except ValueError as error:
            raise InvalidArgument(f"sensor_columns: {error}") from None
        if column is None:
            raise InvalidArgument(f"sensor_columns: {self.header!r}: accelerations are not used")
        return column

    @property
    def number(self) -> float:
        """In our unit; NaN if it is no finite number."""
        own = number_of(self.own) if isinstance(self.own, str) else float(self.own)
        value = own * self.column.factor
        return value if math.isfinite(value) else math.nan


def _require_different(asked: list[_Asked]) -> None:
    headers: dict[str, str] = {}
    for one in asked:
        other = headers.setdefault(one.column.name, one.header)
        if other != one.header:
            raise InvalidArgument(
                f"sensor_columns: {other!r} and {one.header!r} are one column: must be told once"
            )


def _renamed(path: Path, number: int, headers: list[str], asked: _Asked) -> bool:
    """Give the column of the file our name, others of that name none; False if a number is asked for."""
    names = [found[1] if (found := match_of_header(_HEADER, text)) else text for text in headers]
    place = next((texts.index(str(asked.own)) for texts in (headers, names) if str(asked.own) in texts), None)
    if place is None and math.isnan(asked.number):
        reason = (
            f"holds no column {asked.own!r}, which is to be {asked.header!r}: it holds {', '.join(headers)}"
        )
        raise DatasetError(path, reason, number)
    if place is None and asked.column.name == "t":
        raise InvalidArgument(
            f"sensor_columns: {asked.header!r} = {asked.own!r}: must be a column, as times differ"
        )
    for k, name in enumerate(names):
        if _KNOWN.get(name.lower()) == asked.column.name:
            headers[k] = _LEFT_OUT
    if place is not None:
        headers[place] = asked.header
    return place is not None


def _with_constants(table: Table, constants: list[_Asked]) -> Table:
    """Columns of one number each; where the rest of their group is empty there was no measurement."""
    whole = dict(table)
    for asked in constants:
        beside = [table[name] for name in GROUPS[asked.column.group][1] if name in table]
        given = ~np.isnan(beside).any(axis=0) if beside else np.ones(len(table["t"]), dtype=np.bool_)
        whole[asked.column.name] = np.where(given, asked.number, np.nan)
    return whole


def _columns(path: Path, number: int, headers: list[str], constants: list[str]) -> list[Column | None]:
    try:
        columns = [None if _is_foreign(header) else parse_column(header) for header in headers]
        if {column.name for column in columns if column is not None} | {*constants} <= {"t"}:
            for header in headers:  # whichever is unknown is told
                parse_column(header)
    except ValueError as error:
        raise DatasetError(path, str(error), number) from None
    names = [column.name for column in columns if column is not None] + constants
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise DatasetError(path, f"columns named twice: {', '.join(sorted(repeated))}", number)
    for group, (_, wanted) in GROUPS.items():
        lacking = [name for name in wanted if name not in names]
        if lacking and (len(lacking) < len(wanted) or group == "time"):
            reason = f"the header lacks the column {', '.join(lacking)} of {group}{_ADVICE.get(group, '')}"
            raise DatasetError(path, reason, number)
    return columns


def left_out_columns(path: Path) -> list[str]:
    """Columns of a file, as its first line names them, that are not known by their name."""
    _, header = next(numbered_lines(path), (1, ""))
    return [column for column in _split(header, separator_of(header)) if _is_foreign(column)]


def _split(line: str, separator: str) -> list[str]:
    return [cell.strip() for cell in line.split(separator)]


def _is_foreign(header: str) -> bool:
    """Whether a column is left out, such as a temperature."""
    match = match_of_header(_HEADER, header)
    return match is not None and match[1].lower() not in _KNOWN


def _cells(
    path: Path, columns: list[Column | None], lines: list[tuple[int, list[str]]], constants: list[_Asked]
) -> Table:
    """Columns by name, in our units, NaN where a cell is empty."""
    numeric = [place for place, column in enumerate(columns) if column is not None]
    for number, cells in lines:
        if len(cells) != len(columns):
            raise DatasetError(path, f"the line holds {len(cells)} cells: must be {len(columns)}", number)
    pointed = with_decimal_points(path, lines, numeric)
    rows = [_row(path, number, cells, columns) for number, cells in pointed]
    if not rows:
        raise DatasetError(path, "holds no measurements")
    named = [column.name for column in columns if column is not None]
    table = dict(zip(named, np.array([row for _, row in rows]).T, strict=True))
    table = _with_constants(table, constants)
    late = np.flatnonzero(np.diff(table["t"]) <= 0)
    if len(late):
        row = int(late[0]) + 1
        reason = f"time {table['t'][row]:.9f} s after {table['t'][row - 1]:.9f} s: must increase"
        raise DatasetError(path, reason, rows[row][0])
    _require_whole_groups(path, table, [number for number, _ in rows])
    return table | {_LINE: np.array([number for number, _ in rows])}


def _row(path: Path, number: int, cells: list[str], columns: list[Column | None]) -> tuple[int, list[float]]:
    return number, [
        _number(path, number, cell, column)
        for cell, column in zip(cells, columns, strict=True)
        if column is not None
    ]


def _number(path: Path, number: int, cell: str, column: Column) -> float:
    if not cell and column.name != "t":
        return math.nan
    return finite_number(path, number, column.name, cell, column.factor)


def _require_whole_groups(path: Path, table: Table, numbers: list[int]) -> None:
    for group, (_, names) in GROUPS.items():
        if names[0] not in table:
            continue
        missing = np.isnan([table[name] for name in names])
        torn = missing.any(axis=0) & ~missing.all(axis=0)
        if torn.any():
            reason = f"only a part of {group} ({', '.join(names)}) is given"
            raise DatasetError(path, reason, numbers[int(np.argmax(torn))])


def _streams(path: Path, table: Table, max_gap_s: float | None) -> dict[str, SensorStream]:
    values: dict[str, FloatArray] = {
        group: _group(table, group) for group in ("speed", "distance", "velocity", "angular_rate", "position")
    }
    values["orientation"] = _orientations(path, table)
    if values["position"].size and values["orientation"].size:
        values["pose"] = np.hstack([values.pop("position"), values.pop("orientation")])
    values["geodetic"] = _geodetic(path, table)
    return {kind: _stream(path, table, v, kind, max_gap_s) for kind, v in values.items() if v.size}


def _stream(path: Path, table: Table, values: FloatArray, kind: str, max_gap_s: float | None) -> SensorStream:
    given = ~np.isnan(values).any(axis=1)
    try:
        return SensorStream(table["t"][given], values[given], kind, kind, max_gap_s)  # type: ignore[arg-type]
    except ImplausibleSample as error:
        raise DatasetError(path, str(error), int(table[_LINE][given][error.sample])) from error


def _group(table: Table, group: str) -> FloatArray:
    """Values (n, k) of the columns of a group, (n, 0) if the file has none."""
    names = GROUPS[group][1]
    found = [table[name] for name in names if name in table]
    return np.stack(found, axis=1) if found else np.empty((len(table["t"]), 0))


def _orientations(path: Path, table: Table) -> FloatArray:
    quaternions, vectors = _group(table, "quaternion"), _group(table, "rotation_vector")
    if not quaternions.size:
        return vectors
    if vectors.size:
        raise DatasetError(path, "gives the orientation twice: by qw qx qy qz and by rx ry rz", 1)
    given = ~np.isnan(quaternions[:, 0])
    unit = finite_array("quaternion", quaternions[given], (-1, 4))
    wrong = np.abs(np.linalg.norm(unit, axis=1) - 1) > UNIT_QUATERNION_TOLERANCE
    if wrong.any():
        time, found = table["t"][given][wrong][0], unit[wrong][0].tolist()
        raise DatasetError(path, f"the quaternion at {time:.6f} s is {found}: must have length 1")
    result = np.full((len(quaternions), 3), np.nan)
    result[given] = angle_axis_from_rotation(rotation_from_quaternion(unit))
    return result


def _geodetic(path: Path, table: Table) -> FloatArray:
    horizontal, height = _group(table, "latitude_longitude"), _group(table, "height")
    if bool(horizontal.size) != bool(height.size):
        given = "lat and lon" if horizontal.size else "height"
        raise DatasetError(path, f"lat, lon and height must be given together: it has {given} alone", 1)
    return np.hstack([horizontal, height])


@dataclass(frozen=True)
class Column:
    """A column of a file: what it holds and the factor that makes its unit ours."""

    group: str
    name: str
    factor: float


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
    match = match_of_header(_HEADER, header)
    if match is None:
        raise ValueError(f"column {header!r}: must be a name with a unit, such as 'speed [m/s]'")
    name, unit = _KNOWN.get(match[1].lower(), match[1]), match[2] or match[3] or ""
    if name in _UNUSED:
        return None
    for group, (units, names) in GROUPS.items():
        if name in names:
            return Column(group, name, unit_factor(header, unit, units))
    known = ", ".join(name for _, names in GROUPS.values() for name in names)
    raise ValueError(
        f"column {header!r} is unknown: must be one of {known}, with its unit: 't [s]', 'speed [km/h]'; "
        f"or say which it is: --sensor-column 'speed [m/s]={header}'"
    )
