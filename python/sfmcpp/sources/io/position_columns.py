"""Columns of tables of positions: which of them hold the axes and their standard deviations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.csv_text import (
    BLANK,
    DEGREES,
    LENGTH,
    cells_of,
    finite_number,
    match_of_header,
    separator_of,
    unit_factor,
)
from sfmcpp.sources.io.hemisphere_columns import hemisphere_places, signed
from sfmcpp.sources.io.position_text import degrees_of_text, metres_of_text

Triple = tuple[float, float, float]
NumberedLine = tuple[int, str]
Row = tuple[int, list[str]]
_NAMES = (
    *("name", "image", "file", "filename", "label", "photo", "sourcefile"),
    *("image name", "file name", "photo name"),
)
_INDEX = ("index", "number", "camera")
# Heights above the ellipsoid are preferred to those that may be above the sea.
_HEIGHTS = ("ellipsoidal height", "ellipsoid height", "height", "alt", "altitude", "elevation", "h")
_GEODETIC = (("lat", "latitude"), ("lon", "lng", "longitude", "long"), _HEIGHTS)
_METRIC = (("x", "east", "e", "easting"), ("y", "north", "n", "northing"), ("z", "up", "u", *_HEIGHTS))
# Of latitude, longitude, height.
_HEMISPHERES = ("NS", "EW", "")
_ALL_AXES = "x y z"
_LEVEL = ("horizontal", "horz", "h", "lateral", "x y")
_SIGMAS = (
    ("x", "e", "east", "easting", "lon", "longitude", *_LEVEL, _ALL_AXES),
    ("y", "n", "north", "northing", "lat", "latitude", *_LEVEL, _ALL_AXES),
    ("z", "u", "up", "height", "alt", "altitude", "elevation", "vertical", "vert", "v", _ALL_AXES),
)
_SPREAD = {"sigma", "std", "stddev", "stdev", "standard", "dev", "deviation", "sd", "accuracy"}
# Those of RTKLIB, of u-blox and of DJI's photos, in one word.
_SPREAD_OF_AXIS = {f"{word}{axis}": axis for word in ("sd", "std") for axis in "neuxyz"}
_SPREAD_OF_AXIS |= {"hacc": "h", "vacc": "v", "rtkstdlon": "lon", "rtkstdlat": "lat", "rtkstdhgt": "height"}
# A standard deviation only together with an axis; alone it may be that of anything.
_RMS = "rms"
# What else seems to be a standard deviation, but of an angle.
_LIKE_SPREAD = re.compile(r"acc|.*(?:sigma|std|accuracy|rms|positioningerror)|(?:sigma|std).+")
_ANGLES = {"yaw", "pitch", "roll", "heading", "omega", "phi", "kappa"}
# Metashape names an axis in two ways at once: X/Longitude, Y/North.
_AXIS_TWICE = re.compile(r"[xyz]/(?=\w{3})")
# So many words without another separator are titles of columns.
_TITLES = 4
# So many numbers are a line of a table, no header.
_NUMBERS = 3
_PROJECTION = re.compile(r"(epsg:\s*\d+|wgs\s*84.*|\+proj=.*)", re.IGNORECASE)
_DEGREES = re.compile(r"epsg:\s*4326|wgs\s*84|.*\+proj=(longlat|latlong).*", re.IGNORECASE)
_WITH_UNIT = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")


def names_projection(line: str) -> bool:
    """Whether a line is the first of a list of OpenDroneMap: it names the projection of all others."""
    return _PROJECTION.fullmatch(line.strip()) is not None


def projection_is_degrees(line: str) -> bool:
    """Whether such a projection is longitude and latitude; any other is taken as metres."""
    return _DEGREES.fullmatch(line.strip()) is not None


def position_of_list(source: Path, line: int, cells: Sequence[str], *, geodetic: bool) -> Triple:
    """Read x y z in the first cells of a line of such a list; longitude comes first there, not here.

    Raises
    ------
    DatasetError
        If one is no finite number, or out of its range.
    """
    x, y, z = (finite_number(source, line, name, cell) for name, cell in zip("xyz", cells, strict=False))
    if geodetic and not (abs(x) <= 180 and abs(y) <= 90):
        raise DatasetError(source, f"longitude {x:g}°, latitude {y:g}°: out of range, or swapped", line)
    return (y, x, z) if geodetic else (x, y, z)


def table_of(source: Path, numbered: Sequence[NumberedLine]) -> tuple[Row, list[Row]]:
    """Split the lines of a table: numbers and cells of the header and the others, as many as the header has.

    Raises
    ------
    DatasetError
        If there is no line, or one has more cells than the header.
    """
    lines = _without_comments(numbered)
    if not lines:
        raise DatasetError(source, "is empty")
    separator = _separator(lines[0][1])
    split = [(number, cells_of(source, number, line, separator)) for number, line in lines]
    count = len(split[0][1])
    for number, cells in split:
        if any(cells[count:]):
            rule = f"must be {count}; where commas are decimal, cells are separated by ';' or tabs"
            raise DatasetError(source, f"the line holds {len(cells)} cells: {rule}", number)
    header, *rows = [(number, (cells + [""] * count)[:count]) for number, cells in split]
    return header, rows


def _separator(header: str) -> str:
    """That of its cells: blanks where there is no other, but words for a position and what has it."""
    found = separator_of(header)
    return BLANK if found not in header and len(header.split()) >= _TITLES else found


def _without_comments(lines: Sequence[NumberedLine]) -> list[NumberedLine]:
    """The header, which may begin as comments do, and the lines that do not."""
    is_comment = [line.lstrip().startswith("#") for _, line in lines]
    rows = [line for line, comment in zip(lines, is_comment, strict=True) if not comment]
    leading = lines[: is_comment.index(False) if rows else len(lines)]
    if leading and (separator_of(leading[-1][1]) in leading[-1][1] or not rows):
        return [leading[-1], *rows]
    return rows


@dataclass(frozen=True)
class Column:
    """A column of numbers.

    Attributes
    ----------
    place : int
        Which one it is, from 0.
    header : str
        As the file has it.
    factor : float
        Makes its unit ours.
    """

    place: int
    header: str
    factor: float


@dataclass(frozen=True)
class PositionColumns:
    """Columns that hold the position of an image.

    Attributes
    ----------
    axes : sequence of 3 Column
        Latitude, longitude and height, or x, y and z.
    geodetic : bool
        Which of both.
    sigmas : sequence of 3 Column
        Standard deviations along x, y and z; empty if the file has none.
    name, index : int or None
        The columns of names and of numbers of images.
    hemispheres : tuple of int or None
        For each axis the column that tells its sign, if there is one.
    """

    axes: Sequence[Column]
    geodetic: bool
    sigmas: Sequence[Column]
    name: int | None
    index: int | None
    hemispheres: tuple[int | None, ...] = (None, None, None)

    @classmethod
    def of(cls, headers: Sequence[str], *, numbered: bool) -> PositionColumns:
        """Find the columns by their headers, without regard to case.

        Raises
        ------
        ValueError
            If some are missing, a unit is unknown, or they are no names but numbers.
        """
        if sum(map(_is_number, headers)) >= _NUMBERS:
            rule = "must be a header, such as name,lat,lon,height or name,x,y,z"
            raise ValueError(f"the first line holds numbers ({', '.join(headers)}): {rule}")
        titles = [normalised_header(header) for header in headers]
        name = index_of_first(titles, _NAMES)
        latitude_first, cartesian = (_indices_of_groups(titles, groups) for groups in (_GEODETIC, _METRIC))
        places = latitude_first or cartesian
        if places is None or (name is None and not numbered):
            rule = "must have name and lat, lon, height, or name and x, y, z"
            raise ValueError(f"its columns are {', '.join(headers)}: {rule}")
        geodetic = latitude_first is not None
        units = (DEGREES, DEGREES, LENGTH) if geodetic else (LENGTH,) * 3
        axes = [_column(headers, place, unit) for place, unit in zip(places, units, strict=True)]
        hemispheres = hemisphere_places(titles) if geodetic else (None, None, None)
        return cls(axes, geodetic, _sigma_columns(headers), name, index_of_first(titles, _INDEX), hemispheres)

    def position(self, source: Path, line: int, cells: Sequence[str]) -> Triple:
        """Read the position in a line.

        Raises
        ------
        DatasetError
            If a cell is no finite number, a latitude or longitude is out of its range, or a hemisphere is
            none or contradicts its sign.
        """
        x, y, z = (self._coordinate(source, line, cells, axis) for axis in range(3))
        if self.geodetic and not (abs(x) <= 90 and abs(y) <= 180):
            raise DatasetError(source, f"latitude {x:g}°, longitude {y:g}°: out of range, or swapped", line)
        return x, y, z

    def _coordinate(self, source: Path, line: int, cells: Sequence[str], axis: int) -> float:
        hemispheres = _HEMISPHERES[axis] if self.geodetic else ""
        value = _number(source, line, cells[self.axes[axis].place], self.axes[axis], hemispheres)
        place = self.hemispheres[axis]
        return value if place is None else signed(source, line, axis, value, cells[place])

    def spread(self, source: Path, line: int, cells: Sequence[str]) -> Triple:
        """Read the standard deviations in a line.

        Raises
        ------
        DatasetError
            If a cell is no finite number, or not positive.
        """
        x, y, z = _numbers(source, line, cells, self.sigmas)
        if not min(x, y, z) > 0:
            raise DatasetError(source, f"standard deviation {min(x, y, z):g}: must be positive", line)
        return x, y, z

    @property
    def numeric(self) -> list[int]:
        """Which columns hold numbers."""
        return [column.place for column in (*self.axes, *self.sigmas)]


def _numbers(source: Path, line: int, cells: Sequence[str], columns: Sequence[Column]) -> Triple:
    x, y, z = (_number(source, line, cells[column.place], column) for column in columns)
    return x, y, z


def _number(source: Path, line: int, cell: str, column: Column, hemispheres: str = "") -> float:
    """A number, or a coordinate with its unit: an angle if there are `hemispheres`, else a height."""
    printed = degrees_of_text(cell, hemispheres) if hemispheres else metres_of_text(cell)
    other = f", or an angle with {' or '.join(hemispheres)}" if hemispheres else ""
    return (
        finite_number(source, line, column.header, cell, column.factor, other) if printed is None else printed
    )


def _sigma_columns(headers: Sequence[str]) -> list[Column]:
    titles = [_spread_axis(header) for header in headers]
    places = _indices_of_groups(titles, _SIGMAS)
    stated = [
        header for header, title in zip(headers, titles, strict=True) if any(title in s for s in _SIGMAS)
    ]
    if places is None and stated:
        rule = "must be sigma_x, sigma_y, sigma_z, or sigma_horizontal, sigma_vertical, or one sigma"
        raise ValueError(f"its standard deviations are {', '.join(stated)}: {rule}")
    return [_column(headers, place, LENGTH) for place in places or ()]


def spreads_by_look(headers: Sequence[str]) -> tuple[str, ...]:
    """Headers of columns that seem to be standard deviations of positions, by any name."""
    words = [_words(header) for header in headers]
    alike = [any(map(_LIKE_SPREAD.fullmatch, of_one)) and not _ANGLES & set(of_one) for of_one in words]
    return tuple(header for header, seems in zip(headers, alike, strict=True) if seems)


def _column(headers: Sequence[str], place: int, units: dict[str, float]) -> Column:
    """Make a column of numbers, in our unit where it names none."""
    header = headers[place]
    unit = _header_and_unit(header)[1]
    return Column(place, header, unit_factor(header, unit, units) if unit else 1.0)


def _header_and_unit(header: str) -> tuple[str, str]:
    match = match_of_header(_WITH_UNIT, header)
    return (header, "") if match is None else (match[1], match[2] or "")


def _words(header: str) -> list[str]:
    title = _AXIS_TWICE.sub("", _header_and_unit(header)[0].lower(), count=1)
    return re.findall(r"[^\W_]+", title.replace("gps", "", 1))


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def normalised_header(header: str) -> str:
    """The words of a header without its unit, in small letters."""
    return " ".join(_words(header))


def _spread_axis(header: str) -> str:
    """The axis that a header names a standard deviation along, or all; empty if it names none."""
    words = [word for word in _words(header) if word != "position"]
    if len(words) == 1 and words[0] in _SPREAD_OF_AXIS:
        return _SPREAD_OF_AXIS[words[0]]
    axis = " ".join(word for word in words if word not in _SPREAD and word != _RMS)
    if _SPREAD & set(words):
        return axis or _ALL_AXES
    return axis if _RMS in words else ""


def index_of_first(titles: Sequence[str], names: Sequence[str]) -> int | None:
    """Where the first of the `names` that is there stands among the `titles`."""
    return next((titles.index(name) for name in names if name in titles), None)


def _indices_of_groups(titles: Sequence[str], groups: Sequence[Sequence[str]]) -> list[int] | None:
    places = [index_of_first(titles, names) for names in groups]
    return [place for place in places if place is not None] if None not in places else None
