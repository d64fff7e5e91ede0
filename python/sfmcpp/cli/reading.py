"""Problems of files, with a line for what a file has and its problem has not, or the other way round."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.cli.console import tell
from sfmcpp.model import Problem
from sfmcpp.sources.io.api import format_of, read
from sfmcpp.sources.io.conversion_notes import changed_on_writing, left_out_on_reading
from sfmcpp.sources.io.format import Format


def read_and_tell(source: Path, *, quiet: bool = False) -> Problem:
    """Read a problem, and tell what was left out.

    Raises
    ------
    DatasetError
        If it cannot be read.
    """
    problem = read(source)
    if not quiet:
        tell_left_out(source, problem)
    return problem


def tell_changed(problem: Problem, target: Path, format: Format | None = None) -> None:
    """Tell what a file that was written has in another form."""
    for line in changed_on_writing(problem, target, format or format_of(target)):
        tell(f"note: {target}: {line}")


def tell_left_out(source: Path, problem: Problem) -> None:
    """Tell what was left out of the problem of a file."""
    for line in left_out_on_reading(problem):
        tell(f"note: {source}: {line}")
