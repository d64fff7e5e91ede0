"""Ground control points on the command line: `--gcp` and `--gcp-sigma-m`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.sources.io.control_points import SURVEY_SIGMA_M, ControlPoints, read_control_points
from sfmcpp.sources.io.position_files import require_positions_format

if TYPE_CHECKING:
    from sfmcpp.sfm.control_points import Controlled, ControlOutcome


@dataclass(frozen=True)
class Control:
    """The options `--gcp` and `--gcp-sigma-m`.

    Attributes
    ----------
    source : Path or None
        File of surveyed points and their marks; None: none are used.
    sigma_m : float
        Standard deviation of their coordinates where the file states none [m].
    """

    source: Path | None = None
    sigma_m: float = SURVEY_SIGMA_M

    def check(self, gps: Path | None, positions: Path | None) -> None:
        """Read the file.

        Raises
        ------
        InvalidArgument
            If there are positions of the cameras, too.
        DatasetError
            If it cannot be read, or the `positions` of the cameras can never be written.
        """
        if self.source is None:
            return
        if gps is not None:
            raise InvalidArgument("--gcp: must be without --gps; in Python, a solve takes both constraints")
        geodetic = self._points.geodetic
        if positions is not None:
            require_positions_format(positions, geodetic=geodetic)

    def refuse_ranks(self) -> None:
        """Raise InvalidArgument if there are any; no process has the whole."""
        if self.source is not None:
            raise InvalidArgument("--gcp: for one process, not for ranks of MPI")

    def fit(self, problem: Problem, options: dict[str, Any]) -> Controlled | None:
        """Bring a problem to the points; None without them.

        Raises
        ------
        DatasetError
            If the points and the problem do not go together.
        """
        if self.source is None:
            return None
        from sfmcpp.sfm.control_points import fit_control_points

        try:
            return fit_control_points(problem, self._points, sigma_m=self.sigma_m, **options)
        except InvalidArgument as error:
            raise DatasetError(
                self.source, str(error).removeprefix("control: ").removeprefix("gps: ")
            ) from error

    @cached_property
    def _points(self) -> ControlPoints:
        assert self.source is not None
        return read_control_points(self.source)


def control_after_solve(found: Controlled | None) -> Callable[[], ControlOutcome | None]:
    """How a problem fits its surveyed points as it is when this is called: after a further solve."""
    if found is None:
        return lambda: None
    problem, outcome = found.problem, found.outcome
    before = problem.points[-len(outcome.names) :].copy()
    return lambda: outcome.moved(problem, problem.points[-len(before) :] - before)
