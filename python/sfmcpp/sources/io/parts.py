"""Parts: a folder with one file for all cameras, one for each part of the points, and a list of them.

``parts.json`` lists name, size and SHA-256 of the content of each file, and is written last: a folder without
it is not complete. The files are NPZ archives, of :func:`write_npz` for the cameras, and of the rows of
points and of observations with their numbers in the whole. Their names have a part of their checksum, so that
new ones stand beside old ones until the list names them.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.checkpoints import digest
from sfmcpp.ba.partition import partition_points
from sfmcpp.ba.parts import Part, Rows, cameras_alone, joined_rows, part_from_rows, part_of
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.sources.io.atomic import atomic_files, remove_leftovers
from sfmcpp.sources.io.checks import require_valid
from sfmcpp.sources.io.files import failures_named, is_present, is_regular_file, read_bytes, require_folder
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.npz import members_of_problem, problem_of_members, read_members, write_members

VERSION = 1
LIST = "parts.json"

# Default number of parts: at most so many ranks can share the work.
_DEFAULT_COUNT = 16
_MOST_PARTS = 65536  # files in one folder
_VERSION_KEY = "sfmcpp_parts"
_POINT, _OBSERVATION = "point.", "observation."
_CAMERAS, _PART = "cameras", "part"


@dataclass(frozen=True)
class Entry:
    """One file of a folder of parts, as the list has it.

    Attributes
    ----------
    name : str
        Name of the file.
    bytes : int
        Size.
    sha256 : str
        Of its content.
    points, observations : int
        How many it has.
    """

    name: str
    bytes: int
    sha256: str
    points: int = 0
    observations: int = 0


class PartsFolder:
    """A complete folder of parts.

    Parameters
    ----------
    path : Path
        The folder.

    Attributes
    ----------
    entries : list of Entry
        Those of the parts.

    Raises
    ------
    DatasetError
        If it has no list, or one of another version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        listed = _read_list(path / LIST)
        try:
            self._cameras = Entry(**listed["cameras"])
            self.entries = [Entry(**entry) for entry in listed["parts"]]
            if any(Path(entry.name).name != entry.name for entry in (self._cameras, *self.entries)):
                raise ValueError("names must be those of files beside it")
            if not self.entries:
                raise ValueError("it lists none")
            for what in ("points", "observations"):
                found = sum(getattr(entry, what) for entry in self.entries)
                if found != listed[what]:
                    raise ValueError(f"its parts have {found} of the {what}, which are {listed[what]}")
        except (KeyError, TypeError, ValueError) as error:
            raise DatasetError(path / LIST, f"is no list of parts ({error})") from error

    def part(self, numbers: Sequence[int]) -> Part:
        """Some of the parts as one.

        Raises
        ------
        DatasetError
            If a file is missing, damaged or another than the list says; it names the file.
        """
        cameras = problem_of_members(self.path / self._cameras.name, self._members(self._cameras))
        contents = [self._members(self.entries[number]) for number in numbers]
        try:
            points, observations = (
                joined_rows([_rows(members, kind) for members in contents]) for kind in (_POINT, _OBSERVATION)
            )
            del contents
            part = part_from_rows(cameras, points, observations)
        except (KeyError, IndexError, TypeError, ValueError, InvalidArgument) as error:
            reason = f"its files make no problem ({type(error).__name__}: {error})"
            raise DatasetError(self.path, reason) from error
        require_valid(part.problem, self.path)
        return part

    def _members(self, entry: Entry) -> dict[str, NDArray[Any]]:
        path = self.path / entry.name
        with failures_named(path):
            if not is_present(path):
                raise DatasetError(path, f"is missing: {LIST} lists it")
            size = path.stat().st_size
        if size != entry.bytes:
            raise DatasetError(path, f"has {size} bytes, {LIST} says {entry.bytes}")
        members = read_members(path)
        if digest(members) != entry.sha256:
            raise DatasetError(path, f"is not the file that {LIST} lists: its checksum differs")
        return members


def read_parts(folder: Path) -> Problem:
    """Read a folder of parts as one problem: what was written, in its order.

    Raises
    ------
    DatasetError
        If the list or a file of it is missing, damaged, of another version or another than listed.
    """
    parts = PartsFolder(folder)
    return parts.part(range(len(parts.entries))).problem


def read_own_part(folder: Path, ranks: Ranks) -> Part:
    """Read what one of several ranks takes: parts that follow one another, as many as others or one more.

    Raises
    ------
    DatasetError
        As :func:`read_parts`, or if there are fewer parts than ranks.
    """
    parts = PartsFolder(folder)
    count = len(parts.entries)
    if count < ranks.size:
        raise DatasetError(
            folder,
            f"has {count} parts for {ranks.size} ranks, each needs one: sfmcpp convert --parts makes more",
        )
    return parts.part(range(*ranks.turn(count)))


def write_parts(problem: Problem, folder: Path, count: int = _DEFAULT_COUNT) -> None:
    """Cut a problem into parts that take the same work, and write them.

    Raises
    ------
    DatasetError
        If a value is impossible, or a file cannot be written.
    InvalidArgument
        If the number of parts is none from 1 to 65536.
    """
    if not 1 <= count <= _MOST_PARTS:
        raise InvalidArgument(f"parts = {count}: must be from 1 to {_MOST_PARTS}")
    require_valid(problem, folder)
    parts = partition_points(problem, count)
    with _unlisted_removed_on_failure(folder) as new:
        _make_folder(folder)
        entries = [_write(part_of(problem, np.flatnonzero(parts == k)), folder, k, new) for k in range(count)]
        _write_cameras_and_list(folder, problem, entries, new)


def write_own_part(part: Part, folder: Path, ranks: Ranks) -> None:
    """Write the part of each of several ranks, and what belongs to all once.

    Raises
    ------
    DatasetError
        As :func:`write_parts`, on all ranks.
    """
    with _unlisted_removed_on_failure(folder) as new:
        ranks.from_root(lambda: _make_folder(folder))
        ranks.agreed(lambda: remove_leftovers(Path(os.path.realpath(folder))))
        entries = ranks.everyones(ranks.agreed(lambda: _write(part, folder, ranks.rank, new)))
        ranks.from_root(lambda: _write_cameras_and_list(folder, part.problem, entries, new))


@contextmanager
def _unlisted_removed_on_failure(folder: Path) -> Iterator[list[Path]]:
    """Give a list for files that the block makes; if it fails, those that parts.json does not name go.

    So does the folder if it was missing before and is empty then.
    """
    with failures_named(folder):
        was_missing = not is_present(folder)
    new: list[Path] = []
    try:
        yield new
    except BaseException:
        listed = b""
        with suppress(OSError):
            listed = (folder / LIST).read_bytes()
        for path in new:
            if path.name.encode() not in listed:
                with suppress(OSError):
                    path.unlink()
        if was_missing:
            with suppress(OSError):
                folder.rmdir()
        raise


def _make_folder(folder: Path) -> None:
    require_folder(folder, " for parts")
    with failures_named(folder):
        folder.mkdir(exist_ok=True)


def _write(part: Part, folder: Path, number: int, new: list[Path]) -> Entry:
    members = _members(part.rows_of_points, _POINT) | _members(part.rows_of_observations, _OBSERVATION)
    entry = _write_part_file(folder, f"{_PART}-{number:04d}", members, new)
    return replace(entry, points=part.problem.num_points, observations=part.problem.num_observations)


def _write_cameras_and_list(folder: Path, problem: Problem, entries: list[Entry], new: list[Path]) -> None:
    """Write the cameras and the list, which makes it this problem; what else was there is removed."""
    cameras = _write_part_file(folder, _CAMERAS, members_of_problem(cameras_alone(problem), folder), new)
    content = {
        _VERSION_KEY: VERSION,
        "points": sum(entry.points for entry in entries),
        "observations": sum(entry.observations for entry in entries),
        "cameras": asdict(cameras),
        "parts": [asdict(entry) for entry in entries],
    }
    with atomic_files(folder / LIST) as (file,):
        file.write(json.dumps(content, indent=1).encode("ascii"))
    for path in folder.glob("*.npz"):
        if path.name.startswith((f"{_CAMERAS}-", f"{_PART}-")) and path.name not in {
            entry.name for entry in (cameras, *entries)
        }:
            with suppress(OSError):
                path.unlink()


def _write_part_file(folder: Path, stem: str, members: dict[str, NDArray[Any]], new: list[Path]) -> Entry:
    sha256 = digest(members)
    path = folder / f"{stem}-{sha256[:8]}.npz"
    if not is_present(path):
        new.append(path)
    write_members(members, path)
    return Entry(path.name, path.stat().st_size, sha256)


def _members(rows: Rows, prefix: str) -> dict[str, NDArray[Any]]:
    return {prefix + name: array for name, array in rows.items()}


def _rows(members: dict[str, NDArray[Any]], prefix: str) -> Rows:
    return {n.removeprefix(prefix): array for n, array in members.items() if n.startswith(prefix)}


def _read_list(path: Path) -> dict[str, Any]:
    if not is_present(path):
        raise DatasetError(path.parent, f"is no complete folder of parts: it has no {LIST}")
    try:
        listed = json.loads(read_bytes(path))
        version = listed[_VERSION_KEY]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DatasetError(path, f"is no list of parts ({type(error).__name__}: {error})") from error
    if version != VERSION:
        raise DatasetError(path, f"is a list of parts of version {version}, this version reads {VERSION}")
    return dict(listed)


def _is_parts_list(path: Path) -> bool:
    return path.name.lower() == "parts" or path.suffix.lower() == ".parts" or is_regular_file(path / LIST)


FORMAT = Format(
    "parts",
    "Folder with a problem in parts, for several ranks",
    (),
    read_parts,
    write_parts,
    _is_parts_list,
    part_reader=read_own_part,
    part_writer=write_own_part,
    holds_every_model=True,
)
