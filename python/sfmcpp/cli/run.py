"""From a file to a solved problem, its report and its picture: what `solve` and `demo` share."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import sfmcpp
from sfmcpp.ba import Summary, as_projective
from sfmcpp.ba.ranks import Communicator, Ranks
from sfmcpp.cli.checkpoints import Checkpoints
from sfmcpp.cli.exit_codes import ExitCode, say, tell, tell_error
from sfmcpp.cli.launched import launched_ranks, together
from sfmcpp.cli.stopping import ctrl_c_noted
from sfmcpp.cli.targets import Targets
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.sources.io.api import read, write
from sfmcpp.sources.io.files import failures_named
from sfmcpp.sources.synthetic import circle_scene, perturb
from sfmcpp.weighting import solve


@dataclass(frozen=True)
class Job:
    """One solve as asked for on the command line.

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
    """

    source: Path
    targets: Targets
    options: dict[str, Any]
    refine: tuple[str, ...] | None = None
    camera_model: str | None = None
    quiet: bool = False
    checkpoints: Checkpoints = field(default_factory=Checkpoints)
    mpi: bool = False


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
        return together(ranks, lambda heeded: _solve_file_on(job, ranks, heeded))
    problem, seconds_read = _prepared(job)
    return _finished(job, problem, _solve(job, problem), seconds_read)


def _solve_file_on(job: Job, ranks: Ranks, heeded: Callable[[], None]) -> ExitCode:
    from sfmcpp.study.report_files import peak_memory_bytes

    prepared: list[tuple[Problem, float]] = []

    def prepare() -> None:
        if job.checkpoints.folder or job.checkpoints.resumed:
            raise InvalidArgument("--checkpoint, --resume: not on several ranks, whose state is not saved")
        prepared.append(_prepared(job))

    ranks.from_root(prepare)
    problem, seconds_read = prepared[0] if ranks.is_root else (None, 0.0)
    summary = _solve(job, problem, ranks.communicator)
    if summary.termination == "interrupted":
        heeded()
    memory = ranks.everyones(peak_memory_bytes())
    return ranks.from_root(lambda: _finished(job, cast(Problem, problem), summary, seconds_read, memory))


def _prepared(job: Job) -> tuple[Problem, float]:
    """The problem, and how long it took to read it [s]."""
    _check_options(job.options)
    job.targets.check(job.source)
    job.checkpoints.check_input_stays(job.source, job.targets.problem)
    job.checkpoints.check()
    started = time.perf_counter()
    problem = _problem(job)
    return problem, time.perf_counter() - started


def _finished(
    job: Job, problem: Problem, summary: Summary, seconds_read: float, memory: Sequence[float] = ()
) -> ExitCode:
    """Write and print; `memory` is the largest that each rank has used [bytes]."""
    with ctrl_c_noted():
        report = _report(job.source, problem, summary, seconds_read)
        report |= {"peak_memory_bytes_of_ranks": list(memory)} if memory else {}
        complaints = _write_results(job, problem, summary, report) + job.checkpoints.failures
    if not (job.quiet or complaints):
        from sfmcpp.cli.display import print_summary

        print_summary(job.source, problem, summary, seconds_read, job.targets)
    return _exit_code(job, summary, complaints)


def _problem(job: Job) -> Problem:
    problem = read(job.source)
    problem = problem if job.camera_model is None else as_projective(problem)
    try:
        if job.refine is not None:
            problem.set_free_intrinsics(*job.refine)
        job.targets.check_fits(problem)
    except InvalidArgument as error:
        raise DatasetError(job.source, str(error)) from error
    return problem


def _check_options(values: dict[str, Any]) -> None:
    options = sfmcpp.SolveOptions()
    for name, value in values.items():
        setattr(options, name, value)
    options.validate()


def _solve(job: Job, problem: Problem | None, comm: Communicator | None = None) -> Summary:
    from sfmcpp.cli.display import shown_progress

    try:
        with shown_progress(quiet=job.quiet or problem is None) as listener:
            return solve(
                problem,
                callback=listener,
                checkpoint=job.checkpoints.save,
                resume=job.checkpoints.resume,
                comm=comm,
                **job.options,
            )
    except InvalidArgument as error:
        raise DatasetError(job.source, str(error)) from error


def _write_results(
    job: Job, problem: Problem, summary: Summary, report: dict[str, Any]
) -> list[DatasetError]:
    """Write every target, and go on where one fails: the others must not be lost with it."""

    def write_picture(path: Path) -> None:
        from sfmcpp.study.plotting import plot_convergence, save_figure

        save_figure(plot_convergence(summary), path)

    def write_its_report(path: Path) -> None:
        from sfmcpp.study.report_files import write_report

        write_report(report, path)

    steps: list[tuple[Path | None, Callable[[Path], None]]] = [
        (job.targets.problem, lambda path: write(problem, path)),
        (job.targets.report, write_its_report),
        (job.targets.picture, write_picture),
    ]
    return [error for path, step in steps if path is not None and (error := _failure(step, path)) is not None]


def _report(path: Path, problem: Problem, summary: Summary, seconds_read: float) -> dict[str, Any]:
    """All fields of the summary are in the report under their own names."""
    from sfmcpp.study.report_files import peak_memory_bytes

    size = {
        "path": str(path),
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
    }
    measured = {"seconds_read": seconds_read, "peak_memory_bytes": peak_memory_bytes()}
    return {"input": size, **measured, **summary.to_dict()}


def _failure(step: Callable[[Path], None], path: Path) -> DatasetError | None:
    try:
        step(path)
    except DatasetError as error:
        return error
    return None


def _exit_code(job: Job, summary: Summary, complaints: list[DatasetError]) -> ExitCode:
    if complaints:
        return tell_error("; ".join(map(str, complaints)))
    if summary.termination == "numerical_failure":
        tell(f"error: {job.source}: numerical failure: {summary.message}")
        return ExitCode.NUMERICAL_FAILURE
    if summary.termination == "interrupted":
        tell(f"interrupted after {summary.seconds_total:.1f} s: {_what_is_kept(job)}")
        return ExitCode.INTERRUPTED
    return ExitCode.DONE


def _what_is_kept(job: Job) -> str:
    kept = [f"the best state so far is in {job.targets.problem}"] if job.targets.problem else []
    return (
        "; ".join((*kept, *job.checkpoints.in_words))
        or "no output was asked for, the state so far is not kept"
    )


def run_demo(folder: Path, seed: int) -> ExitCode:
    """Write the thesis' circular scene (§4.4.1) with its noisy start to `folder`, and solve it there.

    Raises
    ------
    DatasetError
        If the folder or a file in it cannot be written.
    """
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
    source = folder / "problem.npz"
    targets = Targets(folder / "result.ply", folder / "report.json", folder / "convergence.png")
    targets.check(source)
    start = perturb(
        circle_scene(seed=seed), point_sigma_m=0.5, position_sigma_m=1.0, rotation_sigma_deg=15.0, seed=seed
    )
    write(start, source)
    code = solve_file(Job(source, targets, options={}))
    if code == ExitCode.DONE:
        say(f"The demo is in {folder.resolve()}")
    return code
