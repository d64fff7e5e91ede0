"""Rows as text, ours beside those of the thesis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from textwrap import wrap
from typing import Any

from experiments.description import Row

HEADING_WIDTH = 12


def text_table(columns: Sequence[str], rows: Sequence[Row]) -> str:
    """The columns of the rows, aligned; what a row lacks is a dash."""
    cells = [[_text(row.get(column)) for column in columns] for row in rows]
    lines = [*_headings(columns), *cells]
    widths = [max(len(line[position]) for line in lines) for position in range(len(columns))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def _headings(columns: Sequence[str]) -> list[list[str]]:
    """The names of the columns in as many lines as the longest needs."""
    wrapped = [wrap(column.replace("_", " "), HEADING_WIDTH) for column in columns]
    return [list(line) for line in zip_longest(*wrapped, fillvalue="")]


def beside_thesis(rows: Sequence[Row], thesis: Sequence[Row], identity: Sequence[str]) -> list[Row]:
    """Add to each row, as ``thesis …``, the measures of the rows of the thesis that are about the same.

    Rows of the thesis that are about something else follow.
    """
    joined, used = [], []
    for row in rows:
        same = [other for other in thesis if _is_about(row, other, identity)]
        measures = {f"thesis {name}": other[name] for other in same for name in other if name not in identity}
        joined.append({**row, **measures})
        used += same
    return joined + [
        {**other, identity[0]: f"thesis: {other[identity[0]]}"} for other in thesis if other not in used
    ]


def columns_beside_thesis(columns: Sequence[str], rows: Sequence[Row]) -> list[str]:
    """Each column followed by that of the thesis, where it has one."""
    known = {name for row in rows for name in row}
    pairs = [(column, f"thesis {column}") for column in columns]
    return [name for pair in pairs for name in pair if name in pair[:1] or name in known]


def _is_about(row: Row, other: Row, identity: Sequence[str]) -> bool:
    return all(other[name] == row.get(name) for name in identity if name in other)


def _text(value: Any) -> str:
    if value is None:
        return "—"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return " ".join(_text(item) for item in value) or "—"
    return str(value)
