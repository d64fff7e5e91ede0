"""Rows of text from columns of numbers, formatted in C rather than row by row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CHUNK_ROWS = 1 << 14
_SEPARATOR = "\0"

Column = NDArray[Any] | Sequence[str]


def format_rows(template: str, *columns: Column) -> Iterator[str]:
    """Rows ``template % (a[i], b[i], …)`` one after another, some thousands at a time.

    ``%r`` writes a float with the fewest digits that read back as the same float.
    """
    for start in range(0, len(columns[0]), _CHUNK_ROWS):
        parts = [_listed(column[start : start + _CHUNK_ROWS]) for column in columns]
        yield template * len(parts[0]) % tuple(chain.from_iterable(zip(*parts, strict=True)))


def format_strings(template: str, *columns: Column) -> list[str]:
    """Row by row what :func:`format_rows` writes; no column may hold a NUL."""
    text = "".join(format_rows(template + _SEPARATOR, *columns))
    return text.split(_SEPARATOR)[:-1]


def ragged_text(heads: Sequence[str], items: Sequence[str], counts: NDArray[np.int64]) -> str:
    """Each head followed by its items; `items` lie in the order of the heads, ``counts[i]`` for head i."""
    pieces = np.empty(len(heads) + len(items), dtype=object)
    is_head = np.zeros(len(pieces), dtype=np.bool_)
    is_head[np.arange(len(heads)) + exclusive_sums(counts)] = True
    pieces[is_head] = heads
    pieces[~is_head] = items
    return "".join(pieces.tolist())


def exclusive_sums(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sum of all counts before each one."""
    return np.cumsum(counts) - counts


def _listed(column: Column) -> Sequence[Any]:
    return column.tolist() if isinstance(column, np.ndarray) else column
