"""Positions of images from CSV: a header, then a line for each image.

For example::

    name,lat,lon,height
    DJI_0018.JPG,46.842607,-91.994052,198.31

or, in a metric frame of the user's own, ``name,x,y,z``. Units may stand in brackets, as ``lat [deg]``.
"""

from __future__ import annotations

import csv
import re
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
    """

    positions: dict[str, tuple[float, float, float]]
    geodetic: bool


def read_position_csv(path: str | PathLike[str]) -> NamedPositions:
    """Read positions of images.

    Parameters
    ----------
    path : path-like
        The file: columns ``name``, and ``lat lon height`` or ``x y z``, in any order; other columns are left
        alone. A line whose position is empty is an image without one.

    Returns
    -------
    NamedPositions

    Raises
    ------
    DatasetError
        If it cannot be read, a column is missing, a cell is no number, a latitude or longitude is out of its
        range, or a name stands there twice.
    """
    source = Path(path)
    lines = [(number, next(csv.reader([line]))) for number, line in numbered_lines(source)]
    if not lines:
        raise DatasetError(source, "is empty")
    first, header = lines[0]
    titles = [_UNIT.sub("", cell).strip().lower().lstrip("#").strip() for cell in header]
    name = _column(titles, _NAMES)
    geodetic = _columns(titles, _GEODETIC)
    places = geodetic or _columns(titles, _METRIC)
    if name is None or places is None:
        rule = "must have name and lat, lon, height, or name and x, y, z"
        raise DatasetError(source, f"its columns are {', '.join(titles)}: {rule}", first)
    found: dict[str, tuple[float, float, float]] = {}
    for number, row in lines[1:]:
        cells = [cell.strip() for cell in row] + [""] * len(titles)
        if not any(cells[place] for place in places):
            continue
        label = cells[name]
        if label in found:
            raise DatasetError(source, f"{label!r} stands there twice", number)
        x, y, z = (finite_number(source, number, titles[place], cells[place]) for place in places)
        if geodetic and not (abs(x) <= 90 and abs(y) <= 180):
            raise DatasetError(source, f"latitude {x:g}°, longitude {y:g}°: out of range, or swapped", number)
        found[label] = (x, y, z)
    return NamedPositions(found, geodetic is not None)


def _column(titles: list[str], names: tuple[str, ...]) -> int | None:
    return next((titles.index(name) for name in names if name in titles), None)


def _columns(titles: list[str], groups: tuple[tuple[str, ...], ...]) -> list[int] | None:
    places = [_column(titles, names) for names in groups]
    return [place for place in places if place is not None] if None not in places else None
