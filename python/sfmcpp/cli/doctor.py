"""`sfmcpp doctor`: findings that explain a bad result, and a repaired problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sfmcpp.cli.choices import Quiet
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.interrupts import stoppable

if TYPE_CHECKING:
    from rich.table import Table

    from sfmcpp.doctor import Diagnosis, Repair
    from sfmcpp.model import Problem

_STYLES = {"error": "bold red", "warning": "yellow", "note": "cyan"}

Source = Annotated[Path, typer.Argument(metavar="INPUT", help="Problem to read, in any known format.")]
Fix = Annotated[
    Path | None,
    typer.Option(
        "--fix",
        metavar="FILE",
        help="Write the problem with safe repairs: duplicates, a mirrored y, disconnected parts, "
        "gross outliers.",
    ),
]
Solve = Annotated[
    bool,
    typer.Option(
        "--solve", help="Also solve a copy, and examine the solution, its variances and other minima nearby."
    ),
]
Report = Annotated[Path | None, typer.Option(metavar="FILE", help="Write a report as JSON.")]


@with_exit_code
def doctor(
    source: Source, fix: Fix = None, solve: Solve = False, report: Report = None, quiet: Quiet = False
) -> ExitCode:
    """Find what explains a bad result, and what to do.

    Findings are ranked, the most severe first.
    """
    from sfmcpp.cli.reading import note_written, read_with_notes
    from sfmcpp.cli.targets import Targets
    from sfmcpp.doctor import repair
    from sfmcpp.sources.io.api import write

    targets = Targets(fix, report)
    targets.check(source)
    problem = read_with_notes(source, quiet=quiet)
    diagnosis = _diagnose_problem(problem, solve)
    repaired = None if fix is None else repair(problem)
    if report is not None:
        _write_report(source, problem, diagnosis, repaired, report)
    if fix is not None and repaired is not None:
        write(_without_emptied_points(problem, repaired.problem), fix)
        if not quiet:
            note_written(repaired.problem, fix)
    if not quiet:
        print_result(_text(source, problem, diagnosis))
        for line in _write_repaired(fix, repaired, diagnosis):
            print_result(line)
    return ExitCode.DONE


def _without_emptied_points(before: Problem, after: Problem) -> Problem:
    """The problem without the points that have lost all their observations."""
    import numpy as np

    views, left = (np.bincount(some.point_index, minlength=some.num_points) for some in (before, after))
    emptied = (views > 0) & (left == 0)
    return after.with_points(~emptied) if emptied.any() else after


def _diagnose_problem(problem: Problem, solve: bool) -> Diagnosis:
    from sfmcpp.doctor import diagnose
    from sfmcpp.errors import InvalidArgument
    from sfmcpp.weighting import solve as solved

    if not solve:
        return stoppable(lambda: diagnose(problem))
    copy = problem.copy()
    try:
        summary = solved(copy).require_uninterrupted()
    except InvalidArgument:  # what a solve refuses is a finding
        return stoppable(lambda: diagnose(problem))
    return stoppable(lambda: diagnose(copy, summary=summary))


def _write_report(
    source: Path, problem: Problem, diagnosis: Diagnosis, repaired: Repair | None, path: Path
) -> None:
    from sfmcpp.study.report_files import write_report

    size = {
        "path": str(source),
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
    }
    done = None if repaired is None else repaired.done
    write_report({"input": size, **diagnosis.to_dict(), "repaired": done}, path)


def _write_repaired(path: Path | None, repaired: Repair | None, diagnosis: Diagnosis) -> list[str]:
    if path is None or repaired is None:
        return []
    unmended = (
        "nothing" if diagnosis.is_healthy else "nothing: no finding has a safe repair, follow their remedies"
    )
    done = repaired.done or [unmended]
    return [*(f"mended   {line}" for line in done), f"written  {path}"]


def _text(source: Path, problem: Problem, diagnosis: Diagnosis) -> str:
    from sfmcpp.cli.display import rendered

    counts = [
        f"{len(found)} {name}{'s' * (len(found) > 1)}"
        for name in _STYLES
        if (found := diagnosis.of_severity(name))
    ]
    verdict = ", ".join(counts) if counts else "nothing found"
    lines = [f"{source}: {problem.num_cameras:,} cameras, {problem.num_points:,} points, "
             f"{problem.num_observations:,} observations: {verdict}", ""]  # fmt: skip
    return "\n".join([*lines, rendered(_table(diagnosis))]).rstrip() + "\n"


def _table(diagnosis: Diagnosis) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for rank, finding in enumerate(diagnosis.findings, start=1):
        where = f" [{finding.where}]" if finding.where else ""
        what = Text(finding.code, style="bold").append(f": {finding.what}{where}", style="default")
        table.add_row(str(rank), Text(finding.severity, style=_STYLES[finding.severity]), what)
        table.add_row("", "", Text(f"→ {finding.advice}", style="dim"))
    for reason in diagnosis.skipped:
        table.add_row("", Text("limited", style="dim"), Text(reason, style="dim"))
    return table
