"""Positions of images from CSV: a header, then a line for each image.

For example::

    name,lat,lon,height
    DJI_0018.JPG,46.842607,-91.994052,198.31

or, in a metric frame of the user's own, ``name,x,y,z``. Units may stand in brackets, as ``height [ft]``; else
they are degrees and metres. Standard deviations along the axes are in ``sigma_x,sigma_y,sigma_z``, or
``sigma_e,sigma_n,sigma_u``, or ``sigma_horizontal,sigma_vertical``. Other common names are known too.
Tabs and semicolons separate as well, and then decimals may have commas; so do blanks, where the header has
none of these. Latitudes and longitudes may have their hemisphere (``46° 30' 36" N``, ``46.51 N``), or a
column ``lat_ref``, ``lon_ref`` for it. Lines that begin with ``#`` are
comments, but for a header: the last of them before the first other line.

The ``geo.txt`` of OpenDroneMap is read, too: the name of the projection, then for each image ``name x y z``,
three angles and two accuracies if known; latitudes and longitudes are ``EPSG:4326``, longitude first. So are
tables of receivers (:mod:`receiver_tables`).
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.csv_text import finite_number, numbered_lines, with_decimal_points
from sfmcpp.sources.io.missing_values import is_missing
from sfmcpp.sources.io.named_positions import NamedBy, NamedPositions
from sfmcpp.sources.io.position_columns import (
    NumberedLine,
    PositionColumns,
    Triple,
    names_projection,
    position_of_list,
    projection_is_degrees,
    spreads_by_look,
    table_of,
)
from sfmcpp.sources.io.receiver_tables import (
    is_mrk,
    is_pos,
    positions_of_mrk,
    positions_of_pos,
    require_table,
)

# Of a line of a geo.txt, without its name: x y z, three angles, two accuracies.
_LIST_CELLS = (3, 6, 8)


def read_position_csv(path: str | PathLike[str], *, numbered: bool = False) -> NamedPositions:
    """Read positions of images.

    Parameters
    ----------
    path : path-like
        The file: columns ``name``, and ``lat lon height`` or ``x y z``, in any order; standard deviations
        where it has them; other columns are left alone. A line whose position is empty, or ``NaN`` or
        another word for no value, is an image without one.
    numbered : bool
        Whether a file without names is taken: by a column ``index``, from 0, or else line by line.

    Returns
    -------
    NamedPositions

    Raises
    ------
    DatasetError
        If it cannot be read, the header or a column is missing, it holds no position, a unit is unknown, a
        cell is no number, a comma may be one of decimals or of thousands, a latitude or longitude is out of
        its range, a standard deviation is not positive, an index is no whole number, or a name or index
        stands there twice.
    """
    source = Path(path)
    lines = list(numbered_lines(source))
    if lines:
        require_table(source, lines[0][1])
    if lines and names_projection(lines[0][1]):
        return _positions_of_list(source, lines)
    if lines and is_mrk(lines[0][1]):
        return positions_of_mrk(source, lines)
    if lines and is_pos(lines[0][1]):
        return positions_of_pos(source, lines)
    headers, rows = table_of(source, lines)
    try:
        columns = PositionColumns.of(headers[1], numbered=numbered)
    except ValueError as error:
        raise DatasetError(source, str(error), headers[0]) from None
    rows = with_decimal_points(source, rows, columns.numeric)
    found: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    for count, (number, cells) in enumerate(rows):
        axes = [cells[column.place] for column in columns.axes]
        if all(not cell or is_missing(cell) for cell in axes):
            continue
        name = _name_of_line(source, number, columns, count, cells)
        if name in found:
            raise DatasetError(source, f"{name!r} stands there twice", number)
        found[name] = columns.position(source, number, cells)
        if columns.sigmas:
            sigmas[name] = columns.spread(source, number, cells)
    if not found:
        raise DatasetError(source, "holds no position below its header")
    unread = () if columns.sigmas else spreads_by_look(headers[1])
    named_by: NamedBy = "index" if columns.name is None else "name"
    return NamedPositions(found, columns.geodetic, sigmas if columns.sigmas else None, named_by, unread)


def _positions_of_list(source: Path, lines: Sequence[NumberedLine]) -> NamedPositions:
    """Read a geo.txt of OpenDroneMap: name x y z, with angles, and accuracies in plane and height behind."""
    (_, projection), *rows = lines
    geodetic = projection_is_degrees(projection)
    found: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    for number, line in rows:
        if line.lstrip().startswith("#"):
            continue
        name, *cells = line.split()
        if name in found:
            raise DatasetError(source, f"{name!r} stands there twice", number)
        if len(cells) not in _LIST_CELLS:
            rule = "must be a name, x, y, z, and three angles and two accuracies if known"
            raise DatasetError(source, f"the line holds {1 + len(cells)} words: {rule}", number)
        found[name] = position_of_list(source, number, cells, geodetic=geodetic)
        if len(cells) == max(_LIST_CELLS):
            plane, height = (finite_number(source, number, "accuracy", cell) for cell in cells[-2:])
            if not min(plane, height) > 0:
                raise DatasetError(source, f"accuracy {min(plane, height):g}: must be positive", number)
            sigmas[name] = (plane, plane, height)
    if not found:
        raise DatasetError(source, "holds no position below its projection")
    if sigmas and len(sigmas) < len(found):
        without = next(name for name in found if name not in sigmas)
        raise DatasetError(source, f"{without!r} has no accuracies: must be in all lines, or in none")
    return NamedPositions(found, geodetic, sigmas or None)


def _name_of_line(source: Path, line: int, columns: PositionColumns, count: int, cells: list[str]) -> str:
    """The name of an image; else its number, from a column or the line."""
    if columns.name is not None:
        return cells[columns.name]
    if columns.index is None:
        return str(count)
    cell = cells[columns.index]
    if not (cell.isascii() and cell.isdecimal()):
        raise DatasetError(source, f"index is {cell!r}: must be the number of an image, from 0 on", line)
    return str(int(cell))
