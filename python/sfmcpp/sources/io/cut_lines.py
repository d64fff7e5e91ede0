"""The last line of a log that was cut off while it was written: by a full disk, a crash, or a lost supply.

Such a file does not end with the end of a line. File systems may leave zeros where the rest would be.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from sfmcpp.sources.io.files import read_bytes
from sfmcpp.sources.io.missing_values import Line, is_start_of_missing
from sfmcpp.sources.io.number_text import number_of

# What may be left of a number of which the end is missing.
_STUMP = re.compile(r"[+-]?(\d*[.,]?\d*([eE][+-]?\d*)?)?")
_ZERO = "\0"


def emptied_if_zeros(lines: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Empty the last numbered line if zeros stand in it, which are no text."""
    found = list(lines)
    if found and _ZERO in found[-1][1]:
        found[-1] = (found[-1][0], "")
    return found


def without_cut_line(
    path: Path, lines: Sequence[Line], width: int, groups: Iterable[Sequence[int]]
) -> tuple[Sequence[Line], list[int]]:
    """Leave out the last line of a file if it was cut off.

    A number that has lost only its last digits is not recognised.

    Parameters
    ----------
    path : Path
        The file.
    lines : sequence of (int, list of str)
        Its numbered lines as cells, without the header.
    width : int
        How many cells a line has.
    groups : iterable of sequence of int
        The places of the columns of numbers that belong together.

    Returns
    -------
    lines : sequence of (int, list of str)
        The lines that are whole; a line that stands alone always is.
    cut : list of int
        The number of the line that was left out, or nothing.
    """
    if len(lines) < 2 or not _is_torn(lines[-1][1], width, groups) or _is_ended(path):
        return lines, []
    return lines[:-1], [lines[-1][0]]


def _is_torn(cells: Sequence[str], width: int, groups: Iterable[Sequence[int]]) -> bool:
    if len(cells) != width:
        return len(cells) < width
    *_, last = cells
    beside = next((places for places in groups if width - 1 in places), None)
    if beside is None or math.isfinite(number_of(last.replace(",", "."))):
        return False
    if not last:
        return any(cells[place] for place in beside)
    return _STUMP.fullmatch(last) is not None or is_start_of_missing(last)


def _is_ended(path: Path) -> bool:
    return read_bytes(path)[-1:] in (b"\n", b"\r")
