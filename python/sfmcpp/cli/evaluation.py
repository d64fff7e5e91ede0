"""From two trajectory files to a table, a report and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from sfmcpp.cli.exit_codes import ExitCode, say
from sfmcpp.cli.report import write_report
from sfmcpp.cli.targets import Targets
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.study.evaluation import AlignmentRule, Evaluation, evaluate


class Options(TypedDict):
    """Keyword arguments of :func:`sfmcpp.study.evaluation.evaluate`."""

    align_to: str
    with_scale: bool
    align_by: str
    match: str
    max_difference_s: float | None
    delta: float
    delta_unit: str
    all_pairs: bool


@dataclass(frozen=True)
class Inputs:
    """The trajectory and the truth: their files, and their formats where the names do not tell."""

    trajectory: Path
    truth: Path
    trajectory_format: str | None = None
    truth_format: str | None = None


def evaluate_files(inputs: Inputs, options: Options, targets: Targets, *, quiet: bool = False) -> ExitCode:
    """Read, align, measure, write, print.

    Raises
    ------
    DatasetError
        If a file cannot be read or written, or the two trajectories cannot be compared.
    InvalidArgument
        If `options` ask for an alignment that there is not.
    """
    AlignmentRule.parse(options["align_to"])
    for source in (inputs.trajectory, inputs.truth):
        targets.check(source)
    estimate = read_trajectory(inputs.trajectory, format=inputs.trajectory_format)
    truth = read_trajectory(inputs.truth, format=inputs.truth_format)
    try:
        evaluation = evaluate(estimate, truth, **options)
    except InvalidArgument as error:
        raise DatasetError(inputs.trajectory, f"compared with {inputs.truth}: {error}") from error
    _write(inputs, evaluation, targets)
    if not quiet:
        say("\n".join(_lines(inputs, evaluation, targets)))
    return ExitCode.DONE


def make_report(inputs: Inputs, evaluation: Evaluation) -> dict[str, Any]:
    """Build the report: the two inputs by name, then :meth:`Evaluation.to_dict`."""
    return {"input": {"path": str(inputs.trajectory), "truth": str(inputs.truth)}, **evaluation.to_dict()}


def _write(inputs: Inputs, evaluation: Evaluation, targets: Targets) -> None:
    if targets.report is not None:
        write_report(make_report(inputs, evaluation), targets.report)
    if targets.picture is not None:
        from sfmcpp.study.plotting import save_figure
        from sfmcpp.study.plotting.trajectories import plot_evaluation

        save_figure(plot_evaluation(evaluation), targets.picture)


def _lines(inputs: Inputs, evaluation: Evaluation, targets: Targets) -> list[str]:
    content = evaluation.to_dict()
    alignment = evaluation.alignment
    scaled = f", scale {alignment.similarity.scale:.6g}" if alignment.with_scale else ""
    lines = [
        _line("trajectory", str(inputs.trajectory)),
        _line("truth", f"{inputs.truth}, {evaluation.truth.length_m:.2f} m long"),
        _line("matched", f"{len(evaluation.estimate)} poses"),
        _line("aligned to", f"{alignment.rule}: {alignment.count} {alignment.by}{scaled}"),
        _line("mean 3-D error", f"{evaluation.mean_3d_error_m:.6g} m"),
        _line("scale ratio", _scale_text(evaluation)),
        "",
        *_error_table("APE", content["ape"]),
        "",
        *_error_table(f"RPE over {evaluation.rpe_delta[0]:g} {evaluation.rpe_delta[1]}", content["rpe"]),
    ]
    lines += [_line("warning", alignment.warning)] if alignment.warning else []
    return lines + [_line("written", str(path)) for path in targets]


def _scale_text(evaluation: Evaluation) -> str:
    ratio = evaluation.scale_ratio
    if ratio is None:
        return "unknown: the truth does not move"
    return f"mean {ratio.mean:.6g}, median {ratio.median:.6g}, std {ratio.std:.6g}, max {ratio.max:.6g}"


def _error_table(title: str, content: dict[str, Any]) -> list[str]:
    tables = {relation: values for relation, values in content.items() if isinstance(values, dict)}
    names = list(next(iter(tables.values())))
    header = "".join(f"{name:>12}" for name in names)
    rows = [
        f"  {relation:<20}" + "".join(f"{values[name]:>12.5g}" for name in names)
        for relation, values in tables.items()
    ]
    return [f"{title:<22}{header}", *rows]


def _line(name: str, value: str) -> str:
    return f"{name:<16}{value}"
