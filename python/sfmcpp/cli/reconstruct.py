"""`sfmcpp reconstruct`: from photos or tracks to a model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from sfmcpp.cli.choices import OutputFolder, Quiet, choice_option
from sfmcpp.cli.console import ExitCode, with_exit_code
from sfmcpp.sensors.gps import LEAST_POSITIONS
from sfmcpp.sfm.cameras import FREE_INTRINSICS, SHARING
from sfmcpp.sfm.run import METHODS as WAYS
from sfmcpp.sources.cameras import camera_file
from sfmcpp.sources.io.files import is_folder, is_regular_file
from sfmcpp.sources.vision.pairs import MATCHERS

METHODS = tuple(WAYS)
CAMERA_MODELS = ("auto", *FREE_INTRINSICS)


def _camera(text: str) -> str | float | Path:
    """Read ``auto``, ``exif``, a focal length [px] or the path of a file with K."""
    if text in ("auto", "exif"):
        return text
    try:
        focal = float(text)
    except ValueError:
        return _existing_file(text, "'--camera'", "auto, exif, a focal length in pixels")
    if not (math.isfinite(focal) and focal > 0):
        raise typer.BadParameter(f"{text!r}: a focal length must be positive", param_hint="'--camera'")
    return focal


def _gps(text: str) -> str | Path:
    return text if text in ("auto", "exif", "none") else _existing_file(text, "'--gps'", "auto, exif, none")


def _existing_file(text: str, option: str, others: str) -> Path:
    if not is_regular_file(camera_file(text)[0]):
        missing = "; there is no such file" if camera_file(text)[0].suffix else ""
        raise typer.BadParameter(f"{text!r}: must be {others} or a file{missing}", param_hint=option)
    return Path(text)


def _masks(path: Path | None) -> Path | None:
    if path is not None and not is_folder(path):
        raise typer.BadParameter(f"{str(path)!r}: is no folder")
    return path


Source = Annotated[
    Path,
    typer.Argument(
        metavar="INPUT",
        help="A folder of photos; a COLMAP database with keypoints and matches; or tracks: VGG (.xy), text, "
        "NPZ, BAL, or a COLMAP model (only its observations are used).",
    ),
]
Method = Annotated[str, choice_option(METHODS, "Reconstruction method")]
Camera = Annotated[
    str,
    typer.Option(
        metavar="FILE|PIXELS|exif|auto",
        help="Known calibration: a file (K.txt, calib.txt, YAML or XML of OpenCV, Kalibr, EuRoC), "
        "held fixed; an initial focal length in pixels, held fixed with --camera-model fixed; exif: focal "
        "lengths from EXIF, required; auto: from EXIF, else estimated.",
    ),
]
Model = Annotated[str, choice_option(CAMERA_MODELS, "Intrinsics to refine")]
Shared = Annotated[str, choice_option(SHARING, "Which photos share intrinsics")]
Matcher = Annotated[str, choice_option(MATCHERS, "Which pairs of photos are matched")]
Masks = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        callback=_masks,
        help="Folder of masks, PHOTO.jpg.png or PHOTO.png; nothing is detected where they are black. Photos "
        "without one: where they are transparent.",
    ),
]
Gps = Annotated[
    str,
    typer.Option(
        metavar="exif|FILE.csv|none|auto",
        help=f"Positions of the photos. auto: from EXIF, if at least {LEAST_POSITIONS} photos have one.",
    ),
]
PositionsOut = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write the camera positions of the largest model: csv, geojson."),
]
Subpixel = Annotated[
    bool,
    typer.Option(
        "--subpixel/--no-subpixel",
        help="Refine keypoints to subpixel accuracy by aligning image patches.",
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Continue an earlier run in DIR that was interrupted or had fewer photos. Default: start again.",
    ),
]
View = Annotated[bool, typer.Option("--view", help="Open the model in the browser at the end.")]
Threads = Annotated[
    int | None, typer.Option(min=1, help="Threads. Default: one per core. Does not change results.")
]


@with_exit_code
def reconstruct(
    source: Source,
    output: OutputFolder,
    method: Method = "incremental",
    camera: Camera = "auto",
    camera_model: Model = "auto",
    shared_camera: Shared = "auto",
    matcher: Matcher = "auto",
    masks: Masks = None,
    gps: Gps = "auto",
    positions_out: PositionsOut = None,
    subpixel: Subpixel = True,
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0,
    resume: Resume = False,
    view: View = False,
    threads: Threads = None,
    quiet: Quiet = False,
) -> ExitCode:
    """Cameras and points from photos or tracks."""
    from sfmcpp.cli.reconstruct_run import run_reconstruction
    from sfmcpp.cli.targets import Targets

    options = {
        "method": method,
        "camera": _camera(camera),
        "camera_model": camera_model,
        "shared_camera": shared_camera,
        "matcher": matcher,
        "masks": masks,
        "gps": _gps(gps),
        "subpixel": subpixel,
        "seed": seed,
        "threads": threads,
    }
    targets = Targets(positions=positions_out)
    return run_reconstruction(source, output, options, targets, resume=resume, view=view, quiet=quiet)
