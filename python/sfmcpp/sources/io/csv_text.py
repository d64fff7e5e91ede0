"""CSV files: their lines with numbers for error messages, separators, and the numbers in their cells."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named, read_bytes

_SEPARATORS = "\t;"
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that are not empty, with their numbers from 1; UTF-8, with or without a byte order mark.

    Raises
    ------
    DatasetError
        If the file cannot be read, or is no such text.
    """
    with failures_named(path):
        if not path.exists():
            raise DatasetError(path, "no such file or directory")
        try:
            text = read_bytes(path).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise DatasetError(path, f"is no UTF-8 text ({error.reason} at byte {error.start})") from error
    return ((number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip())


def finite_number(path: Path, line: int, column: str, cell: str, factor: float = 1.0) -> float:
    """Number in a cell, times the factor that makes its unit ours.

    Raises
    ------
    DatasetError
        If it is none, or not finite; it names the line.
    """
    try:
        value = float(cell) * factor
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DatasetError(path, f"{column} is {cell!r}: must be a finite number", line)
    return value


def separator_of(header: str) -> str:
    """What separates the cells below a header: tabs or semicolons if it has any, else commas."""
    return next((separator for separator in _SEPARATORS if separator in header), ",")


def with_decimal_points(
    path: Path, rows: list[tuple[int, list[str]]], places: Sequence[int]
) -> list[tuple[int, list[str]]]:
    """Make decimal commas points, in the columns of numbers at `places` of numbered rows of cells.

    Raises
    ------
    DatasetError
        If commas may as well separate thousands; it names the line.
    """
    told = [(number, cells[place]) for number, cells in rows for place in places]
    commas = [(number, cell) for number, cell in told if "," in cell]
    if not commas:
        return rows
    line, cell = commas[0]
    if any("." in cell for _, cell in told) or all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        raise DatasetError(path, f"the comma in {cell!r} may be decimal or of thousands: write points", line)
    numeric = set(places)
    return [
        (number, [c.replace(",", ".") if k in numeric else c for k, c in enumerate(cells)])
        for number, cells in rows
    ]
