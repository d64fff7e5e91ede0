"""Positions as receivers and what processes their observations write them: DJI's MRK, RTKLIB's pos.

A line of an MRK, which a drone writes for each photo, is for example::

    1  375717.06  [2041]  -24,N  -4,E  192,V  22.539320,Lat  113.95799,Lon  45.32,Ellh  0.01, 0.02, 0.04  50,Q

photo number, GPS seconds and week, from antenna to camera north, east and down [mm], latitude, longitude
[deg] and height above the ellipsoid [m] of the camera, standard deviations north, east, up [m], and 16 for a
single, 50 for a fixed solution; 0 for none.

A pos has lines of comments, of which the last names the columns, then a line for each epoch::

    %  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)
    2019/06/08 08:03:55.500   47.060012345   -1.350412345    84.1230   1  12   0.0050   0.0040   0.0120
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.csv_text import finite_number
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.sources.io.position_columns import NumberedLine, Triple

_PHOTO_NUMBER = re.compile(r"\s*\d{1,18}\s")
# A cell is tried from its first character on, and never from the others: lines may be long.
_LABELLED = re.compile(r"(?<![^\s,])([^\s,]+)\s*,\s*(Lat|Lon|Ellh|Q)\b", re.IGNORECASE)
_SPREADS = re.compile(r"Ellh\s+([^\s,]+)\s*,\s*([^\s,]+)\s*,\s*([^\s,]+)\s", re.IGNORECASE)
_MRK_RULE = "must have a photo number, Lat, Lon, Ellh, three standard deviations and Q, as DJI writes them"

_COMMENT = "%"
_BETWEEN_CELLS = re.compile(r"[\s,;]+")
_POS_AXES = ("latitude(deg)", "longitude(deg)", "height(m)")
# East, north, up; in the file north comes first.
_POS_SPREADS = ("sde(m)", "sdn(m)", "sdu(m)")
# Date and time, or week and seconds, under one title.
_TIME_CELLS = 2
_NO_FIX = 0

# What the files of other programs begin with.
_TRACKS = ("<?xml", "<gpx", "<kml", "$g")
_JSON = "{"


def require_table(source: Path, line: str) -> None:
    """Raise a DatasetError if the first line of a file is that of a track of a receiver, or of JSON."""
    beginning = line.lstrip().lower()
    if beginning.startswith(_TRACKS):
        advice = "`exiftool -geotag TRACK PHOTOS` gives photos their positions by time, and EXIF is read"
        raise DatasetError(source, f"is a track (GPX, KML, NMEA), which does not name photos: {advice}")
    if beginning.startswith(_JSON):
        raise DatasetError(source, "is JSON: must be a table, such as name,lat,lon,height or name,x,y,z")


def is_mrk(line: str) -> bool:
    """Whether a line is the first of a DJI's MRK."""
    return _PHOTO_NUMBER.match(line) is not None and {"lat", "lon", "ellh"} <= _cells(line).keys()


def is_pos(line: str) -> bool:
    """Whether a line is the first of a pos of RTKLIB."""
    return line.lstrip().startswith(_COMMENT)


def positions_of_mrk(source: Path, lines: Sequence[NumberedLine]) -> NamedPositions:
    """Read an MRK; photos without a solution have no position.

    Raises
    ------
    DatasetError
        If a line is none of an MRK, or a number in it is none or out of range, or a photo stands there twice.
    """
    positions: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    seen: set[str] = set()
    for number, line in lines:
        cells = _cells(line)
        spreads = _SPREADS.search(line)
        photo = line.split()[0]
        if not (_PHOTO_NUMBER.match(line) and {"lat", "lon", "ellh", "q"} <= cells.keys() and spreads):
            raise DatasetError(source, f"{line.strip()[:40]!r}: {_MRK_RULE}", number)
        if (name := str(int(photo))) in seen:
            raise DatasetError(source, f"photo {name} stands there twice", number)
        seen.add(name)
        if finite_number(source, number, "Q", cells["q"]) == _NO_FIX:
            continue
        place = [cells["lat"], cells["lon"], cells["ellh"]]
        positions[name] = _place(source, number, place)
        north, east, up = spreads.groups()
        sigmas[name] = _spread(source, number, [east, north, up])
    if not positions:
        raise DatasetError(source, "holds no photo with a position: the receiver had no solution")
    return NamedPositions(positions, geodetic=True, sigmas=sigmas, named_by="photo number")


def _cells(line: str) -> dict[str, str]:
    """Cells of a line of an MRK by their labels, which follow them."""
    return {label.lower(): cell for cell, label in _LABELLED.findall(line)}


def positions_of_pos(source: Path, lines: Sequence[NumberedLine]) -> NamedPositions:
    """Read a pos: a position for each image, in their order.

    Raises
    ------
    DatasetError
        If it names no columns of degrees, or a number is none or out of range.
    """
    comments = [line for _, line in lines if is_pos(line)]
    titles = [title for title in _BETWEEN_CELLS.split(comments[-1].lower().lstrip(f"{_COMMENT} ")) if title]
    if not set(_POS_AXES) <= set(titles):
        rule = f"must name the columns {', '.join(_POS_AXES)} (RTKLIB: output as Lat/Lon/Height, in ddd.ddd)"
        raise DatasetError(source, f"its last line of comments is {comments[-1].strip()!r}: {rule}")
    places = [titles.index(title) + _TIME_CELLS - 1 for title in _POS_AXES]
    spread_places = [titles.index(title) + _TIME_CELLS - 1 for title in _POS_SPREADS if title in titles]
    positions: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    for number, line in lines:
        if is_pos(line):
            continue
        cells = [cell for cell in _BETWEEN_CELLS.split(line.strip()) if cell]
        if len(cells) < (least := len(titles) - 1 + _TIME_CELLS):
            raise DatasetError(source, f"the line holds {len(cells)} cells: must be {least}", number)
        name = str(len(positions))
        positions[name] = _place(source, number, [cells[place] for place in places])
        if len(spread_places) == len(_POS_SPREADS):
            sigmas[name] = _spread(source, number, [cells[place] for place in spread_places])
    if not positions:
        raise DatasetError(source, "holds no position below its header")
    return NamedPositions(positions, geodetic=True, sigmas=sigmas or None, named_by="order")


def _place(source: Path, line: int, cells: Sequence[str]) -> Triple:
    titles = ("latitude", "longitude", "height")
    latitude, longitude, height = (
        finite_number(source, line, title, cell) for title, cell in zip(titles, cells, strict=True)
    )
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise DatasetError(source, f"latitude {latitude:g}°, longitude {longitude:g}°: out of range", line)
    return latitude, longitude, height


def _spread(source: Path, line: int, cells: Sequence[str]) -> Triple:
    east, north, up = (finite_number(source, line, "standard deviation", cell) for cell in cells)
    if not min(east, north, up) > 0:
        raise DatasetError(source, f"standard deviation {min(east, north, up):g}: must be positive", line)
    return east, north, up
