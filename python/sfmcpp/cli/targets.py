"""Output files and folders of a command, checked before any work is done."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.sources.io.api import format_of, write
from sfmcpp.sources.io.files import (
    COMPRESSED_SUFFIXES,
    failures_named,
    is_folder,
    is_present,
    require_folder,
    require_regular_file,
    require_replaceable,
    scratch_folder_beside,
)
from sfmcpp.sources.io.format import Format

PAGE_SUFFIXES = (".html", ".htm")
# Change of the intrinsics that a solve may change, with which a format is tried.
_MOVED = 1e-9


@dataclass(frozen=True)
class Targets:
    """Output files of a solve; None: not wanted."""

    problem: Path | None = None
    report: Path | None = None
    picture: Path | None = None
    positions: Path | None = None
    page: Path | None = None
    covariances: Path | None = None

    def __iter__(self) -> Iterator[Path]:
        return (path for path in (self.problem, *self._other_files) if path is not None)

    @property
    def _other_files(self) -> tuple[Path | None, ...]:
        return self.report, self.picture, self.positions, self.page, self.covariances

    def check(self, source: Path, *others: Path) -> None:
        """Raise a DatasetError if one of them could not be written, or would overwrite another.

        The problem may replace its `source`; nothing may replace the `others` that are read.
        """
        if self.problem is not None:
            require_writable_problem(self.problem)
        for path in self._other_files:
            if path is not None and path.parent != self._new_folder():
                require_writable_file(path)
        if self.picture is not None:
            _require_picture(self.picture)
        if self.page is not None:
            require_page_name(self.page)
        if self.covariances is not None:
            from sfmcpp.study.covariance_files import require_covariance_format

            require_covariance_format(self.covariances)
        _require_distinct(self, source, others)

    def _new_folder(self) -> Path | None:
        """The folder that the problem will make, and into which other files may go."""
        if self.problem is None or format_of(self.problem).suffixes or is_present(self.problem):
            return None
        return self.problem

    def check_fits(self, problem: Problem, *, refined: bool = False) -> None:
        """Raise a DatasetError if the format of the result cannot hold `problem`, or it has no positions.

        Where its free intrinsics were chosen (`refined`), the format that it is from may not hold them.
        """
        if self.positions is not None and not problem.is_metric:
            raise DatasetError(self.positions, f"{problem.camera_model} cameras have no positions")
        if self.page is not None:
            from sfmcpp.study.pages.model_page import require_world

            require_world(problem, self.page)
        if self.covariances is not None:
            from sfmcpp.study.covariance_files import require_covariances

            require_covariances(problem, self.covariances)
        if self.problem is None:
            return
        chosen = format_of(self.problem)
        if chosen.target_check is not None:
            chosen.target_check(self.problem, problem)
        # What was read from a file fits its format again, if it is still metric.
        own = problem.is_metric and chosen.name == problem.metadata.source_format
        if chosen.holds_every_model or (own and not refined):
            return
        with scratch_folder_beside(self.problem) as folder:
            _try_to_write(_with_moved_lenses(problem), self.problem, Path(folder))

    def refuse_ranks(self) -> None:
        """Raise InvalidArgument if something is wanted that needs all of the problem; no process has it."""
        for option, path in (("--view", self.page), ("--covariances", self.covariances)):
            if path is not None:
                raise InvalidArgument(f"{option}: for one process, not for ranks of MPI")


def write_page(problem: Problem, path: Path, source: Path) -> None:
    """Write a page of a problem in three dimensions, with the name of its file as heading.

    Raises
    ------
    DatasetError
        If the cameras are projective, or the file cannot be written.
    """
    from sfmcpp.study.pages.model_page import write_problem_page

    write_problem_page(problem, path, source.resolve().name)


def require_page_name(path: Path) -> None:
    """Raise a DatasetError unless a file of this name is a page."""
    if path.suffix.lower() not in PAGE_SUFFIXES:
        raise DatasetError(path, f"the name of a page must end in {', '.join(PAGE_SUFFIXES)}")


def require_writable_problem(path: Path, chosen: Format | None = None) -> None:
    """Raise a DatasetError unless a problem can be written to `path`; its name implies a missing format."""
    with failures_named(path):
        chosen = chosen or format_of(path)
    if not chosen.writable:
        raise DatasetError(path, f"format {chosen.name} can be read but not written")
    if chosen.target_check is not None:
        chosen.target_check(path, None)
    if chosen.suffixes:
        require_writable_file(path)
    else:
        _require_writable_folder(path, path if is_folder(path) else path.parent)


def require_writable_file(path: Path) -> None:
    """Raise a DatasetError unless a file could be written to `path`."""
    require_replaceable(path)
    _require_writable_folder(path, path.parent)


def _require_writable_folder(path: Path, folder: Path) -> None:
    if not is_folder(folder):
        raise DatasetError(path, f"the folder {str(folder)!r} does not exist")
    with failures_named(path), tempfile.TemporaryFile(dir=folder):
        pass


def _require_picture(path: Path) -> None:
    try:
        from sfmcpp.study.plotting import FIGURE_SUFFIXES
    except ModuleNotFoundError as error:
        raise DatasetError(path, f"pictures need {error.name}: pip install 'sfmcpp[plot]'") from None
    if path.suffix.lower() not in FIGURE_SUFFIXES:
        raise DatasetError(path, f"the name of a picture must end in {', '.join(FIGURE_SUFFIXES)}")


def _require_distinct(targets: Targets, source: Path, others: Iterable[Path]) -> None:
    """Let the result replace the input, and nothing else replace anything of the same run."""
    taken = [os.path.realpath(path) for path in others]
    for path in targets:
        resolved = os.path.realpath(path)
        if resolved in taken or (path != targets.problem and resolved == os.path.realpath(source)):
            raise DatasetError(path, "is named twice: input, output and all other files must differ")
        taken.append(resolved)


def _with_moved_lenses(problem: Problem) -> Problem:
    """The problem with free distortion, aspect ratios and skew off their defaults, as a solve leaves them."""
    intrinsics = problem.intrinsics.copy()
    for column, name in enumerate(problem.intrinsic_names):
        if isinstance(problem.camera_model, str) and name not in ("f", "cx", "cy"):
            default = 1.0 if name == "aspect" else 0.0
            moved = (intrinsics[:, column] == default) & ~problem.fixed_intrinsics[:, column]
            intrinsics[moved, column] += _MOVED
    return replace(problem, intrinsics=intrinsics)


def _try_to_write(problem: Problem, path: Path, folder: Path) -> None:
    name = path.name
    for suffix in COMPRESSED_SUFFIXES:
        name = name.removesuffix(suffix)
    try:
        write(problem, folder / name)
    except DatasetError as error:
        raise DatasetError(path, error.reason) from error


def require_results_folder(folder: Path, files: Iterable[str]) -> None:
    """Raise a DatasetError if `folder` or that of its model cannot be one, or one of its `files` is one."""
    from sfmcpp.study.report_files import MODEL

    for path in (folder, folder / MODEL):
        require_folder(path)
    for name in files:
        require_regular_file(folder / name)


@contextmanager
def writable_folder(folder: Path) -> Iterator[None]:
    """Make a folder that can be written; a run that fails leaves none that is empty."""
    with failures_named(folder):
        missing = [path for path in (folder, *folder.parents) if not is_present(path)]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    try:
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise
