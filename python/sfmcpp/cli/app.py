"""The commands and their options."""

from __future__ import annotations

from inspect import signature
from pathlib import Path
from typing import Annotated

import typer

import sfmcpp
from sfmcpp.ba import GAUGES, LINE_SEARCHES, LINEAR_SOLVERS, LOSSES, METHODS
from sfmcpp.cli.choices import loss_scale, one_of, refined_intrinsics
from sfmcpp.cli.evaluate import evaluate
from sfmcpp.cli.exit_codes import ExitCode, say, with_exit_code
from sfmcpp.cli.slam import slam
from sfmcpp.cli.synth import synth

# What `sfmcpp.solve` does when it is not told, so that both ways in agree.
DEFAULT = {name: given.default for name, given in signature(sfmcpp.solve).parameters.items()}

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    # Plain help: the rich one takes longer to import than the rest of the command line.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bundle adjustment of cameras and points.",
)


def _choice(name: str, choices: tuple[str, ...], what: str) -> typer.models.OptionInfo:
    listed = ", ".join(choices)
    option: typer.models.OptionInfo = typer.Option(
        name, metavar="NAME", callback=one_of(choices), help=f"{what}: {listed}."
    )
    return option


Input = Annotated[Path, typer.Argument(metavar="INPUT", help="Problem to read, in any known format.")]
Method = Annotated[str, _choice("--method", METHODS, "Minimiser")]
LineSearch = Annotated[str, _choice("--line-search", LINE_SEARCHES, "Line search along each step")]
SearchIterations = Annotated[
    int, typer.Option(help="Iterations, from the first on, that search along their step.")
]
SearchDamping = Annotated[
    float | None, typer.Option(metavar="LAMBDA", help="Search in later iterations too while λ is above this.")
]
SearchOnRejection = Annotated[
    bool,
    typer.Option(
        "--line-search-on-rejection", help="Search in later iterations too where the step would be rejected."
    ),
]
CameraModel = Annotated[
    str | None, _choice("--camera-model", ("projective",), "Cameras to solve for in place of the input's")
]
LinearSolver = Annotated[
    str, _choice("--linear-solver", LINEAR_SOLVERS, "Solver of the reduced camera system")
]
Loss = Annotated[str, _choice("--loss", LOSSES, "Robust loss")]
LossScale = Annotated[
    str, typer.Option(metavar="PX|auto", help="Residual from which the loss bends; auto: from the data.")
]
Tolerance = Annotated[float, typer.Option(help="Relative decrease of the cost at which to stop.")]
Refine = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES", help="Intrinsics to refine, such as f,k1,k2, or none; else the input's choice."
    ),
]
Gauge = Annotated[str, _choice("--gauge", GAUGES, "What holds position, orientation and scale")]


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"sfmcpp {sfmcpp.__version__}")
        raise typer.Exit


@app.callback()
def _options_of_all(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
@with_exit_code
def solve(
    source: Input,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Where to write the solved problem.")
    ] = None,
    method: Method = DEFAULT["method"],
    line_search: LineSearch = DEFAULT["line_search"],
    line_search_iterations: SearchIterations = DEFAULT["line_search_iterations"],
    line_search_damping: SearchDamping = None,
    line_search_on_rejection: SearchOnRejection = False,
    camera_model: CameraModel = None,
    linear_solver: LinearSolver = DEFAULT["linear_solver"],
    loss: Loss = DEFAULT["loss"],
    loss_scale_px: LossScale = str(DEFAULT["loss_scale_px"]),
    max_iterations: Annotated[int, typer.Option(help="Steps tried at most.")] = DEFAULT["max_iterations"],
    max_seconds: Annotated[float | None, typer.Option(help="Time limit of the solve, in seconds.")] = None,
    function_tolerance: Tolerance = DEFAULT["function_tolerance"],
    threads: Annotated[int, typer.Option(help="Threads; 0: as many as are useful.")] = DEFAULT["threads"],
    gauge: Gauge = DEFAULT["gauge"],
    refine: Refine = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to write a report, as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to draw the convergence: png, svg, pdf.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> ExitCode:
    """Adjust cameras, intrinsics and points of a problem."""
    from sfmcpp.cli.run import Job, solve_file
    from sfmcpp.cli.targets import Targets

    options = {
        "method": method,
        "line_search": line_search,
        "line_search_iterations": line_search_iterations,
        "line_search_damping": line_search_damping,
        "line_search_on_rejection": line_search_on_rejection,
        "linear_solver": linear_solver,
        "loss": loss,
        "loss_scale_px": loss_scale(loss_scale_px),
        "max_iterations": max_iterations,
        "max_seconds": max_seconds,
        "function_tolerance": function_tolerance,
        "threads": threads,
        "gauge": gauge,
    }
    targets = Targets(output, report, plot)
    return solve_file(Job(source, targets, options, refined_intrinsics(refine), camera_model, quiet))


@app.command()
@with_exit_code
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Problem to read.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="File to write, or folder for COLMAP.")],
) -> ExitCode:
    """Write a problem in another format; the names tell the formats."""
    from sfmcpp.cli.targets import require_writable_problem
    from sfmcpp.sources.io.api import read, write

    require_writable_problem(target)
    problem = read(source)
    write(problem, target)
    say(f"{target}: {problem}")
    return ExitCode.DONE


@app.command()
@with_exit_code
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FOLDER", help="Folder to write into.")
    ] = Path("sfmcpp-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the scene and of its noise.")] = 0,
) -> ExitCode:
    """Solve a synthetic scene: 30 cameras on a circle around 500 points."""
    from sfmcpp.cli.run import run_demo

    return run_demo(output, seed)


app.command()(synth)
app.command()(evaluate)
app.command()(slam)
