"""JSON documents, with the path of every element for error messages."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.checks import LARGEST_MAGNITUDE
from sfmcpp.sources.io.files import failures_named, is_regular_file, read_bytes
from sfmcpp.sources.io.number_text import number_of

# A document takes some twenty times its size as Python's objects.
_LARGEST_BYTES = 1 << 30
_LONGEST_QUOTE = 60
_HEAD_BYTES = 4096


class Part:
    """Part of a document.

    Methods raise a DatasetError that names file and place where the part is not what they return. There may
    be millions: the place is put into words when it is asked for.
    """

    __slots__ = ("_key", "_whole", "path", "value")

    def __init__(self, path: Path, value: Any, whole: Part | None = None, key: str | int = "") -> None:
        self.path, self.value = path, value
        self._whole, self._key = whole, key

    @property
    def place(self) -> str:
        """Path in the document: ``views[3].width``; empty for the whole."""
        before = self._whole.place if self._whole is not None else ""
        if isinstance(self._key, int):
            return f"{before}[{self._key}]"
        return f"{before}.{self._key}" if before and self._key else before or self._key

    def with_fields_of(self, base: Part) -> Part:
        """The same with the named parts of another that it does not have itself."""
        return Part(self.path, {**base.fields(), **self.fields()}, self._whole, self._key)

    def fields(self) -> dict[str, Any]:
        """Values of all named parts."""
        if not isinstance(self.value, dict):
            raise self._refusal("an object with named parts")
        return self.value

    def part(self, name: str) -> Part:
        """Find the part of that name, which there must be."""
        found = self.optional(name)
        if found is None:
            raise self.error(f"lacks {name!r}")
        return found

    def optional(self, name: str) -> Part | None:
        """Find the part of that name, or None."""
        fields = self.fields()
        if name not in fields:
            return None
        return Part(self.path, fields[name], self, name)

    def items(self) -> Iterator[Part]:
        """All entries of a list."""
        if not isinstance(self.value, list):
            raise self._refusal("a list")
        for number, value in enumerate(self.value):
            yield Part(self.path, value, self, number)

    def text(self) -> str:
        """A text."""
        if not isinstance(self.value, str):
            raise self._refusal("a text")
        return self.value

    def number(self) -> float:
        """A finite number, or a text that is one: some programs quote all of them."""
        value = self.value
        try:
            number = number_of(value) if isinstance(value, str) else float(value)
        except (TypeError, OverflowError):
            number = math.nan
        if isinstance(value, bool) or not abs(number) <= LARGEST_MAGNITUDE:
            raise self._refusal(f"a finite number, at most {LARGEST_MAGNITUDE:g} in magnitude")
        return number

    def integer(self, lowest: int, highest: int) -> int:
        """A whole number from `lowest` to `highest`."""
        number = self.number()
        if not (number.is_integer() and lowest <= number <= highest):
            raise self._refusal(f"a whole number from {lowest} to {highest}")
        return int(number)

    def numbers(self, count: int) -> list[float]:
        """So many finite numbers, of a list or of rows of them."""
        found: list[float] = self.value if _are_numbers(self.value) else self._numbers()
        if len(found) != count:
            raise self._refusal(f"{count} numbers")
        return found

    def _numbers(self) -> list[float]:
        return [number for item in self.items() for number in _numbers_of(item)]

    def error(self, reason: str) -> DatasetError:
        """Make a DatasetError that names the place."""
        return DatasetError(self.path, f"{self.place}: {reason}" if self.place else reason)

    def _refusal(self, rule: str) -> DatasetError:
        shown = repr(self.value) if not isinstance(self.value, list | dict) else _size(self.value)
        return self.error(f"{shown[:_LONGEST_QUOTE]}: must be {rule}")


def read_json(path: Path) -> Part:
    """Read a document.

    Raises
    ------
    DatasetError
        If it cannot be read, is too large or is no JSON; it names the line then.
    """
    data = read_bytes(path)
    if len(data) > _LARGEST_BYTES:
        raise DatasetError(path, f"holds {len(data)} bytes: must be {_LARGEST_BYTES} at most")
    try:
        return Part(path, json.loads(data, parse_constant=_no_number, parse_int=float))
    except json.JSONDecodeError as error:
        raise DatasetError(path, f"is no JSON: {error.msg}", error.lineno) from None
    except RecursionError:
        raise DatasetError(path, "is nested too deeply") from None
    except ValueError as error:
        raise DatasetError(path, f"is no JSON: {error}") from None


def begins_with(path: Path, word: bytes) -> bool:
    """Whether the beginning of a file that is there holds `word`."""
    if not is_regular_file(path):  # to open a pipe would take for ever
        return False
    with failures_named(path), path.open("rb") as file:
        return word in file.read(_HEAD_BYTES)


def document_chunks(fields: dict[str, Any]) -> Iterator[bytes]:
    """An object as text, a field or an entry a line.

    Values are what JSON has, with finite numbers, or iterators of the entries of a list.
    """
    before = b"{\n"
    for name, value in fields.items():
        yield before + _text(name) + b": "
        yield from _list_chunks(value) if isinstance(value, Iterator) else (_text(value),)
        before = b",\n"
    yield b"\n}\n"


def _list_chunks(entries: Iterator[Any]) -> Iterator[bytes]:
    before = b"[\n"
    for entry in entries:
        yield before + _text(entry)
        before = b",\n"
    yield b"[]" if before == b"[\n" else b"\n]"


def _text(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode("ascii")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no finite number")


def _are_numbers(value: Any) -> bool:
    """Whether nothing but good numbers is in a list; what is, is all floats."""
    return isinstance(value, list) and all(
        type(entry) is float and abs(entry) <= LARGEST_MAGNITUDE for entry in value
    )


def _numbers_of(item: Part) -> list[float]:
    return [entry.number() for entry in item.items()] if isinstance(item.value, list) else [item.number()]


def _size(value: list[Any] | dict[str, Any]) -> str:
    return f"{'a list' if isinstance(value, list) else 'an object'} of {len(value)}"
