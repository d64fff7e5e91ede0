"""The commands and their options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import sfmcpp
from sfmcpp.cli.bag import bag
from sfmcpp.cli.choices import (
    Checkpoint,
    CheckpointEvery,
    ControlFile,
    ControlSigma,
    GpsSource,
    Resume,
    choice_option,
    look_of_names,
    refined_intrinsics,
    with_solve_options,
)
from sfmcpp.cli.console import ExitCode, print_result, with_exit_code
from sfmcpp.cli.doctor import doctor
from sfmcpp.cli.evaluate import evaluate
from sfmcpp.cli.flags import RIGS
from sfmcpp.cli.info import info
from sfmcpp.cli.reconstruct import reconstruct
from sfmcpp.cli.slam import slam
from sfmcpp.cli.synth import synth
from sfmcpp.sources.io.control_points import SURVEY_SIGMA_M
from sfmcpp.sources.io.trajectories import WRITABLE_TRAJECTORY_FORMATS

app = typer.Typer(
    pretty_exceptions_enable=False,
    # Plain help: the rich one takes longer to import than the rest of the command line.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Bundle adjustment, structure from motion and visual SLAM.",
)

WRITABLE_FORMATS = tuple(known.name for known in sfmcpp.formats() if known.writable)

Input = Annotated[Path, typer.Argument(metavar="INPUT", help="Problem to read, in any known format.")]
CameraModel = Annotated[
    str | None,
    typer.Option(
        help="Convert the cameras to this model first: projective.", **look_of_names(("projective",))
    ),
]
Refine = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES", help="Intrinsics to refine, such as f,k1,k2, or none. Default: as in the input."
    ),
]

View = Annotated[
    Path | None, typer.Option(metavar="FILE.html", help="Write a 3-D view of the result for a browser.")
]
CovarianceFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Write standard deviations (csv) or covariances (npz) of the result.",
    ),
]


def _print_version(wanted: bool) -> None:
    if wanted:
        print_result(f"sfmcpp {sfmcpp.__version__}")
        raise typer.Exit


@app.callback()
def _options_of_all(
    version: Annotated[
        bool,
        typer.Option("--version", "-V", is_eager=True, callback=_print_version, help="Print the version."),
    ] = False,
) -> None:
    pass


@app.command()
@with_exit_code
@with_solve_options
def solve(
    source: Input,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Output file, or folder for COLMAP.")
    ] = None,
    camera_model: CameraModel = None,
    refine: Refine = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a report as JSON.")] = None,
    positions_out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the camera positions: csv, geojson."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Plot the convergence: png, svg, pdf.")
    ] = None,
    view: View = None,
    covariances: CovarianceFile = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print only errors.")] = False,
    checkpoint: Checkpoint = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = None,
    gps: GpsSource = None,
    gcp: ControlFile = None,
    gcp_sigma_m: ControlSigma = SURVEY_SIGMA_M,
    rigs: Annotated[
        str, choice_option(RIGS, "Rig sensors: held fixed, estimated, or ignored as rigs")
    ] = RIGS[0],
    mpi: Annotated[bool, typer.Option("--mpi", help="Use MPI; automatic under mpiexec.")] = False,
    **options: Any,
) -> ExitCode:
    """Adjust cameras, intrinsics and points of a problem."""
    from sfmcpp.cli.checkpoints import Checkpoints
    from sfmcpp.cli.control import Control
    from sfmcpp.cli.georeferencing import Gps
    from sfmcpp.cli.run import Job, solve_file
    from sfmcpp.cli.targets import Targets

    targets = Targets(output, report, plot, positions_out, view, covariances)
    kept = Checkpoints(checkpoint, checkpoint_every, resume)
    refined = refined_intrinsics(refine)
    world = Gps(gps), Control(gcp, gcp_sigma_m)
    job = Job(source, targets, options, refined, camera_model, quiet, kept, mpi, *world, rigs)
    return solve_file(job)


@app.command()
@with_exit_code
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Problem or trajectory to read.")],
    target: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help="File to write, or folder for COLMAP. csv, geojson: camera positions. html: a page.",
        ),
    ],
    parts: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Write a folder of N parts, for MPI ranks.")
    ] = None,
    format: Annotated[
        str | None,
        choice_option(
            (*WRITABLE_FORMATS, *WRITABLE_TRAJECTORY_FORMATS),
            "Format of OUT, if its name is ambiguous, or of a trajectory (also of a problem's cameras)",
        ),
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the images, for transforms, openmvg and alicevision."),
    ] = None,
    times: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Time stamps of poses without any, one per line, for tum and euroc."
        ),
    ] = None,
) -> ExitCode:
    """Convert a problem or a trajectory to another format.

    File names determine the formats of problems. Under mpiexec each rank writes one part, and no rank
    holds the whole problem.
    """
    from sfmcpp.cli.convert import convert_file

    return convert_file(source, target, parts, format, images, times)


@app.command()
@with_exit_code
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="Output folder.")] = Path(
        "sfmcpp-demo"
    ),
    seed: Annotated[int, typer.Option(min=0, help="Random seed of scene and noise.")] = 0,
) -> ExitCode:
    """Solve and show a synthetic scene.

    30 cameras on a circle around 500 points.
    """
    from sfmcpp.cli.demo import run_demo

    return run_demo(output, seed)


app.command()(info)
app.command()(doctor)
app.command()(synth)
app.command()(evaluate)
app.command()(slam)
app.command()(bag)
app.command()(reconstruct)
