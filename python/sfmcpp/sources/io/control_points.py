"""Ground control points: surveyed points, and their marks in images.

Two forms are read. A table with a header has a line for each mark::

    name,x,y,z,image,u,v,sigma,check
    gate,412.317,88.040,12.505,DJI_0018.JPG,1203.5,877.2,0.02,0

with ``lat,lon,height`` in place of ``x,y,z`` where these are WGS 84; standard deviations as in tables of
positions of images, and `check`, are optional. Or the ``gcp_list.txt`` of OpenDroneMap: the name of the
projection, then ``x y z u v image name`` for each mark, in that order; latitudes and longitudes are
``EPSG:4326``, longitude first. Pixels are those of the model: the left upper corner of the image is 0, 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.model.arguments import checked
from sfmcpp.sources.io.csv_text import finite_number, numbered_lines, with_decimal_points
from sfmcpp.sources.io.position_columns import (
    NumberedLine,
    PositionColumns,
    Triple,
    index_of_first,
    names_projection,
    normalised_header,
    position_of_list,
    projection_is_degrees,
    table_of,
)

# Of a coordinate of a survey that states none: as usual for satellite receivers with corrections [m].
SURVEY_SIGMA_M = 0.02
_NAMES = ("name", "point", "label", "gcp", "id", "point name", "gcp name")
_IMAGES = ("image", "photo", "file", "filename", "image name", "photo name", "file name")
_U = ("u", "px", "col", "pixel x", "image x", "im x", "x px")
_V = ("v", "py", "row", "pixel y", "image y", "im y", "y px")
_CHECK = ("check", "checkpoint", "check point", "is check")
_YES, _NO = {"1", "yes", "true", "check", "x"}, {"0", "no", "false", "control", ""}
# Of a mark of OpenDroneMap: x y z u v image, and the name of the point, without which its place names it.
_CELLS = 6


@dataclass(frozen=True)
class Mark:
    """Where an image shows a point.

    Attributes
    ----------
    point : int
        Number of the point, from 0.
    image : str
        Name of the image.
    pixel : (2,) float
        u, v there [px].
    """

    point: int
    image: str
    pixel: tuple[float, float]


@dataclass(frozen=True)
class ControlPoints:
    """Surveyed points and their marks.

    Attributes
    ----------
    names : sequence of str
        Of the points.
    positions : sequence of 3 numbers
        Latitude, longitude [deg, WGS84] and height [m] of each point, or x, y, z [m].
    geodetic : bool
        Which of both.
    marks : sequence of Mark
        Where images show them.
    sigmas_m : sequence of 3 numbers, or None
        Standard deviations of each, east, north, up or along x, y, z [m].
    checks : set of int
        Numbers of those that are compared with the model and do not move it.
    """

    names: Sequence[str]
    positions: Sequence[Triple]
    geodetic: bool
    marks: Sequence[Mark]
    sigmas_m: Sequence[Triple] | None = None
    checks: Set[int] = frozenset()


@checked()
def read_control_points(path: str | PathLike[str]) -> ControlPoints:
    """Read ground control points and their marks.

    Parameters
    ----------
    path : path-like
        A table with a header, or a ``gcp_list.txt``; see above.

    Returns
    -------
    ControlPoints

    Raises
    ------
    DatasetError
        If it cannot be read, holds no mark, a column or cell is missing or no number, a latitude is out of
        its range, a point has two positions, or an image shows a point twice.
    """
    source = Path(path)
    lines = list(numbered_lines(source))
    is_list = bool(lines) and names_projection(lines[0][1])
    read = _lines_of_list if is_list else _lines_of_table
    return _points_of(source, list(read(source, lines)))


@dataclass(frozen=True)
class _Line:
    """What a line says: of a point, and of a mark of it."""

    number: int
    name: str
    position: Triple
    image: str
    pixel: tuple[float, float]
    geodetic: bool
    sigmas: Triple | None = None
    is_check: bool = False

    @property
    def point(self) -> tuple[object, ...]:
        return (self.position, self.sigmas, self.is_check)


def _points_of(source: Path, lines: Sequence[_Line]) -> ControlPoints:
    if not lines:
        raise DatasetError(source, "holds no mark")
    first: dict[str, _Line] = {}
    numbers: dict[str, int] = {}
    marks: dict[tuple[str, str], Mark] = {}
    for line in lines:
        known = first.setdefault(line.name, line)
        numbers.setdefault(line.name, len(numbers))
        if known.point != line.point:
            rule = f"must be as in line {known.number}"
            raise DatasetError(source, f"point {line.name!r} is told otherwise: {rule}", line.number)
        if (line.name, line.image) in marks:
            raise DatasetError(source, f"point {line.name!r} is marked twice in {line.image!r}", line.number)
        marks[line.name, line.image] = Mark(numbers[line.name], line.image, line.pixel)
    points = list(first.values())
    sigmas = [point.sigmas for point in points if point.sigmas is not None]
    return ControlPoints(
        names=list(first),
        positions=[point.position for point in points],
        geodetic=lines[0].geodetic,
        marks=list(marks.values()),
        sigmas_m=sigmas or None,
        checks=frozenset(k for k, point in enumerate(points) if point.is_check),
    )


def _lines_of_table(source: Path, lines: Sequence[NumberedLine]) -> Iterator[_Line]:
    (number, headers), rows = table_of(source, lines)
    titles = [normalised_header(header) for header in headers]
    try:
        places = [_place(headers, titles, names) for names in (_NAMES, _IMAGES, _U, _V)]
        # The names of these columns are those of axes, too.
        rest = ["" if place in places else header for place, header in enumerate(headers)]
        columns = PositionColumns.of(rest, numbered=True)
    except ValueError as error:
        raise DatasetError(source, str(error), number) from None
    name, image, u, v = places
    check = index_of_first(titles, _CHECK)
    for line, cells in with_decimal_points(source, rows, [*columns.numeric, u, v]):
        pixel = [finite_number(source, line, headers[k], cells[k]) for k in (u, v)]
        yield _Line(
            line,
            cells[name],
            columns.position(source, line, cells),
            cells[image],
            (pixel[0], pixel[1]),
            columns.geodetic,
            columns.spread(source, line, cells) if columns.sigmas else None,
            check is not None and _is_check(source, line, cells[check]),
        )


def _place(headers: Sequence[str], titles: Sequence[str], names: Sequence[str]) -> int:
    place = index_of_first(titles, names)
    if place is None:
        rule = "must have name, x, y, z or lat, lon, height, image, u, v"
        raise ValueError(f"its columns are {', '.join(headers)}: {rule}")
    return place


def _is_check(source: Path, line: int, cell: str) -> bool:
    if cell.lower() not in _YES | _NO:
        raise DatasetError(source, f"check is {cell!r}: must be 1 or 0", line)
    return cell.lower() in _YES


def _lines_of_list(source: Path, lines: Sequence[NumberedLine]) -> Iterator[_Line]:
    """Marks of a gcp_list.txt; points without names are told apart by their positions."""
    (_, projection), *rows = lines
    geodetic = projection_is_degrees(projection)
    for number, line in rows:
        cells = line.split()
        if line.lstrip().startswith("#"):
            continue
        if len(cells) < _CELLS:
            rule = "must be x y z u v image, and a name if there is one"
            raise DatasetError(source, f"the line holds {len(cells)} words: {rule}", number)
        yield _mark_of_list(source, number, cells, geodetic=geodetic)


def _mark_of_list(source: Path, number: int, cells: Sequence[str], *, geodetic: bool) -> _Line:
    position = position_of_list(source, number, cells, geodetic=geodetic)
    u, v = (finite_number(source, number, name, cell) for name, cell in zip("uv", cells[3:], strict=False))
    name = cells[_CELLS] if len(cells) > _CELLS else f"({cells[0]}, {cells[1]}, {cells[2]})"
    return _Line(number, name, position, cells[_CELLS - 1], (u, v), geodetic)
