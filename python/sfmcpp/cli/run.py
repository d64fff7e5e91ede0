"""Read, solve, write and report: what `solve` and `demo` share."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfmcpp._core import SolveOptions
from sfmcpp.ba import Summary, as_projective
from sfmcpp.ba.options import OPTIONS
from sfmcpp.ba.parts import Part, ProblemSize, part_for_rank
from sfmcpp.ba.ranks import Ranks
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.cli.checkpoints import Checkpoints
from sfmcpp.cli.console import ExitCode, print_error, print_no_result, print_note
from sfmcpp.cli.control_points import Control, control_after_solve
from sfmcpp.cli.covariances import Precision
from sfmcpp.cli.flags import RIGS, with_flags
from sfmcpp.cli.georeferencing import Gps, outcome_after_solve, write_camera_positions
from sfmcpp.cli.interrupts import noted_interrupt
from sfmcpp.cli.mpi_launch import launched_ranks, run_on_ranks
from sfmcpp.cli.reading import note_left_out, note_written, read_with_notes
from sfmcpp.cli.targets import Targets, write_page
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.process_state import peak_memory_bytes
from sfmcpp.model.residual_group import Group
from sfmcpp.sources.io.api import read_part, write, write_part
from sfmcpp.weighting import solve

if TYPE_CHECKING:
    from sfmcpp.sfm.control_points import ControlOutcome
    from sfmcpp.sfm.result import GpsOutcome


@dataclass(frozen=True)
class Job:
    """Arguments of a solve on the command line.

    Attributes
    ----------
    source : Path
        The input.
    targets : Targets
        What to write.
    options : dict
        Keyword arguments of :func:`sfmcpp.solve`.
    refine : tuple of str, optional
        Intrinsic parameters to refine, in place of those the input frees.
    camera_model : str, optional
        ``"projective"``: forget the calibration of the input.
    quiet : bool
        Whether to print nothing but errors.
    checkpoints : Checkpoints
        Where to save and to resume.
    mpi : bool
        Whether to ask MPI for other processes even where no known launcher has left a trace.
    gps : Gps
        Positions to bring the problem to.
    control : Control
        Surveyed points to bring the problem to.
    rigs : str
        ``"fixed"``: sensors stay where they are in their rigs; ``"free"``: all but the first of each rig are
        estimated; ``"ignore"``: each camera moves by itself.
    """

    source: Path
    targets: Targets
    options: dict[str, Any]
    refine: tuple[str, ...] | None = None
    camera_model: str | None = None
    quiet: bool = False
    checkpoints: Checkpoints = field(default_factory=Checkpoints)
    mpi: bool = False
    gps: Gps = field(default_factory=Gps)
    control: Control = field(default_factory=Control)
    rigs: str = RIGS[0]


def solve_file(job: Job) -> ExitCode:
    """Read, solve, write, print. All that can be checked is checked before the solve.

    Where a launcher of MPI has started several processes, rank 0 does all but the solve alone.

    Raises
    ------
    DatasetError
        If the input cannot be read or solved, or a target cannot be written.
    InvalidArgument
        If an option breaks a rule.
    """
    ranks = launched_ranks(asked=job.mpi)
    if ranks is not None:
        return run_on_ranks(ranks, _common_to_ranks(job), lambda heeded: _solve_file_on(job, ranks, heeded))
    _check(job)
    job.checkpoints.check(quiet=job.quiet)
    started = time.perf_counter()
    problem = _problem(job)
    job.targets.check_fits(problem, refined=job.refine is not None)
    if job.control.source is None:  # its points make another world of it
        job.gps.check_fits(job.targets.positions, problem)
        if not job.quiet and job.options.get("max_iterations") != 0:
            job.gps.tell_if_missing(job.source, problem)
    seconds_read = time.perf_counter() - started
    size = ProblemSize.of(problem)  # of the input: control points are added to it
    limit = TimeLimit(job.options.get("max_seconds"))
    georeferenced = job.gps.georeference(problem, job.options)
    controlled = job.control.fit(problem, job.options)
    problem = problem if controlled is None else controlled.problem
    groups = [found.group for found in (georeferenced, controlled) if found is not None]
    gps_outcome = outcome_after_solve(georeferenced, problem)
    control_outcome = control_after_solve(controlled)
    summary = _solve(replace(job, options=limit.of(job.options)) if groups else job, problem, groups)
    with noted_interrupt() as is_stopped:
        complaints = _write_complaints(lambda path: write(problem, path), job.targets.problem)
        if job.targets.problem is not None and not (complaints or job.quiet):
            note_written(problem, job.targets.problem)
        gps, control = gps_outcome(), control_outcome()
        complaints += _write_complaints(
            lambda path: write_camera_positions(path, problem, gps), job.targets.positions
        )
        complaints += _write_complaints(lambda path: write_page(problem, path, job.source), job.targets.page)
        known = Precision()
        complaints += _write_complaints(
            lambda path: known.write(path, problem, summary, groups, job.options, is_stopped),
            job.targets.covariances,
        )
        placed: dict[str, GpsOutcome | ControlOutcome] = {} if gps is None else {"gps": gps}
        placed |= {} if control is None else {"control": control}
        return _report_and_print(job, size, summary, seconds_read, complaints, placed, known)


def _common_to_ranks(job: Job) -> dict[str, object]:
    """What of a command all ranks must be given alike."""
    common = {f"{each.name} of the command": getattr(job, each.name) for each in fields(job)}
    options = {name: value for name, value in job.options.items() if name != "threads"}
    return {"command": "solve", **common, "options of the command": options}


def _solve_file_on(job: Job, ranks: Ranks, heeded: Callable[[], None]) -> ExitCode:
    ranks.from_root(lambda: _check(job))
    ranks.from_root(lambda: job.gps.refuse_ranks(job.targets.positions))
    ranks.from_root(job.control.refuse_ranks)
    ranks.from_root(job.targets.refuse_ranks)
    started = time.perf_counter()
    part = _part(job, ranks)
    if job.targets.problem is None:
        part = part.without_numbers()
    ranks.from_root(lambda: job.targets.check_fits(part.problem, refined=job.refine is not None))
    size = ProblemSize.of(part.problem, ranks)
    seconds_read = time.perf_counter() - started
    summary = _solve(job, part.problem, ranks=ranks)
    if summary.termination == "interrupted":
        heeded()
    with noted_interrupt():
        complaints = _write_complaints(lambda path: write_part(part, path, ranks), job.targets.problem)
        memory = ranks.everyones(peak_memory_bytes())
        return ranks.from_root(
            lambda: _report_and_print(job, size, summary, seconds_read, complaints, {}, Precision(), memory)
        )


def _check(job: Job) -> None:
    _check_options(job.options)
    read = (job.gps.source, job.control.source)
    job.targets.check(job.source, *(path for path in read if path is not None))
    job.gps.check(job.targets.positions)
    job.control.check(job.gps.source, job.targets.positions)
    job.checkpoints.check_input_stays(job.source, job.targets.problem)


def _report_and_print(
    job: Job,
    size: ProblemSize,
    summary: Summary,
    seconds_read: float,
    complaints: list[DatasetError],
    placed: Mapping[str, GpsOutcome | ControlOutcome],
    known: Precision,
    memory: Sequence[float] = (),
) -> ExitCode:
    """Report and print; `placed` is what moved it, `memory` the largest that each rank has used [bytes]."""
    report = _report(job.source, size, summary, seconds_read)
    report |= {"peak_memory_bytes_of_ranks": list(memory)} if memory else {}
    report |= {name: outcome.to_dict() for name, outcome in placed.items()}
    report |= known.to_report()
    complaints = complaints + _write_reports(job, summary, report) + job.checkpoints.failures
    if not (job.quiet or complaints):
        from sfmcpp.cli.display import print_summary

        rows = [*(row for outcome in placed.values() for row in _world_rows(outcome)), *known.rows()]
        targets = job.targets if known.is_written else replace(job.targets, covariances=None)
        print_summary(job.source, size, summary, seconds_read, targets, rows)
    if known.is_interrupted and not complaints:
        print_note(f"interrupted: {known.loss}, all else is")
        return ExitCode.INTERRUPTED
    return _exit_code(job, summary, complaints, known.loss)


def _world_rows(outcome: GpsOutcome | ControlOutcome) -> Iterator[tuple[str, str]]:
    from sfmcpp.sfm.result import GpsOutcome
    from sfmcpp.study.report_table import control_rows, gps_rows

    yield from gps_rows(outcome) if isinstance(outcome, GpsOutcome) else control_rows(outcome)
    yield from (("warning", warning) for warning in outcome.warnings)


def _part(job: Job, ranks: Ranks) -> Part:
    """The part of this rank; the frames of projective images are made of all observations."""
    if job.camera_model is not None:
        return part_for_rank(lambda: _problem(job), ranks)
    part = read_part(job.source, ranks)
    if ranks.is_root and not job.quiet:
        note_left_out(job.source, part.problem)
    return replace(part, problem=ranks.agreed(lambda: _with_refined_intrinsics(job, part.problem)))


def _problem(job: Job) -> Problem:
    problem = read_with_notes(job.source, quiet=job.quiet)
    return _with_refined_intrinsics(job, problem if job.camera_model is None else as_projective(problem))


def _with_refined_intrinsics(job: Job, problem: Problem) -> Problem:
    if job.rigs == "free":
        if problem.rigs is None:
            raise DatasetError(job.source, "no rigs, so there are no sensors for --rigs free")
        problem.rigs = problem.rigs.freed()
    elif job.rigs == "ignore":
        problem.rigs = None
    try:
        if job.refine is not None:
            problem.set_free_intrinsics(*job.refine)
    except InvalidArgument as error:
        raise DatasetError(job.source, str(error)) from error
    return problem


def _check_options(values: dict[str, Any]) -> None:
    options = SolveOptions()
    for name, value in values.items():
        setattr(options, name, value)
    try:
        options.validate()
    except InvalidArgument as error:
        raise InvalidArgument(with_flags(str(error), OPTIONS)) from error


def _solve(job: Job, problem: Problem, groups: Sequence[Group] = (), ranks: Ranks | None = None) -> Summary:
    from sfmcpp.cli.display import shown_progress

    try:
        with shown_progress(quiet=job.quiet or not (ranks is None or ranks.is_root)) as listener:
            return solve(
                problem,
                constraints=groups,
                callback=listener,
                checkpoint=job.checkpoints.save,
                resume=job.checkpoints.resume,
                comm=None if ranks is None else ranks.communicator,
                **job.options,
            )
    except InvalidArgument as error:
        raise DatasetError(job.source, with_flags(str(error), OPTIONS)) from error


def _write_reports(job: Job, summary: Summary, report: dict[str, Any]) -> list[DatasetError]:
    """Write the files beside the result; if one fails, the others are still written."""

    def write_picture(path: Path) -> None:
        from sfmcpp.study.plotting import plot_convergence, save_figure

        save_figure(plot_convergence({job.source.name: summary}), path)

    def write_its_report(path: Path) -> None:
        from sfmcpp.study.report_files import write_report

        write_report(report, path)

    reported = _write_complaints(write_its_report, job.targets.report)
    return reported + _write_complaints(write_picture, job.targets.picture)


def _report(path: Path, size: ProblemSize, summary: Summary, seconds_read: float) -> dict[str, Any]:
    """All fields of the summary are in the report under their own names."""
    read = {
        "path": str(path),
        "cameras": size.num_cameras,
        "points": size.num_points,
        "observations": size.num_observations,
    }
    measured = {"seconds_read": seconds_read, "peak_memory_bytes": peak_memory_bytes()}
    return {"input": read, **measured, **summary.to_dict()}


def _write_complaints(step: Callable[[Path], None], path: Path | None) -> list[DatasetError]:
    """Errors of writing a file."""
    try:
        if path is not None:
            step(path)
    except DatasetError as error:
        return [error]
    return []


def _exit_code(job: Job, summary: Summary, complaints: list[DatasetError], loss: str) -> ExitCode:
    """Tell what went wrong; `loss` is what is missing of the results where a solve came to no end."""
    if complaints:
        return print_error("; ".join(map(str, complaints)))
    also = f"; {loss}" if loss else ""
    if summary.termination == "numerical_failure":
        return print_no_result(f"{job.source}: numerical failure: {summary.message}{also}")
    if summary.termination == "interrupted":
        print_note(f"interrupted after {summary.seconds_total:.1f} s: {_what_is_kept(job)}{also}")
        return ExitCode.INTERRUPTED
    return ExitCode.DONE


def _what_is_kept(job: Job) -> str:
    kept = [f"the best state so far is in {job.targets.problem}"] if job.targets.problem else []
    return (
        "; ".join((*kept, *job.checkpoints.in_words))
        or "no output was asked for, the state so far is not kept"
    )
