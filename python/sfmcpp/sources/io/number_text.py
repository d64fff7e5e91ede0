"""Numbers of a text file, parsed in one go, with the line of each one at hand for error messages."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import BoolArray, FloatArray

TokenSet = slice | NDArray[np.int64]

_WHITESPACE = b" \t\n\r\v\f"
_IS_WORD = bytes(byte not in _WHITESPACE for byte in range(256))
_COMMENT = re.compile(rb"^[ \t]*#[^\n]*", re.MULTILINE)
_NUMBER = rb"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_NOT_A_NUMBER = re.compile(rb"(?<!\S)(?!" + _NUMBER + rb"(?!\S))\S+")
_LONGEST_QUOTE = 40


@dataclass(frozen=True)
class Lines:
    """The lines that hold numbers: index of the first, how many, and line number counted from 1."""

    first: NDArray[np.int64]
    count: NDArray[np.int64]
    number: NDArray[np.int64]


class NumberText:
    """A text that consists of numbers separated by white space.

    Parameters
    ----------
    path : Path
        File named in errors.
    data : bytes
        Content of the file; lines that start with ``#`` are comments if `comments` is true.

    Raises
    ------
    DatasetError
        If anything is not a finite decimal number; it names the line.
    """

    def __init__(self, path: Path, data: bytes, *, comments: bool = False) -> None:
        self.path = path
        self._data = _COMMENT.sub(b"", data) if comments else data
        self.values = self._parse()

    def error(self, reason: str, token: int) -> DatasetError:
        """Make a DatasetError at the line of the number `token`, or the last line if there are fewer."""
        return DatasetError(self.path, reason, self.line_of(token))

    def line_of(self, token: int) -> int:
        """Line, counted from 1, of the number `token`."""
        starts = np.flatnonzero(_word_starts(self._data))
        if not len(starts):
            return 1
        return self._line_at(int(starts[min(token, len(starts) - 1)]))

    @cached_property
    def lines(self) -> Lines:
        """Where the numbers stand, line by line; lines without numbers are left out."""
        starts = np.flatnonzero(_word_starts(self._data))
        breaks = np.flatnonzero(np.frombuffer(self._data, np.uint8) == ord("\n"))
        number = np.searchsorted(breaks, starts) + 1
        first = np.flatnonzero(np.diff(number, prepend=0))
        count = np.diff(first, append=len(starts))
        return Lines(first, count, number[first])

    def integers(self, tokens: TokenSet, what: str, lowest: int, highest: int) -> NDArray[np.int64]:
        """Numbers at `tokens` as integers, each from `lowest` to `highest`, or a DatasetError naming one."""
        values = self.values[tokens]
        good = (values >= lowest) & (values <= highest) & (values == np.floor(values))
        if not good.all():
            worst = int(np.argmin(good))
            rule = f"must be an integer from {lowest} to {highest}" if highest >= lowest else "there are none"
            raise self.error(f"{what} {values[worst]:.17g}: {rule}", self.token_at(tokens, worst))
        return values.astype(np.int64)

    def token_at(self, tokens: TokenSet, row: int) -> int:
        """Index of the number that is at place `row` of `tokens`."""
        return int(np.arange(len(self.values))[tokens][row])

    def require_line_counts(self, good: BoolArray, rule: str) -> None:
        """Raise a DatasetError at the first line whose count of numbers is not `good`."""
        if not good.all():
            line = int(np.argmin(good))
            reason = f"the line holds {self.lines.count[line]} numbers: must be {rule}"
            raise DatasetError(self.path, reason, int(self.lines.number[line]))

    def _line_at(self, byte: int) -> int:
        return self._data.count(b"\n", 0, byte) + 1

    def _parse(self) -> FloatArray:
        words = int(np.count_nonzero(_word_starts(self._data)))
        values = _numbers(self._data) if words else np.empty(0)
        # Lines are found by counting words, so every word must have given one number.
        if values is None or len(values) != words:
            raise self._not_a_number()
        finite = np.isfinite(values)
        if not finite.all():
            token = int(np.argmin(finite))
            raise self.error(f"{values[token]} is not a finite number", token)
        return values

    def _not_a_number(self) -> DatasetError:
        match = _NOT_A_NUMBER.search(self._data)
        if match is None:
            return DatasetError(self.path, "holds something else than numbers")
        word = match[0][:_LONGEST_QUOTE].decode("ascii", "backslashreplace")
        return DatasetError(self.path, f"'{word}' is not a finite number", self._line_at(match.start()))


def _word_starts(data: bytes) -> BoolArray:
    word = np.frombuffer(data.translate(_IS_WORD), np.bool_)
    starts: BoolArray = word.copy()
    starts[1:] &= ~word[:-1]
    return starts


def _numbers(data: bytes) -> FloatArray | None:
    """All numbers of `data`, or None if it holds anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(data, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
