"""Reading of problems, with notes on what the file or the problem cannot hold."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.cli.console import print_note
from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.sources.io.api import format_of, read
from sfmcpp.sources.io.conversion_notes import (
    UNCERTAINTIES,
    amounts_in,
    changed_on_writing,
    left_out_on_reading,
)
from sfmcpp.sources.io.files import is_folder, is_present
from sfmcpp.sources.io.format import Format


def read_with_notes(source: Path, *, quiet: bool = False) -> Problem:
    """Read a problem, and print notes on what was left out.

    Raises
    ------
    DatasetError
        If it cannot be read; of what another command reads, it names that.
    """
    try:
        problem = read(source)
    except DatasetError as error:
        other = _other_command(source) if error.path == str(source) and is_present(source) else ""
        if not other:
            raise
        raise DatasetError(source, f"{error.reason}; {other}", error.line) from None
    if not quiet:
        note_left_out(source, problem)
    return problem


def _other_command(source: Path) -> str:
    """Which command reads images, drives and bags, none of which is a problem."""
    from sfmcpp.sources.bags import is_bag
    from sfmcpp.sources.vision.images import is_picture, is_video

    if is_bag(source):
        return "sfmcpp bag makes files for sfmcpp slam of a bag"
    if is_picture(source):
        return "sfmcpp reconstruct makes a model of a folder of photos"
    if is_folder(source) and any(map(is_picture, source.iterdir())):
        return "sfmcpp reconstruct makes a model of the photos in it"
    if is_video(source) or source.suffix.lower() == ".mat":
        return "sfmcpp slam reads videos and drives"
    return ""


def note_changed(problem: Problem, target: Path, format: Format) -> None:
    """Tell what a file that was written has in another form."""
    for line in changed_on_writing(problem, target, format):
        print_note(f"note: {target}: {line}")


def note_written(problem: Problem, target: Path) -> None:
    """Tell what a result that was written has in another form, and uncertainties that it lacks."""
    format = format_of(target)
    note_changed(problem, target, format)
    if format.readable and amounts_in(problem)[UNCERTAINTIES] and UNCERTAINTIES in format.lacks:
        print_note(
            f"note: {target}: {format.name} has no place for the uncertainties of observations: a solve of "
            "it takes 1 px for all (NPZ and sba keep them)"
        )


def note_left_out(source: Path, problem: Problem) -> None:
    """Tell what was left out of the problem of a file."""
    for line in left_out_on_reading(problem):
        print_note(f"note: {source}: {line}")
