"""`sfmcpp convert`: from one format to another, by one process or by several ranks."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.ba.parts import ProblemSize
from sfmcpp.ba.ranks import Ranks
from sfmcpp.cli.exit_codes import ExitCode, say
from sfmcpp.cli.launched import launched_ranks, together
from sfmcpp.cli.targets import require_writable_problem
from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.io.api import read, read_part, write, write_part
from sfmcpp.sources.io.parts import write_parts


def convert_file(source: Path, target: Path, parts: int | None = None) -> ExitCode:
    """Write the problem of a file to another, or to a folder of so many parts.

    Raises
    ------
    DatasetError
        If one cannot be read, or the other written.
    InvalidArgument
        If several ranks are asked for another number of parts than one each.
    """
    ranks = launched_ranks(asked=False)
    if ranks is not None:
        return together(ranks, lambda heeded: _convert_on(source, target, parts, ranks))
    if parts is None:
        require_writable_problem(target)
    problem = read(source)
    if parts is None:
        write(problem, target)
    else:
        write_parts(problem, target, parts)
    say(f"{target}: {problem}")
    return ExitCode.DONE


def _convert_on(source: Path, target: Path, parts: int | None, ranks: Ranks) -> ExitCode:
    if parts not in (None, ranks.size):
        raise InvalidArgument(f"--parts {parts}: {ranks.size} ranks write one part each")
    ranks.from_root(lambda: require_writable_problem(target))
    part = read_part(source, ranks)
    write_part(part, target, ranks)
    size = ProblemSize.of(part.problem, ranks)
    if ranks.is_root:
        say(f"{target}: {size.num_points} points, {size.num_observations} observations in {ranks.size} parts")
    return ExitCode.DONE
