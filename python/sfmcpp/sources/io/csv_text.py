"""CSV files: numbered lines, separators, numbers in cells, and units in headers such as ``[km/h]``."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named, read_text_bytes, require_present
from sfmcpp.sources.io.number_text import number_of

# The foot of 1959; maps of the United States may be in feet of their survey, which differ by 4 m in 2,000 km.
LENGTH = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048, "us-ft": 1200 / 3937}
DEGREES = {"deg": 1.0, "rad": 180 / math.pi}

_ALIASES = {"°": "deg", "degree": "deg", "degrees": "deg", "decimaldegrees": "deg", "radians": "rad"}
_ALIASES |= dict.fromkeys(("metre", "metres", "meter", "meters"), "m")
_ALIASES |= {"foot": "ft", "feet": "ft", "usft": "us-ft", "ftus": "us-ft", "us-feet": "us-ft"}
_ALIASES |= dict.fromkeys(("sec", "secs", "second", "seconds"), "s")
_ALIASES |= {f"{short}{end}": f"{short}s" for short in "mun" for end in ("sec", "secs")}
_ALIASES |= {f"{long}second{s}": f"{long[0]}s" for long in ("milli", "nano") for s in ("", "s")}
_ALIASES |= dict.fromkeys(("microsecond", "microseconds", "\u00b5s", "\u03bcs"), "us")
_ALIASES |= dict.fromkeys(("kmh", "kph", "kmph"), "km/h") | {"mps": "m/s", "mi/h": "mph", "fps": "ft/s"}
_ALIASES |= dict.fromkeys(("knot", "knots", "kt", "kts"), "kn") | {"dps": "deg/s", "rps": "rad/s"}
# Ends and beginnings of units that are written in several ways.
_SPELLINGS = ((" s^-1", "/s"), ("/sec", "/s"), ("degrees/", "deg/"), ("\u00b0/", "deg/"), (" ", ""))
_SEPARATORS = "\t;|"
# What Excel asks for, where commas are decimal, above the header.
_SEPARATOR_TOLD = re.compile(r'"?sep=[\t;,|]?"?', re.IGNORECASE)
BLANK = " "
_LONGEST_HEADER = 500
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def unit_factor(header: str, unit: str, units: dict[str, float]) -> float:
    """Look up the factor of `unit`, which stands in the header of a column.

    Raises
    ------
    ValueError
        If it is unknown or empty; the message lists the known ones.
    """
    normal = unit.lower()  # no unit here differs from another by its case
    for spelling, ours in _SPELLINGS:
        normal = normal.replace(spelling, ours)
    normal = _ALIASES.get(normal, normal)
    if normal not in units:
        what = f"has the unknown unit {unit!r}" if unit else "names no unit"
        raise ValueError(f"column {header!r} {what}: must be one of {', '.join(f'[{u}]' for u in units)}")
    return units[normal]


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that are not empty, with their numbers from 1; UTF-8, with or without a byte order mark.

    A first line ``sep=;``, of Excel, is left out: the header shows what separates.

    Raises
    ------
    DatasetError
        If the file cannot be read, or is no such text, as the "Unicode text" of spreadsheets (UTF-16).
    """
    with failures_named(path):
        require_present(path)
        try:
            text = read_text_bytes(path).decode()
        except UnicodeDecodeError as error:
            raise DatasetError(path, f"is no UTF-8 text ({error.reason} at byte {error.start})") from error
    told = _SEPARATOR_TOLD.fullmatch(text.split("\n", 1)[0][:_LONGEST_HEADER].strip()) is not None
    return ((k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and k > told)


def finite_number(
    path: Path, line: int, column: str, cell: str, factor: float = 1.0, other: str = ""
) -> float:
    """Number in a cell, times the factor that makes its unit ours.

    `other` says, in messages, what else may stand there.

    Raises
    ------
    DatasetError
        If it is none, or not finite; it names the line.
    """
    value = number_of(cell) * factor
    if not math.isfinite(value):
        raise DatasetError(path, f"{column} is {cell!r}: must be a finite number{other}", line)
    return value


def match_of_header(pattern: re.Pattern[str], header: str) -> re.Match[str] | None:
    """Match of all of a header, its blanks made single; None where it is longer than any.

    On what is no header, such as thousands of blanks, a pattern would try their every division.
    """
    text = " ".join(header.split())
    return pattern.fullmatch(text) if len(text) <= _LONGEST_HEADER else None


def separator_of(header: str) -> str:
    """Separator of the cells below a header: tabs, semicolons or bars if it has any, else commas."""
    return next((separator for separator in _SEPARATORS if separator in header), ",")


def cells_of(path: Path, number: int, line: str, separator: str) -> list[str]:
    """Cells of a line, without blanks around them; those between double quotes without these.

    Several blanks separate as one.

    Raises
    ------
    DatasetError
        If a cell is longer than any can be; it names the line.
    """
    text = " ".join(line.split()) if separator == BLANK else line
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=separator))]
    except csv.Error as error:
        raise DatasetError(path, str(error), number) from error


def with_decimal_points(
    path: Path, rows: list[tuple[int, list[str]]], places: Sequence[int]
) -> list[tuple[int, list[str]]]:
    """Make decimal commas points, in the columns of numbers at `places` of numbered rows of cells.

    Raises
    ------
    DatasetError
        If commas may as well separate thousands; it names the line.
    """
    numbered = [(number, cells[place]) for number, cells in rows for place in places]
    commas = [(number, cell) for number, cell in numbered if "," in cell]
    if not commas:
        return rows
    line, cell = commas[0]
    if any("." in cell for _, cell in numbered) or all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        raise DatasetError(path, f"the comma in {cell!r} may be decimal or of thousands: write points", line)
    numeric = set(places)
    return [
        (number, [c.replace(",", ".") if k in numeric else c for k, c in enumerate(cells)])
        for number, cells in rows
    ]
