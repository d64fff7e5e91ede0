"""`solve --gps`: the problem is brought to positions from a file before it is solved with them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.sources.io.position_csv import read_position_csv

if TYPE_CHECKING:
    from sfmcpp.sfm.georeference import Georeferenced


@dataclass(frozen=True)
class Gps:
    """Positions of images as asked for on the command line.

    Attributes
    ----------
    source : Path or None
        File of positions; None: none are used.
    """

    source: Path | None = None

    def refuse_ranks(self) -> None:
        """Raise InvalidArgument if positions are asked for; several processes have no whole to move."""
        if self.source is not None:
            raise InvalidArgument("--gps: for one process; georeference first, then solve with ranks")

    def georeference(self, problem: Problem, options: dict[str, Any]) -> Georeferenced | None:
        """Bring a problem to the positions, in place; None without them.

        Raises
        ------
        DatasetError
            If the file cannot be read, or its positions and the problem do not go together.
        """
        if self.source is None:
            return None
        from sfmcpp.sfm.georeference import georeference_to, image_names
        from sfmcpp.sfm.positions import positions_of

        told = read_position_csv(self.source, numbered=True)
        numbers = [str(camera) for camera in range(problem.num_cameras)]
        names = numbers if told.by_number else image_names(problem)
        try:
            known = positions_of(names, told.positions, geodetic=told.geodetic, sigmas=told.sigmas)
            return georeference_to(problem, known, **options)
        except InvalidArgument as error:
            raise DatasetError(self.source, str(error).removeprefix("gps: ")) from error
