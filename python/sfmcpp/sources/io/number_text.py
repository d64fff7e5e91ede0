"""Numbers of a text, read by the core, with line numbers for error messages.

:class:`NumberText` is a whole text, :class:`NumberStream` the numbers of a file of any size in order.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sources.io.text_pieces import read_pieces

TokenSet = slice | NDArray[np.int64]

_WORD = re.compile(rb"\S+")
_DIGITS = re.compile(rb"[+-]?[0-9]{1,400}")
_LINE_END = ord("\n")
_LONGEST_QUOTE = 40
_MOST = 1 << 62
# From here on a float is not every whole number.
_INEXACT = 2.0**53


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
    data : bytes or memoryview of them
        Content of the file; lines that start with ``#`` are comments if `comments` is true.
    before : int
        How many lines of the file stand before `data`.

    Raises
    ------
    DatasetError
        If anything is not a finite decimal number; it names the line.
    """

    def __init__(
        self, path: Path, data: bytes | memoryview, *, comments: bool = False, before: int = 0
    ) -> None:
        self.path = path
        self._data, self._comments, self._before = data, comments, before
        values, bad = _core.read_numbers(data, comments)
        if bad >= 0:
            raise self._not_a_number(bad)
        self.values: FloatArray = values

    def error(self, reason: str, token: int) -> DatasetError:
        """Make a DatasetError at the line of the number `token`, or the last line if there are fewer."""
        return DatasetError(self.path, reason, self.line_of(token))

    def line_of(self, token: int) -> int:
        """Line, counted from 1, of the number `token`."""
        lines = self.lines
        row = int(np.searchsorted(lines.first, token, side="right")) - 1
        return int(lines.number[row]) if len(lines.number) else 1

    @cached_property
    def lines(self) -> Lines:
        """Positions of the numbers, line by line; lines without numbers are left out."""
        first, count, number = _core.number_lines(self._data, self._comments)
        return Lines(first, count, number + self._before)

    def integers(self, tokens: TokenSet, what: str, lowest: int, highest: int) -> NDArray[np.int64]:
        """Numbers at `tokens` as integers, each from `lowest` to `highest`, or a DatasetError naming one.

        Those beyond 2⁵³ are exact, too; `highest` is less than 2⁶³.
        """
        values = self.values[tokens]
        large = np.flatnonzero(np.abs(values) >= _INEXACT)
        of_large = np.arange(len(self.values))[tokens][large].tolist() if len(large) else []
        exact = [self._exact_integer(token, what, lowest, highest) for token in of_large]
        fault = first_no_integer(values, what, lowest, highest)
        if fault is not None:
            raise self.error(fault[1], self.token_at(tokens, fault[0]))
        integers = values.astype(np.int64)
        integers[large] = exact
        return integers

    def token_at(self, tokens: TokenSet, row: int) -> int:
        """Index of the number that is at place `row` of `tokens`."""
        return int(np.arange(len(self.values))[tokens][row])

    def require_line_counts(self, good: BoolArray, rule: str) -> None:
        """Raise a DatasetError at the first line whose count of numbers is not `good`."""
        if not good.all():
            line = int(np.argmin(good))
            reason = f"the line holds {self.lines.count[line]} numbers: must be {rule}"
            raise DatasetError(self.path, reason, int(self.lines.number[line]))

    def _exact_integer(self, token: int, what: str, lowest: int, highest: int) -> int:
        row = int(np.searchsorted(self.lines.first, token, side="right")) - 1
        line = self._text_lines[int(self.lines.number[row]) - self._before - 1]
        word = line.split()[token - int(self.lines.first[row])]
        number = int(word) if _DIGITS.fullmatch(word) else int(self.values[token])
        if not lowest <= number <= highest:
            raise self.error(_integer_fault(what, str(number), lowest, highest), token)
        return number

    @cached_property
    def _text_lines(self) -> list[bytes]:
        return bytes(self._data).split(b"\n")

    def _not_a_number(self, byte: int) -> DatasetError:
        data = bytes(self._data)
        word = cast(re.Match[bytes], _WORD.search(data, byte))[0]
        line = data.count(b"\n", 0, byte) + 1 + self._before
        return DatasetError(self.path, f"{_quoted(word)} is not a finite number", line)


class NumberStream:
    """Numbers of a file of any size, apart by white space, one after another.

    No more of the text is in memory than some megabytes.

    Parameters
    ----------
    path : Path
        The file, plain or compressed.

    Raises
    ------
    DatasetError
        As :class:`NumberText` and :func:`read_pieces`, when the fault is reached.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._texts = _texts(path)
        self._ahead: FloatArray = np.empty(0)
        self.taken = 0

    def take(self, most: int) -> FloatArray:
        """At most so many of the next numbers, and at least one unless there are none left."""
        if not len(self._ahead):
            self._ahead = next((text.values for text in self._texts if len(text.values)), self._ahead)
        taken, self._ahead = self._ahead[:most], self._ahead[most:]
        self.taken += len(taken)
        return taken

    def rows(self, count: int, width: int) -> Iterator[FloatArray]:
        """The next `count` rows of `width` numbers, some thousands at a time; fewer if the file ends."""
        torn = np.empty(0)
        while count and len(taken := self.take(count * width - len(torn))):
            numbers = np.concatenate([torn, taken]) if len(torn) else taken
            whole = len(numbers) - len(numbers) % width
            torn, count = numbers[whole:], count - whole // width
            yield numbers[:whole].reshape(-1, width)

    def table(self, count: int, width: int) -> FloatArray:
        """The next `count` rows of `width` numbers at once; what the file does not have is left as it is."""
        table, row = np.empty((count, width)), 0
        for block in self.rows(count, width):
            table[row : row + len(block)] = block
            row += len(block)
        return table

    def count_all(self) -> int:
        """Count the numbers of the file, after taking those that are left."""
        while len(self.take(_MOST)):
            pass
        return self.taken

    def error(self, reason: str, token: int) -> DatasetError:
        """Make a DatasetError at the line of the number `token`, or the last line if there are fewer."""
        return DatasetError(self.path, reason, self.line_of(token))

    def line_of(self, token: int) -> int:
        """Line, counted from 1, of the number `token`: the file is read once more."""
        line = 1
        for text in _texts(self.path):
            line = text.line_of(token) if len(text.values) else line
            token -= len(text.values)
            if token < 0:
                break
        return line


@dataclass(frozen=True)
class OwnNumbers:
    """The numbers in one rank's bytes of a file.

    Attributes
    ----------
    values : (n,) float64
        All of them.
    before : int
        How many numbers of the file stand before them.
    following : array
        Some that follow them, fewer than a row has.
    """

    values: FloatArray
    before: int
    following: FloatArray

    def rows(self, begin: int, count: int, width: int) -> tuple[int, FloatArray]:
        """The first that begins here of `count` rows from number `begin` of the file on, and all that do."""
        ends = np.array([self.before, self.before + len(self.values)])
        first, last = np.clip(-((begin - ends) // width), 0, count)
        start, wanted = begin + width * first - self.before, width * (last - first)
        taken = self.values[max(start, 0) :][:wanted]
        return int(first), np.concatenate([taken, self.following[: wanted - len(taken)]]).reshape(-1, width)


def number_of(word: str) -> float:
    """The number that a word is, or not a number: words with underscores, which Python allows, are none."""
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan


def first_no_integer(values: FloatArray, what: str, lowest: int, highest: int) -> tuple[int, str] | None:
    """Place and fault of the first of the values that is no integer from `lowest` to `highest`, or None."""
    good = (values >= lowest) & (values <= highest) & (values == np.floor(values))
    if good.all():
        return None
    worst = int(np.argmin(good))
    return worst, _integer_fault(what, f"{values[worst]:.17g}", lowest, highest)


def _integer_fault(what: str, number: str, lowest: int, highest: int) -> str:
    """What is wrong with a number that is no integer from `lowest` to `highest`."""
    rule = f"must be an integer from {lowest} to {highest}" if highest >= lowest else "there are none"
    return f"{what} {number}: {rule}"


def _texts(path: Path) -> Iterator[NumberText]:
    before = 0
    for piece in read_pieces(path):
        yield NumberText(path, piece.data, before=before)
        before += int(np.count_nonzero(piece == _LINE_END))


def _quoted(word: bytes) -> str:
    """The number that a word is, infinite or none, or else the word."""
    try:
        return str(float(word)) if b"_" not in word else _excerpt(word)
    except ValueError:
        return _excerpt(word)


def _excerpt(word: bytes) -> str:
    return "'" + word[:_LONGEST_QUOTE].decode("ascii", "backslashreplace") + "'"
