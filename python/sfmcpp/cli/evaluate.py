"""`sfmcpp evaluate`: a trajectory against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sfmcpp.cli.choices import one_of
from sfmcpp.cli.exit_codes import ExitCode, with_exit_code

if TYPE_CHECKING:
    from sfmcpp.cli.evaluation import Options

# Those of the readers, named here so that --help imports none of them.
FORMATS = ("tum", "kitti", "euroc", "mat")


def _choice(name: str, choices: tuple[str, ...], what: str) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option(
        name, metavar="NAME", callback=one_of(choices), help=f"{what}: {', '.join(choices)}."
    )
    return option


def _format(name: str, what: str) -> typer.models.OptionInfo:
    def check(value: str | None) -> str | None:
        return None if value is None else one_of(FORMATS)(value)

    option: typer.models.OptionInfo = typer.Option(
        name,
        metavar="NAME",
        callback=check,
        help=f"Format of {what}: {', '.join(FORMATS)}; else by its name.",
    )
    return option


@with_exit_code
def evaluate(
    trajectory: Annotated[Path, typer.Argument(metavar="TRAJECTORY", help="Trajectory to measure.")],
    truth: Annotated[Path, typer.Option("--truth", metavar="FILE", help="True trajectory.")],
    align: Annotated[
        str, typer.Option(metavar="all|none|first:N", help="Poses to align by; first:0.1 is the first tenth.")
    ] = "all",
    scale: Annotated[bool, typer.Option("--scale/--no-scale", help="Whether aligning may scale.")] = True,
    align_by: Annotated[
        str, _choice("--align-by", ("positions", "poses"), "What to align; poses hold on straight roads too")
    ] = "positions",
    match: Annotated[
        str, _choice("--match", ("nearest", "interpolate"), "Which true pose belongs to an estimated one")
    ] = "nearest",
    max_difference_s: Annotated[
        float | None, typer.Option(help="How far in time poses match; else 0.01, or 0.5 to interpolate.")
    ] = None,
    delta: Annotated[float, typer.Option(help="Over how much relative errors are taken.")] = 1.0,
    delta_unit: Annotated[str, _choice("--delta-unit", ("frames", "m"), "Unit of --delta")] = "frames",
    all_pairs: Annotated[
        bool, typer.Option("--all-pairs", help="Relative errors from every pose on.")
    ] = False,
    trajectory_format: Annotated[str | None, _format("--format", "TRAJECTORY")] = None,
    truth_format: Annotated[str | None, _format("--truth-format", "the truth")] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to write a report, as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to draw both trajectories: png, svg, pdf.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> ExitCode:
    """Measure a trajectory against the truth: mean 3-D error, scale, absolute and relative pose errors."""
    from sfmcpp.cli.evaluation import Inputs, evaluate_files
    from sfmcpp.cli.targets import Targets

    options: Options = {
        "align_to": align,
        "with_scale": scale,
        "align_by": align_by,
        "match": match,
        "max_difference_s": max_difference_s,
        "delta": delta,
        "delta_unit": delta_unit,
        "all_pairs": all_pairs,
    }
    inputs = Inputs(trajectory, truth, trajectory_format, truth_format)
    return evaluate_files(inputs, options, Targets(None, report, plot), quiet=quiet)
