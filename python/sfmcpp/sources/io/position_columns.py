"""Which columns of a CSV file hold positions of images, by the names that people and receivers give them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from sfmcpp.sources.io.units import DEGREES, LENGTH, unit_factor

_NAMES = (
    *("name", "image", "file", "filename", "label", "photo", "sourcefile"),
    *("image name", "file name", "photo name"),
)
_INDEX = ("index", "number", "camera")
# Heights above the ellipsoid go before those that may be others.
_HEIGHTS = ("ellipsoidal height", "ellipsoid height", "height", "alt", "altitude", "elevation", "h")
_GEODETIC = (("lat", "latitude"), ("lon", "lng", "longitude", "long"), _HEIGHTS)
_METRIC = (("x", "east", "e", "easting"), ("y", "north", "n", "northing"), ("z", "up", "u", *_HEIGHTS))
_ALL_AXES = "x y z"
_SIGMAS = (
    ("x", "e", "east", "easting", "lon", "longitude", "horizontal", "h", "x y", _ALL_AXES),
    ("y", "n", "north", "northing", "lat", "latitude", "horizontal", "h", "x y", _ALL_AXES),
    ("z", "u", "up", "height", "alt", "altitude", "vertical", "v", _ALL_AXES),
)
_SPREAD = {"sigma", "std", "stddev", "stdev", "standard", "dev", "deviation", "sd", "accuracy"}
# Those of RTKLIB, in one word.
_SPREAD_OF_AXIS = {f"{word}{axis}": axis for word in ("sd", "std") for axis in "neuxyz"}
# Metashape names an axis in two ways at once: X/Longitude, Y/North.
_AXIS_TWICE = re.compile(r"[xyz]/(?=\w{3})")
# So many numbers are a line of a table, no header.
_NUMBERS = 3
_WITH_UNIT = re.compile(r"(.*?)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*")


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
    """Where a line has the position of an image.

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
    """

    axes: Sequence[Column]
    geodetic: bool
    sigmas: Sequence[Column]
    name: int | None
    index: int | None

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
        titles = [_plain(header) for header in headers]
        name = _place(titles, _NAMES)
        latitude_first, cartesian = (_places(titles, groups) for groups in (_GEODETIC, _METRIC))
        places = latitude_first or cartesian
        if places is None or (name is None and not numbered):
            rule = "must have name and lat, lon, height, or name and x, y, z"
            raise ValueError(f"its columns are {', '.join(headers)}: {rule}")
        geodetic = latitude_first is not None
        units = (DEGREES, DEGREES, LENGTH) if geodetic else (LENGTH,) * 3
        axes = [_column(headers, place, unit) for place, unit in zip(places, units, strict=True)]
        return cls(axes, geodetic, _sigmas(headers), name, _place(titles, _INDEX))


def _sigmas(headers: Sequence[str]) -> list[Column]:
    titles = [_spread_axis(header) for header in headers]
    places = _places(titles, _SIGMAS)
    told = [header for header, title in zip(headers, titles, strict=True) if any(title in s for s in _SIGMAS)]
    if places is None and told:
        rule = "must be sigma_x, sigma_y, sigma_z, or sigma_horizontal, sigma_vertical, or one sigma"
        raise ValueError(f"its standard deviations are {', '.join(told)}: {rule}")
    return [_column(headers, place, LENGTH) for place in places or ()]


def _column(headers: Sequence[str], place: int, units: dict[str, float]) -> Column:
    """Make a column of numbers, in our unit where it names none."""
    header = headers[place]
    unit = _split(header)[1]
    return Column(place, header, unit_factor(header, unit, units) if unit else 1.0)


def _split(header: str) -> tuple[str, str]:
    match = _WITH_UNIT.fullmatch(header)
    return (header, "") if match is None else (match[1], match[2] or "")


def _words(header: str) -> list[str]:
    title = _AXIS_TWICE.sub("", _split(header)[0].lower(), count=1)
    return re.findall(r"[^\W_]+", title.replace("gps", "", 1))


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _plain(header: str) -> str:
    return " ".join(_words(header))


def _spread_axis(header: str) -> str:
    """The axis that a header names a standard deviation along, or all; empty if it names none."""
    words = [word for word in _words(header) if word != "position"]
    if len(words) == 1 and words[0] in _SPREAD_OF_AXIS:
        return _SPREAD_OF_AXIS[words[0]]
    if not _SPREAD & set(words):
        return ""
    return " ".join(word for word in words if word not in _SPREAD) or _ALL_AXES


def _place(titles: Sequence[str], names: Sequence[str]) -> int | None:
    return next((titles.index(name) for name in names if name in titles), None)


def _places(titles: Sequence[str], groups: Sequence[Sequence[str]]) -> list[int] | None:
    places = [_place(titles, names) for names in groups]
    return [place for place in places if place is not None] if None not in places else None
