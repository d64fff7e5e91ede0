"""Positions of images on the command line: `--gps` and `--camera-positions`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp.cli.console import print_note
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors import geodetic_of
from sfmcpp.sources.io.files import is_folder, is_present
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.io.position_files import GivenPositions, require_positions_format, write_positions

if TYPE_CHECKING:
    from sfmcpp.sfm.georeference import Georeferenced
    from sfmcpp.sfm.result import GpsOutcome


@dataclass(frozen=True)
class Gps:
    """The option `--gps` of the command line.

    Attributes
    ----------
    source : Path or None
        File of positions, or folder of photos whose EXIF blocks tell them; None: none are used.
    """

    source: Path | None = None

    def check(self, target: Path | None) -> None:
        """Raise a DatasetError if the positions of the result can never be written to `target`."""
        if target is not None:
            require_positions_format(
                target, geodetic=self._given_positions is None or self._given_positions.geodetic
            )

    def check_fits(self, target: Path | None, problem: Problem) -> None:
        """Raise a DatasetError if the positions of a solved `problem` could not be written to `target`."""
        if target is None:
            return
        _require_different_names(target, problem)
        if self._given_positions is None:
            origin = WorldOrigin.of(problem.metadata)
            require_positions_format(target, geodetic=origin is not None and origin.geodetic)

    def refuse_ranks(self, target: Path | None) -> None:
        """Raise InvalidArgument if positions are read or written; no process has the whole."""
        for option, path in (("--gps", self.source), ("--positions-out", target)):
            if path is not None:
                raise InvalidArgument(f"{option}: for one process, not for ranks of MPI")

    def tell_if_missing(self, source: Path, problem: Problem) -> None:
        """Warn where a solve is about to move a problem away from positions that it was brought to before."""
        held = problem.fixed_cameras.any() or problem.fixed_points.any()
        if self.source is None and WorldOrigin.of(problem.metadata) is not None and not held:
            print_note(
                f"warning: {source}: is georeferenced by positions that this solve does not use: cameras may "
                "move away from them (give them with --gps; sfmcpp convert writes them without a solve)"
            )

    def georeference(self, problem: Problem, options: dict[str, Any]) -> Georeferenced | None:
        """Bring a problem to the positions, in place; None without them.

        Raises
        ------
        DatasetError
            If the file cannot be read, or its positions and the problem do not go together.
        """
        given = self._given_positions
        if given is None or self.source is None:
            return None
        from sfmcpp.sfm.georeference import georeference_to, image_names
        from sfmcpp.sfm.positions import positions_of

        try:
            return georeference_to(problem, positions_of(image_names(problem), given), **options)
        except InvalidArgument as error:
            raise DatasetError(self.source, str(error).removeprefix("gps: ")) from error

    @cached_property
    def _given_positions(self) -> NamedPositions | None:
        if self.source is None:
            return None
        if self.source == Path("exif") and not is_present(self.source):
            raise InvalidArgument("--gps exif: where are the photos? --gps FOLDER takes what they tell")
        if is_folder(self.source):
            from sfmcpp.sfm.positions import exif_positions_of_folder

            return exif_positions_of_folder(self.source)
        return read_position_csv(self.source, numbered=True)


def outcome_after_solve(found: Georeferenced | None, problem: Problem) -> Callable[[], GpsOutcome | None]:
    """What positions tell of a problem as it is when this is called: after a further solve."""
    if found is None:
        return lambda: None
    from sfmcpp.sfm.georeference import image_names

    before, outcome = problem.centres.copy(), found.outcome
    return lambda: outcome.moved(image_names(problem), problem.centres - before)


def write_camera_positions(path: Path, problem: Problem, gps: GpsOutcome | None) -> None:
    """Write where the cameras of a problem are, and how that compares with the positions it was brought to.

    They are in the frame of those, or of those that earlier ones have told; else in the problem's own.

    Raises
    ------
    DatasetError
        If the file cannot be written, or cannot hold them, as where images are called the same.
    """
    _require_different_names(path, problem)
    given = None
    if gps is not None:
        offsets = {name: (x, y, z) for name, (x, y, z) in ((n, o.tolist()) for n, o in gps.offsets_m.items())}
        given = GivenPositions(gps.residuals_m, gps.outliers, offsets)
    write_positions(path, _camera_positions(problem, gps), given)


def _require_different_names(path: Path, problem: Problem) -> None:
    names = problem.metadata.image_names
    twice = next((name for name, count in Counter(names).items() if count > 1), None)
    if twice is not None:
        reason = f"{names.count(twice)} images are called {twice!r}: a table of positions has a name once"
        raise DatasetError(path, reason)


def _camera_positions(problem: Problem, gps: GpsOutcome | None) -> NamedPositions:
    from sfmcpp.sfm.georeference import image_names

    origin = WorldOrigin.of(problem.metadata)
    if origin is None:
        rows = problem.centres
    else:
        in_plane = problem.centres
        rows = geodetic_of(in_plane, origin.place) if origin.geodetic else in_plane + origin.place
    named = {name: (x, y, z) for name, (x, y, z) in zip(image_names(problem), rows.tolist(), strict=True)}
    stated = {} if gps is None else gps.sigmas_m
    sigmas = {name: (x, y, z) for name, (x, y, z) in ((n, s.tolist()) for n, s in stated.items())}
    return NamedPositions(named, origin is not None and origin.geodetic, sigmas)
