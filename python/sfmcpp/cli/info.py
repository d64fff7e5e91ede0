"""`sfmcpp info`: what is in a file or a folder, in a few lines; here which reader is asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from sfmcpp.cli import file_facts
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.file_facts import Fact
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import is_folder, require_present

# What is read of a file to tell tracks by their first lines.
_HEAD_BYTES = 1 << 16
# The readers of files whose names leave several kinds open, in the order in which they are asked.
_OF_TABLES = (
    file_facts.of_control_points,
    file_facts.of_positions,
    file_facts.of_trajectory,
    file_facts.of_image_tracks,
)
_OF_TEXTS = (
    file_facts.of_problem,
    file_facts.of_tracks,
    file_facts.of_trajectory,
    file_facts.of_sensors,
    file_facts.of_control_points,
    file_facts.of_positions,
    file_facts.of_image_tracks,
    file_facts.of_calibration,
)

Source = Annotated[
    Path,
    typer.Argument(
        metavar="INPUT",
        help="Problem, tracks, trajectory, sensor file, positions, calibration, drive, images, video or ROS "
        "bag.",
    ),
]


@with_exit_code
def info(source: Source) -> ExitCode:
    """What is in a file or a folder, in a few lines."""
    from sfmcpp.cli.bag import bag_table
    from sfmcpp.cli.display import facts_text
    from sfmcpp.sources.bags import is_bag, open_bag

    require_present(source)
    if is_bag(source):
        with open_bag(source) as opened:
            print_result(bag_table(opened))
    else:
        print_result(facts_text([("input", str(source)), *facts_of(source)]))
    return ExitCode.DONE


def facts_of(source: Path) -> list[Fact]:
    """What is in a file or a folder, each fact with its name.

    Raises
    ------
    DatasetError
        If it cannot be read, or is of no known kind.
    """
    from sfmcpp.sources.drives import euroc_folder
    from sfmcpp.sources.vision.images import is_picture, is_video

    if is_folder(source):
        if euroc_folder(source) is not None:
            return list(file_facts.of_euroc(source))
        if any(map(is_picture, source.iterdir())):
            return [*file_facts.of_images(source), *file_facts.of_photos(source)]
        return _folder(source)
    if is_video(source):
        return list(file_facts.of_images(source))
    if source.suffix.lower() == ".mat":
        return list(file_facts.of_drive(source))
    suffixes = {suffix.lower() for suffix in source.suffixes}
    if _is_calibration(source):
        return list(file_facts.of_calibration(source))
    if suffixes & {".mrk", ".pos"}:
        return list(file_facts.of_positions(source))
    if suffixes & {".csv", ".tsv"}:
        return _table(source)
    if ".txt" in suffixes:
        return _first_that_fits(source, _OF_TEXTS)
    return _of_another_name(source)


def _table(source: Path) -> list[Fact]:
    # Cells of text take twenty times the size of the file: tracks of an hour are not tried as sensors.
    first = (file_facts.of_sensors, file_facts.of_tracks)
    return _first_that_fits(source, (*(first[::-1] if _is_tracks(source) else first), *_OF_TABLES))


def _of_another_name(source: Path) -> list[Fact]:
    """A problem or tracks; a text whose name tells nothing (`.tum`, `.log`) is what its lines are.

    Where they are nothing, the names that tell a format are the reason.
    """
    try:
        return _first_that_fits(source, (file_facts.of_problem, file_facts.of_image_tracks))
    except DatasetError:
        if _is_named(source) or b"\0" in _head_of(source):
            raise
        try:
            return _table(source)
        except DatasetError:
            pass
        raise


def _is_named(source: Path) -> bool:
    """Whether the name tells what is in a file."""
    from sfmcpp.sources.io.api import format_of

    try:
        format_of(source)
    except DatasetError:
        return source.suffix.lower() in (".xy", ".tracks")
    return True


def _is_calibration(source: Path) -> bool:
    """Whether the name says so, or OpenCV's matrices in a JSON file: others are models."""
    from sfmcpp.sources.cameras import CALIBRATION_FILES
    from sfmcpp.sources.io.documents import read_document
    from sfmcpp.sources.io.opencv_cameras import opencv_cameras

    if source.suffix.lower() != ".json":
        return source.name in CALIBRATION_FILES or source.suffix.lower() in (".yaml", ".yml", ".xml")
    try:
        return bool(opencv_cameras(read_document(source)))
    except DatasetError:
        return False


def _is_tracks(source: Path) -> bool:
    from sfmcpp.sources.io.track_files import has_title

    return has_title(_head_of(source))


def _head_of(source: Path) -> bytes:
    try:
        with source.open("rb") as stream:
            return stream.read(_HEAD_BYTES)
    except OSError:
        return b""  # as its readers will say


def _folder(source: Path) -> list[Fact]:
    """A model, or tracks; where there is none the reason says what else a folder may be."""
    from sfmcpp.sources.io.image_tracks import is_malaga_folder
    from sfmcpp.sources.vision.images import where_images_are

    if is_malaga_folder(source):
        return list(file_facts.of_image_tracks(source))
    try:
        return list(file_facts.of_problem(source))
    except DatasetError as error:
        if error.path != str(source):
            raise
        reason = f"{error.reason}; nor does it hold images: {where_images_are(source)}"
        raise DatasetError(source, reason) from None


def _first_that_fits(source: Path, readers: Sequence[Callable[[Path], Iterator[Fact]]]) -> list[Fact]:
    """What the first reader makes of it that can read it.

    Of the reasons that all have against it the one that comes last in the file tells most.
    """
    refused: list[DatasetError] = []
    for reader in readers:
        try:
            return list(reader(source))
        except DatasetError as error:
            refused.append(error)
    raise max(refused, key=lambda error: error.line or 0)
