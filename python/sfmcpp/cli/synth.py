"""`sfmcpp synth`: a synthetic scene with a perturbed start, in any format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from sfmcpp.cli.choices import Quiet, completion_of, look_of_names
from sfmcpp.cli.console import ExitCode, print_note, print_result, with_exit_code
from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.sources.synthetic import SCENES, add_outliers, perturb

_NAMES = ", ".join(SCENES)
_DEFAULT = "Default: the scene's own."

Scene = Annotated[str, typer.Argument(help=f"One of {_NAMES}.", **look_of_names(tuple(SCENES), "SCENE"))]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="Output file, in any format.")]
Truth = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write the same observations with the true cameras and points."),
]
Cameras = Annotated[int | None, typer.Option(metavar="N", help=f"Number of cameras, at least 1. {_DEFAULT}")]
Points = Annotated[int | None, typer.Option(metavar="N", help=f"Number of points, at least 1. {_DEFAULT}")]
CameraModel = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        autocompletion=completion_of(("calibrated", "perspective", "bal")),
        help=f"calibrated, perspective or bal. {_DEFAULT}",
    ),
]
Focal = Annotated[float | None, typer.Option(metavar="PX", help=f"Focal length, positive. {_DEFAULT}")]
RadialDistortion = Annotated[
    str | None, typer.Option(metavar="K1,K2", help="Radial distortion of perspective and bal cameras.")
]
PixelSigma = Annotated[float, typer.Option(metavar="PX", help="Noise of pixel coordinates, at least 0.")]
Outliers = Annotated[
    float,
    typer.Option(
        metavar="SHARE", help="Share of observations moved to random places in their images, in [0, 1]."
    ),
]
OutlierSigma = Annotated[
    float | None,
    typer.Option(metavar="PX", help="Noise of outliers, in place of random places; positive."),
]
PointSigma = Annotated[
    float, typer.Option(metavar="M", help="Noise of initial point coordinates, at least 0.")
]
PositionSigma = Annotated[
    float, typer.Option(metavar="M", help="Noise of initial camera centres, at least 0.")
]
RotationSigma = Annotated[
    float, typer.Option(metavar="DEG", help="Noise of initial rotations, about each axis; at least 0.")
]
FocalSigma = Annotated[
    float, typer.Option(metavar="SHARE", help="Noise of the logarithm of free focal lengths, at least 0.")
]
Seed = Annotated[int, typer.Option(min=0, help="Random seed of scene and noise.")]


def two_numbers(text: str | None) -> tuple[float, float] | None:
    """Read "k1,k2"."""
    if text is None:
        return None
    try:
        k1, k2 = map(float, text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not two numbers k1,k2", param_hint="'--distortion'") from None
    return k1, k2


@with_exit_code
def synth(
    scene: Scene,
    output: Output,
    truth: Truth = None,
    cameras: Cameras = None,
    points: Points = None,
    camera_model: CameraModel = None,
    focal_px: Focal = None,
    distortion: RadialDistortion = None,
    pixel_sigma_px: PixelSigma = 1.0,
    outliers: Outliers = 0.0,
    outlier_sigma_px: OutlierSigma = None,
    point_sigma_m: PointSigma = 0.0,
    position_sigma_m: PositionSigma = 0.0,
    rotation_sigma_deg: RotationSigma = 0.0,
    focal_sigma: FocalSigma = 0.0,
    seed: Seed = 0,
    quiet: Quiet = False,
) -> ExitCode:
    """Generate a synthetic problem with known truth.

    Noise is normal: its options are standard deviations.
    """
    if outlier_sigma_px is not None and outliers == 0:
        raise typer.BadParameter("there are no --outliers", param_hint="'--outlier-sigma-px'")
    options = _given_options(
        num_cameras=cameras,
        num_points=points,
        camera_model=camera_model,
        focal_px=focal_px,
        distortion=two_numbers(distortion),
    )
    noise = {
        "point_sigma_m": point_sigma_m,
        "position_sigma_m": position_sigma_m,
        "rotation_sigma_deg": rotation_sigma_deg,
        "focal_sigma": focal_sigma,
    }
    _check_targets(output, truth)
    with np.errstate(all="ignore"):  # noise beyond numbers is refused where it is written
        true_problem = SCENES[scene](pixel_sigma_px=pixel_sigma_px, seed=seed, **options)
        if outliers != 0:
            true_problem, _ = add_outliers(true_problem, outliers, sigma_px=outlier_sigma_px, seed=seed)
        start = perturb(true_problem, seed=seed, **noise)
    _write(start, output, true_problem, truth)
    if not quiet:
        print_result(f"{output}: {start}, {_tracks(start)}")
        _warn_of_blind_cameras(start)
    return ExitCode.DONE


def _given_options(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _check_targets(output: Path, truth: Path | None) -> None:
    from sfmcpp.cli.targets import require_writable_problem

    require_writable_problem(output)
    if truth is None:
        return
    require_writable_problem(truth)
    if os.path.realpath(truth) == os.path.realpath(output):
        raise DatasetError(truth, "is named twice: the problem and its truth must differ")


def _write(start: Problem, output: Path, true_problem: Problem, truth: Path | None) -> None:
    from sfmcpp.sources.io.api import write

    if truth is not None:
        write(true_problem, truth)
    write(start, output)


def _warn_of_blind_cameras(problem: Problem) -> None:
    seen = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    if blind := int((seen == 0).sum()):
        few = f"{blind:,} of {problem.num_cameras:,} cameras see no point that another one sees"
        print_note(
            f"warning: {few}: they are too far apart, or the points too few; give more --cameras or --points"
        )


def _tracks(problem: Problem) -> str:
    lengths = np.bincount(problem.point_index, minlength=max(problem.num_points, 1))
    return f"{lengths.mean():.1f} observations per point, at most {lengths.max()}"
