"""The exceptions of sfmcpp: one root, one class for each kind of failure a caller can act on."""

from __future__ import annotations

from os import PathLike, fspath

# Of a reason that quotes a line without end: its beginning, and its end, where the rule is.
_LONGEST_REASON, _BEGIN, _END = 4000, 2000, 1000


def ends_of(text: str, longest: int, begin: int, end: int) -> str:
    """A text, of which the middle is left out if it is longer than `longest`."""
    return text if len(text) <= longest else f"{text[:begin]} […] {text[-end:]}"


class SfmcppError(Exception):
    """Root of every exception that sfmcpp raises on purpose."""


class InvalidArgument(SfmcppError, ValueError):
    """A broken contract of a call; the message names the argument, its value and the rule."""


class DatasetError(SfmcppError, ValueError):
    """A file that cannot be read or written as asked.

    Parameters
    ----------
    path : path-like
        The file at fault.
    reason : str
        What is wrong, naming the value and the rule it breaks. Of one longer than 4,000 characters the middle
        is left out.
    line : int, optional
        Line of a text file, counted from 1; left out for binary files.
    """

    def __init__(self, path: str | PathLike[str], reason: str, line: int | None = None) -> None:
        self.path = fspath(path)
        self.reason = ends_of(reason, _LONGEST_REASON, _BEGIN, _END)
        self.line = line
        super().__init__(str(self))

    def __str__(self) -> str:
        where = self.path if self.line is None else f"{self.path}:{self.line}"
        return f"{where}: {self.reason}"

    def __reduce__(self) -> tuple[type[DatasetError], tuple[str, str, int | None]]:
        return (DatasetError, (self.path, self.reason, self.line))
