"""Positions of images from CSV: a header, then a line for each image.

For example::

    name,lat,lon,height
    DJI_0018.JPG,46.842607,-91.994052,198.31

or, in a metric frame of the user's own, ``name,x,y,z``. Units may stand in brackets, as ``height [ft]``; else
they are degrees and metres. Standard deviations along the axes are in ``sigma_x,sigma_y,sigma_z``, or
``sigma_e,sigma_n,sigma_u``, or ``sigma_horizontal,sigma_vertical``. Other common names are known too
(:mod:`position_columns`), tabs and semicolons separate as well, and then decimals may have commas. Lines that
begin with ``#`` are comments, but for a header: the last of them before the first other line.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.csv_text import finite_number, numbered_lines, separator_of, with_decimal_points
from sfmcpp.sources.io.position_columns import Column, PositionColumns

Triple = tuple[float, float, float]
Row = tuple[int, list[str]]


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
        If it cannot be read, the header or a column is missing, a unit is unknown, a cell is no number, a
        comma may be one of decimals or of thousands, a latitude or longitude is out of its range, a standard
        deviation is not positive, or a name stands there twice.
    """
    source = Path(path)
    headers, rows = _table(source)
    try:
        columns = PositionColumns.of(headers[1], numbered=numbered)
    except ValueError as error:
        raise DatasetError(source, str(error), headers[0]) from None
    rows = with_decimal_points(source, rows, [column.place for column in (*columns.axes, *columns.sigmas)])
    found: dict[str, Triple] = {}
    sigmas: dict[str, Triple] = {}
    for count, (number, cells) in enumerate(rows):
        if not any(cells[column.place] for column in columns.axes):
            continue
        name = _label(columns, count, cells)
        if name in found:
            raise DatasetError(source, f"{name!r} stands there twice", number)
        found[name] = _position(source, number, cells, columns)
        if columns.sigmas:
            sigmas[name] = _sigmas(source, number, cells, columns.sigmas)
    by_number = columns.name is None
    return NamedPositions(found, columns.geodetic, sigmas if columns.sigmas else None, by_number)


def _table(source: Path) -> tuple[Row, list[Row]]:
    """The header and the other lines: their numbers and cells, as many as the header has."""
    lines = _without_comments(list(numbered_lines(source)))
    if not lines:
        raise DatasetError(source, "is empty")
    separator = separator_of(lines[0][1])
    split = [(number, _cells(source, number, line, separator)) for number, line in lines]
    count = len(split[0][1])
    for number, cells in split:
        if any(cells[count:]):
            rule = f"must be {count}; where commas are decimal, cells are separated by ';' or tabs"
            raise DatasetError(source, f"the line holds {len(cells)} cells: {rule}", number)
    header, *rows = [(number, (cells + [""] * count)[:count]) for number, cells in split]
    return header, rows


def _cells(source: Path, number: int, line: str, separator: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:
        raise DatasetError(source, str(error), number) from error


def _without_comments(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """The header, which may begin as comments do, and the lines that do not."""
    is_comment = [line.lstrip().startswith("#") for _, line in lines]
    rows = [line for line, comment in zip(lines, is_comment, strict=True) if not comment]
    leading = lines[: is_comment.index(False) if rows else len(lines)]
    if leading and (separator_of(leading[-1][1]) in leading[-1][1] or not rows):
        return [leading[-1], *rows]
    return rows


def _label(columns: PositionColumns, count: int, cells: list[str]) -> str:
    """The name of an image; else its number, which a column or the line tells."""
    place = columns.index if columns.name is None else columns.name
    return str(count) if place is None else cells[place]


def _position(source: Path, line: int, cells: list[str], columns: PositionColumns) -> Triple:
    x, y, z = _numbers(source, line, cells, columns.axes)
    if columns.geodetic and not (abs(x) <= 90 and abs(y) <= 180):
        raise DatasetError(source, f"latitude {x:g}°, longitude {y:g}°: out of range, or swapped", line)
    return x, y, z


def _sigmas(source: Path, line: int, cells: list[str], columns: Sequence[Column]) -> Triple:
    x, y, z = _numbers(source, line, cells, columns)
    if not min(x, y, z) > 0:
        raise DatasetError(source, f"standard deviation {min(x, y, z):g}: must be positive", line)
    return x, y, z


def _numbers(source: Path, line: int, cells: list[str], columns: Sequence[Column]) -> Triple:
    x, y, z = (finite_number(source, line, c.header, cells[c.place], c.factor) for c in columns)
    return x, y, z
