"""Positions of images from CSV: a header, then a line for each image.

For example::

    name,lat,lon,height
    DJI_0018.JPG,46.842607,-91.994052,198.31

or, in a metric frame of the user's own, ``name,x,y,z``. Units may stand in brackets, as ``lat [deg]``.
Standard deviations along the axes [m] are in ``sigma_x,sigma_y,sigma_z``, or ``sigma_e,sigma_n,sigma_u``, or
``sigma_horizontal,sigma_vertical``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.csv_text import finite_number, numbered_lines

_NAMES = ("name", "image", "file", "filename", "label", "photo")
_GEODETIC = (
    ("lat", "latitude"),
    ("lon", "lng", "longitude", "long"),
    ("height", "alt", "altitude", "elevation"),
)
_METRIC = (("x", "east", "e"), ("y", "north", "n"), ("z", "up", "u"))
_SIGMAS = (
    ("sigma_x", "sigma_e", "sigma_east", "sigma_lon", "sigma_horizontal"),
    ("sigma_y", "sigma_n", "sigma_north", "sigma_lat", "sigma_horizontal"),
    ("sigma_z", "sigma_u", "sigma_up", "sigma_height", "sigma_alt", "sigma_vertical"),
)
_INDEX = ("index", "number", "camera")
Triple = tuple[float, float, float]
_UNIT = re.compile(r"\s*[\[(].*?[\])]\s*$")


@dataclass(frozen=True)
class NamedPositions:
    """Positions of images.

    Attributes
    ----------
    positions : dict
        Three numbers by name: latitude, longitude [deg, WGS84] and height [m], or x, y, z [m].
    geodetic : bool
        Which of both.
    sigmas : dict or None
        Standard deviations by name, east, north, up or along x, y, z [m].
    by_number : bool
        Whether names are numbers of images from 0, as the file has no names.
    """

    positions: dict[str, Triple]
    geodetic: bool
    sigmas: dict[str, Triple] | None = None
    by_number: bool = False


def read_position_csv(path: str | PathLike[str], *, numbered: bool = False) -> NamedPositions:
    """Read positions of images.

    Parameters
    ----------
    path : path-like
        The file: columns ``name``, and ``lat lon height`` or ``x y z``, in any order; standard deviations
        where it has them; other columns are left alone. A line whose position is empty is an image without
        one.
    numbered : bool
        Whether a file without names is taken: by a column ``index``, from 0, or else line by line.

    Returns
    -------
    NamedPositions

    Raises
    ------
    DatasetError
        If it cannot be read, a column is missing, a cell is no number, a latitude or longitude is out of its
        range, a standard deviation is not positive, or a name stands there twice.
    """
    source = Path(path)
    lines = [(number, next(csv.reader([line]))) for number, line in numbered_lines(source)]
    if not lines:
        raise DatasetError(source, "is empty")
    first, header = lines[0]
    titles = [_UNIT.sub("", cell).strip().lower().lstrip("#").strip() for cell in header]
    label = _labels(titles, numbered)
    geodetic = _columns(titles, _GEODETIC)
    places = geodetic or _columns(titles, _METRIC)
    if label is None or places is None:
        rule = "must have name and lat, lon, height, or name and x, y, z"
        raise DatasetError(source, f"its columns are {', '.join(titles)}: {rule}", first)
    spreads = _sigma_columns(source, first, titles)
    found: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    for count, (number, row) in enumerate(lines[1:]):
        cells = [cell.strip() for cell in row] + [""] * len(titles)
        if not any(cells[place] for place in places):
            continue
        name = label(count, cells)
        if name in found:
            raise DatasetError(source, f"{name!r} stands there twice", number)
        x, y, z = (finite_number(source, number, titles[place], cells[place]) for place in places)
        if geodetic and not (abs(x) <= 90 and abs(y) <= 180):
            raise DatasetError(source, f"latitude {x:g}°, longitude {y:g}°: out of range, or swapped", number)
        found[name] = (x, y, z)
        if spreads is not None:
            sigmas[name] = _sigmas(source, number, titles, cells, spreads)
    by_number = _column(titles, _NAMES) is None
    return NamedPositions(found, geodetic is not None, sigmas if spreads else None, by_number)


def _labels(titles: list[str], numbered: bool) -> Callable[[int, list[str]], str] | None:
    """What tells the name of an image by the number of its line, from 0, and by its cells."""
    name = _column(titles, _NAMES)
    if name is None and numbered:
        name = _column(titles, _INDEX)
        if name is None:
            return lambda count, cells: str(count)
    return None if name is None else lambda count, cells: cells[name]


def _sigma_columns(source: Path, line: int, titles: list[str]) -> list[int] | None:
    places = _columns(titles, _SIGMAS)
    told = [title for title in titles if any(title in names for names in _SIGMAS)]
    if places is None and told:
        rule = "must be sigma_x, sigma_y, sigma_z, or sigma_horizontal, sigma_vertical"
        raise DatasetError(source, f"its standard deviations are {', '.join(told)}: {rule}", line)
    return places


def _sigmas(source: Path, line: int, titles: list[str], cells: list[str], places: list[int]) -> Triple:
    x, y, z = (finite_number(source, line, titles[place], cells[place]) for place in places)
    if not min(x, y, z) > 0:
        raise DatasetError(source, f"standard deviation {min(x, y, z):g}: must be positive", line)
    return x, y, z


def _column(titles: list[str], names: tuple[str, ...]) -> int | None:
    return next((titles.index(name) for name in names if name in titles), None)


def _columns(titles: list[str], groups: tuple[tuple[str, ...], ...]) -> list[int] | None:
    places = [_column(titles, names) for names in groups]
    return [place for place in places if place is not None] if None not in places else None
