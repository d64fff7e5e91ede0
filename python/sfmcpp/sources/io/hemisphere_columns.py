"""Columns that tell the sign of a coordinate beside it: N or S, E or W, above or below the sea.

Receivers and EXIF have latitudes, longitudes and altitudes without a sign, and such a column for each:
``GPSLatitude,GPSLatitudeRef``, ``Lat,N/S``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.number_text import number_of

# For each of latitude, longitude and height: beginnings of its title, other titles, words of a cell, rule.
_AXES = (
    (("latitude", "lat"), ("n s",), {"n": 1, "north": 1, "s": -1, "south": -1}, "N or S"),
    (("longitude", "lon", "lng"), ("e w",), {"e": 1, "east": 1, "w": -1, "west": -1}, "E or W"),
    (
        ("altitude", "alt"),
        (),
        # The numbers are those of EXIF 3: 2 and 3 are heights above and below the ellipsoid.
        {"0": 1, "2": 1, "above": 1, "positive": 1, "1": -1, "3": -1, "below": -1, "negative": -1, "": 1},
        "0 (above the sea) or 1 (below)",
    ),
)
_HEIGHT = 2
_ENDS = ("ref", "reference", "hemisphere", "hemi", "dir", "direction", "indicator")


def hemisphere_places(titles: Sequence[str]) -> tuple[int | None, ...]:
    """Which column of these normalised titles tells the sign of latitude, longitude and height, if any."""
    return tuple(_place(titles, beginnings, others) for beginnings, others, _, _ in _AXES)


def _place(titles: Sequence[str], beginnings: Sequence[str], others: Sequence[str]) -> int | None:
    names = {f"{word}{blank}{end}" for word in beginnings for blank in ("", " ") for end in _ENDS} | set(
        others
    )
    return next((place for place, title in enumerate(titles) if title in names), None)


def signed(source: Path, line: int, axis: int, value: float, cell: str) -> float:
    """Give a coordinate the sign that the cell of its hemisphere tells; one that has it keeps it.

    A number beside a latitude or longitude is no hemisphere: ``lat_ref`` may be the latitude of a station.

    Raises
    ------
    DatasetError
        If the cell tells none, or the coordinate is negative in spite of it.
    """
    if axis < _HEIGHT and math.isfinite(number_of(cell)):
        return value
    sign = _sign(source, line, axis, cell)
    if value < 0 < sign:
        raise DatasetError(
            source, f"{value:g} is negative, and its hemisphere {cell!r}: one must be wrong", line
        )
    return sign * abs(value)


def _sign(source: Path, line: int, axis: int, cell: str) -> int:
    _, _, signs, rule = _AXES[axis]
    words = cell.lower().split()
    sign = signs.get(words[0] if words else "")
    if sign is None:
        raise DatasetError(source, f"the hemisphere is {cell!r}: must be {rule}", line)
    return sign


def with_hemispheres(
    source: Path,
    titles: Sequence[str],
    coordinates: Sequence[int | None],
    rows: Sequence[tuple[int, list[str]]],
) -> list[tuple[int, list[str]]]:
    """Numbered rows of cells whose coordinates have the sign that the columns of hemispheres tell.

    `coordinates` are the columns of latitude, longitude and height, where there are any. What is no number
    stays as it is.

    Raises
    ------
    DatasetError
        As :func:`signed`.
    """
    told = [(line, list(cells)) for line, cells in rows]
    for axis, places in enumerate(zip(coordinates, hemisphere_places(titles), strict=True)):
        coordinate, hemisphere = places
        if coordinate is None or hemisphere is None:
            continue
        for line, cells in told:
            is_whole = len(cells) > max(coordinate, hemisphere)
            value = number_of(cells[coordinate].replace(",", ".")) if is_whole else math.nan
            if math.isfinite(value) and signed(source, line, axis, value, cells[hemisphere]) < 0:
                cells[coordinate] = f"-{cells[coordinate].lstrip('+-')}"
    return told
