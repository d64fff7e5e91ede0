"""CSV files: their lines with numbers for error messages, and the numbers in their cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named, read_bytes


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
