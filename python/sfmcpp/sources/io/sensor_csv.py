"""Sensor measurements from CSV: a header of names with units, then one line for each time stamp.

For example::

    t [s],speed [km/h],wx [deg/s],wy [deg/s],wz [deg/s]
    0.00,36.1,0.1,0.0,-2.5
    0.04,36.0,,,

A cell left empty is a measurement that was not made at that time: sensors of different rates can share a
file, and have lines of their own. Where a cell is ``NaN``, ``NA`` or another word for no value, the
measurement is left out, and its stream tells of it; so is one that is repeated with its time, and the last
line of a log that was cut off. Cells may be apart by ``;`` or tabs, then with decimal commas, too, and
between double quotes. Columns of other names are left out, and so are lines that start with ``#``, but for a
header that does. Times may be those of ISO 8601, without a unit. EuRoC's ``imu0/data.csv`` is read as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from os import PathLike
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.so3 import angle_axis_from_rotation, rotation_from_quaternion
from sfmcpp.model import SensorStream
from sfmcpp.model.arrays import BoolArray, FloatArray, finite_array
from sfmcpp.model.sensor_stream import ImplausibleSample
from sfmcpp.sources.io.csv_text import (
    cells_of,
    finite_number,
    match_of_header,
    numbered_lines,
    separator_of,
    with_decimal_points,
)
from sfmcpp.sources.io.cut_lines import emptied_if_zeros, without_cut_line
from sfmcpp.sources.io.hemisphere_columns import hemisphere_places, with_hemispheres
from sfmcpp.sources.io.iso_times import seconds_of_iso
from sfmcpp.sources.io.missing_values import Line, without_missing
from sfmcpp.sources.io.number_text import number_of
from sfmcpp.sources.io.position_columns import normalised_header
from sfmcpp.sources.io.sensor_columns import (
    ADVICE,
    GROUPS,
    HEADER,
    KNOWN,
    Column,
    groups_of,
    is_foreign,
    parse_column,
)

UNIT_QUATERNION_TOLERANCE = 1e-2

_GEODETIC = ("lat", "lon", "height")
_LEFT_OUT = "-"  # a header that is the name of nothing

# Beside the columns, the line of the file that each row stands on.
_LINE = "line"

# Beside the lines on which groups have no value, the one that was cut off.
_CUT = "cut"

Table = dict[str, FloatArray]
# Lines on which a group of columns has no value, by the group.
_Missing = Mapping[str, Sequence[int]]


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
        finite number; the times of a stream do not increase; or a stream breaks a rule of
        :class:`SensorStream`, such as a unit that cannot be right.
    InvalidArgument
        If a key of `columns` is no column with its unit, or two are of one column; if a value is no text or
        number, or a number for all times.
    """
    source = Path(path)
    asked = [_Asked(header, own) for header, own in (columns or {}).items()]
    _require_different(asked)
    (number, headers), rows = _split(source)
    _name_unit_of_iso_times(headers, rows)
    constants = [column for column in asked if not _renamed(source, number, headers, column)]
    known = _columns(source, number, headers, [column.column.name for column in constants])
    names = ["" if column is None else column.name for column in known]
    coordinates = [names.index(name) if name in names else None for name in _GEODETIC]
    rows = with_hemispheres(source, _titles(headers), coordinates, rows)
    cells, missing = _cells(source, known, rows, constants)
    try:
        streams = _streams(source, cells, missing, max_gap_s)
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
    names = [found[1] if (found := match_of_header(HEADER, text)) else text for text in headers]
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
        if KNOWN.get(name.lower()) == asked.column.name:
            headers[k] = _LEFT_OUT
    if place is not None:
        headers[place] = asked.header
    return place is not None


def _name_unit_of_iso_times(headers: list[str], rows: list[Line]) -> None:
    """Where cells below a header of times without a unit are times in ISO 8601, these make seconds."""
    first = rows[0][1] if rows else []
    for place, (header, cell) in enumerate(zip(headers, first, strict=False)):
        if KNOWN.get(header.lower()) == "t" and seconds_of_iso(cell) is not None:
            headers[place] = "t [s]"


def _with_constants(table: Table, constants: list[_Asked]) -> Table:
    """Columns of one number each; where the rest of their group is empty there was no measurement."""
    whole = dict(table)
    for asked in constants:
        beside = [table[name] for name in GROUPS[asked.column.group][1] if name in table]
        given = ~np.isnan(beside).any(axis=0) if beside else np.ones(len(table["t"]), dtype=np.bool_)
        whole[asked.column.name] = np.where(given, asked.number, np.nan)
    return whole


def _columns(path: Path, number: int, headers: list[str], constants: list[str]) -> list[Column | None]:
    if all(math.isfinite(number_of(header)) for header in headers):
        raise DatasetError(path, "holds numbers: must name the columns, as 't [s],speed [m/s]'", number)
    try:
        columns = [None if is_foreign(header) else parse_column(header) for header in headers]
        if {column.name for column in columns if column is not None} | {*constants} <= {"t"}:
            for header in filter(None, headers):  # whichever is unknown is told
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
            reason = f"the header lacks the column {', '.join(lacking)} of {group}{ADVICE.get(group, '')}"
            raise DatasetError(path, reason, number)
    return columns


def left_out_columns(path: Path) -> list[str]:
    """Columns of a file, as its first line names them, that are not known by their name."""
    (_, headers), _ = _split(path)
    hemispheres = hemisphere_places(_titles(headers))
    return [h for place, h in enumerate(headers) if h and is_foreign(h) and place not in hemispheres]


def _titles(headers: list[str]) -> list[str]:
    return [normalised_header(header) for header in headers]


def _split(path: Path) -> tuple[Line, list[Line]]:
    """The header, which may begin as comments do, and the lines that do not."""
    lines = emptied_if_zeros(list(numbered_lines(path)))
    is_comment = [line.lstrip().startswith("#") for _, line in lines]
    start = is_comment.index(False) if False in is_comment else len(lines)
    if start and (start == len(lines) or _holds_number(path, lines[start])):
        start -= 1
    number, header = lines[start] if lines else (1, "")
    separator = separator_of(header)
    below = [row for row, comment in zip(lines, is_comment, strict=True) if not comment and row[0] > number]
    rows = [(below_number, cells_of(path, below_number, line, separator)) for below_number, line in below]
    return (number, cells_of(path, number, header, separator)), rows


def _holds_number(path: Path, line: tuple[int, str]) -> bool:
    """Whether a line is one of measurements, no header."""
    return any(math.isfinite(number_of(cell)) for cell in cells_of(path, *line, separator_of(line[1])))


def _cells(
    path: Path, columns: list[Column | None], lines: Sequence[Line], constants: list[_Asked]
) -> tuple[Table, _Missing]:
    """Columns by name, in our units, NaN where a cell has no value; and where it says so in a word."""
    numeric = {place: column.group for place, column in enumerate(columns) if column is not None}
    groups = {g: [place for place in numeric if numeric[place] == g] for g in {*numeric.values()} - {"time"}}
    lines, cut = without_cut_line(path, lines, len(columns), groups.values())
    for number, cells in lines:
        if len(cells) < len(columns) or any(cells[len(columns) :]):
            rule = f"must be {len(columns)}; where commas are decimal, cells are separated by ';' or tabs"
            raise DatasetError(path, f"the line holds {len(cells)} cells: {rule}", number)
    whole, missing = without_missing(lines, groups)
    pointed = with_decimal_points(path, whole, [*numeric])
    rows = [_row(path, number, cells, columns) for number, cells in pointed]
    if not rows:
        raise DatasetError(path, "holds no measurements")
    named = [column.name for column in columns if column is not None]
    table = dict(zip(named, np.array([row for _, row in rows]).T, strict=True))
    table = _with_constants(table, constants)
    _require_whole_groups(path, table, [number for number, _ in rows])
    return table | {_LINE: np.array([number for number, _ in rows])}, missing | {_CUT: cut}


def _row(path: Path, number: int, cells: list[str], columns: list[Column | None]) -> tuple[int, list[float]]:
    return number, [
        _number(path, number, cell, column)
        for cell, column in zip(cells, columns, strict=False)
        if column is not None
    ]


def _number(path: Path, number: int, cell: str, column: Column) -> float:
    if not cell and column.name != "t":
        return math.nan
    if column.name == "t" and (seconds := seconds_of_iso(cell)) is not None:
        return seconds
    empty = "" if column.name == "t" else ", or none where nothing was measured: an empty cell"
    return finite_number(path, number, column.name, cell, column.factor, empty)


def _require_whole_groups(path: Path, table: Table, numbers: list[int]) -> None:
    for group, (_, names) in GROUPS.items():
        if names[0] not in table:
            continue
        missing = np.isnan([table[name] for name in names])
        torn = missing.any(axis=0) & ~missing.all(axis=0)
        if torn.any():
            reason = f"only a part of {group} ({', '.join(names)}) is given"
            raise DatasetError(path, reason, numbers[int(np.argmax(torn))])


def _streams(path: Path, table: Table, missing: _Missing, max_gap_s: float | None) -> dict[str, SensorStream]:
    values: dict[str, FloatArray] = {
        group: _group(table, group) for group in ("speed", "distance", "velocity", "angular_rate", "position")
    }
    values["orientation"] = _orientations(path, table)
    if values["position"].size and values["orientation"].size:
        values["pose"] = np.hstack([values.pop("position"), values.pop("orientation")])
    values["geodetic"] = _geodetic(path, table)
    given = {kind: v for kind, v in values.items() if v.size and not np.isnan(v).any(axis=1).all()}
    if not given:
        raise DatasetError(path, "holds no measurements")
    return {kind: _stream(path, table, v, kind, missing, max_gap_s) for kind, v in given.items()}


def _stream(
    path: Path, table: Table, values: FloatArray, kind: str, missing: _Missing, max_gap_s: float | None
) -> SensorStream:
    given = np.flatnonzero(~np.isnan(values).any(axis=1))
    repeated = _repeated(np.column_stack([table["t"], values])[given])
    kept, again = given[~repeated], table[_LINE][given[repeated]]
    t_s, line = table["t"][kept], table[_LINE][kept]
    _require_increasing(path, kind, t_s, line)
    empty = sorted({number for group in groups_of(kind) for number in missing.get(group, ())})
    left_out = _told("without a value", empty) + _told("like the one before", again.tolist())
    left_out += _told("cut off at the end of the file", missing[_CUT])
    try:
        return SensorStream(t_s, values[kept], kind, kind, max_gap_s, " and ".join(left_out))
    except ImplausibleSample as error:
        raise DatasetError(path, str(error), int(line[error.sample])) from error


def _repeated(rows: FloatArray) -> BoolArray:
    """Which of the rows (n, k) are the one before, to the last bit: a logger that writes lines twice."""
    return np.concatenate([np.zeros(1, dtype=np.bool_), (rows[1:] == rows[:-1]).all(axis=1)])


def _require_increasing(path: Path, kind: str, t_s: FloatArray, lines: FloatArray) -> None:
    late = np.flatnonzero(np.diff(t_s) <= 0)
    if not len(late):
        return
    before, row = int(late[0]), int(late[0]) + 1
    told = f"{kind} at {t_s[row]:.9f} s after {t_s[before]:.9f} s in line {int(lines[before])}"
    same = "; of several measurements at one time, keep one" if t_s[row] == t_s[before] else ""
    raise DatasetError(path, f"{told}: time must increase{same}", int(lines[row]))


def _told(what: str, lines: Sequence[int]) -> list[str]:
    """How many lines are left out, and the first, in words; nothing for none."""
    return [f"{len(lines)} line{'s' * (len(lines) > 1)} {what}, first line {lines[0]}"] if lines else []


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
        rule = "where heights were not measured, on level ground, say --sensor-column 'height [m]=0'"
        alone = f"lat, lon and height must be given together: it has {given} alone"
        raise DatasetError(path, f"{alone}; {rule}" if horizontal.size else alone, 1)
    return np.hstack([horizontal, height])
