"""`sfmcpp solve`: bundle adjustment of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sfmcpp.cli import run
from sfmcpp.cli.checkpoints import Checkpoints
from sfmcpp.cli.choices import (
    Checkpoint,
    CheckpointEvery,
    ControlFile,
    ControlSigma,
    GpsSource,
    Quiet,
    Resume,
    choice_option,
    look_of_names,
    refined_intrinsics,
    with_solve_options,
)
from sfmcpp.cli.console import ExitCode, with_exit_code
from sfmcpp.cli.control_points import Control
from sfmcpp.cli.flags import RIGS
from sfmcpp.cli.georeferencing import Gps
from sfmcpp.cli.run import Job
from sfmcpp.cli.targets import Targets
from sfmcpp.sources.io.control_points import SURVEY_SIGMA_M

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
    quiet: Quiet = False,
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
    targets = Targets(output, report, plot, positions_out, view, covariances)
    kept = Checkpoints(checkpoint, checkpoint_every, resume)
    refined = refined_intrinsics(refine)
    world = Gps(gps), Control(gcp, gcp_sigma_m)
    job = Job(source, targets, options, refined, camera_model, quiet, kept, mpi, *world, rigs)
    return run.solve_file(job)
