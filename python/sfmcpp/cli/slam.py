"""`sfmcpp slam`: a camera's trajectory and a map, from tracks and sensors."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated

import typer

from sfmcpp.cli.choices import (
    Checkpoint,
    CheckpointEvery,
    OutputFolder,
    Quiet,
    Resume,
    choice_option,
    completion_of,
)
from sfmcpp.cli.console import ExitCode, with_exit_code
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.sensor_stream import SENSORS
from sfmcpp.slam.settings import FINAL_ADJUSTMENTS
from sfmcpp.sources.io.files import is_regular_file
from sfmcpp.sources.vision import CORNERS
from sfmcpp.weighting import POSE_METHODS as WEIGHTS
from sfmcpp.weighting import WEIGHT_BOUNDS


def _known_sensors(names: list[str]) -> list[str]:
    for name in names:
        if name not in SENSORS:
            raise typer.BadParameter(f"{name!r} is unknown; choose one of {', '.join(SENSORS)}")
        if names.count(name) > 1:
            raise typer.BadParameter(f"{name!r} is named twice")
    return names


def _sigmas(given: list[str]) -> dict[str, float | tuple[float, float] | None]:
    """Read ``NAME=SIGMA`` and ``NAME=SIGMA+SHARE%``, the name that of a sensor."""
    sigmas: dict[str, float | tuple[float, float] | None] = {}
    for text in given:
        name, _, number = text.partition("=")
        if name in sigmas:
            raise typer.BadParameter(f"{name!r} is named twice", param_hint="'--sensor-sigma'")
        with_share = re.fullmatch(r"(.+)\+(.+)%", number)
        try:
            if with_share:
                sigmas[name] = (float(with_share[1]), float(with_share[2]) / 100)
            else:
                sigmas[name] = None if number == "auto" else float(number)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r}: must be NAME=SIGMA, a number or auto; odometer=0.02+1% is 0.02 m plus 1 % of the "
                "distance",
                param_hint="'--sensor-sigma'",
            ) from None
    return sigmas


def _sensor_columns(texts: list[str]) -> dict[str, str | float]:
    """Read ``speed [km/h]=Wheel`` and the like."""
    columns: dict[str, str | float] = {}
    for text in texts:
        name, equals, own = (part.strip() for part in text.partition("="))
        if not (name and equals and own) or name in columns:
            rule = "must be NAME [UNIT]=OWN NAME, each name once"
            raise typer.BadParameter(f"{text!r}: {rule}", param_hint="'--sensor-column'")
        columns[name] = own
    return columns


def _refuse_without_sensor(option: str, value: object, what_for: str) -> None:
    if value is not None:
        raise typer.BadParameter(f"{value!r}: there is no --sensor {what_for}", param_hint=f"'{option}'")


def _camera(text: str | None) -> tuple[float, ...] | Path | None:
    """Read ``f,cx,cy``, all five intrinsics, or the path of a file."""
    if text is None:
        return None
    from sfmcpp.sources.cameras import camera_file, intrinsics_of

    if is_regular_file(camera_file(text)[0]):
        return Path(text)
    try:
        return tuple(intrinsics_of([float(word) for word in text.split(",")]).tolist())
    except ValueError:
        rule = f"{text!r}: must be a file, f,cx,cy or f,aspect,cx,cy,skew in pixels, f and aspect positive"
        raise typer.BadParameter(rule, param_hint="'--camera'") from None


def _fps(value: float | None) -> float | None:
    if value is not None and not (math.isfinite(value) and value > 0):
        raise typer.BadParameter(f"{value}: must be positive")
    return value


Source = Annotated[
    Path,
    typer.Argument(
        metavar="INPUT",
        help="A folder of images, EuRoC's mav0, a video; or tracks: a KITTI drive (.mat) or a text file.",
    ),
]
Camera = Annotated[
    str | None,
    typer.Option(
        metavar="FILE|F,CX,CY",
        help="Camera of images: K.txt, calib.txt, YAML or XML of OpenCV, ROS, Kalibr (FILE:cam1 or FILE:M1 "
        "for one of several) or EuRoC; or values in pixels, also F,ASPECT,CX,CY,SKEW. Default: calib.txt, "
        "K.txt or sensor.yaml with the images or one folder above.",
    ),
]
Fps = Annotated[
    float | None,
    typer.Option(
        callback=_fps,
        metavar="N",
        help="Images per second, positive. Default: times.txt (seconds, nanoseconds since 1970 or "
        "ISO 8601), KITTI's timestamps.txt, EuRoC's data.csv, image names in nanoseconds, the video's "
        "frame rate, or 10 for a folder.",
    ),
]
Corners = Annotated[str, choice_option(CORNERS, "Corners to track in images")]
Mask = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="An image of the size of the frames; nothing is followed where it is black, as on a bonnet.",
    ),
]
Stereo = Annotated[
    bool,
    typer.Option(
        "--stereo",
        help="Also use right images, which give metric scale: of a KITTI drive, or those in the folder "
        "beside (cam1, image_1, image_3, image_r, right). Where the right camera is tell EuRoC's "
        "sensor.yaml, P0 and P1 of calib.txt, Kalibr's camera chain, OpenCV's stereo calibration, ROS's "
        "left.yaml and right.yaml, or --baseline.",
    ),
]
Right = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Right images, if they are elsewhere; a folder or a video."),
]
Baseline = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="How far the right camera of a rectified pair is beside the left one; positive.",
    ),
]
Sensors = Annotated[
    list[str] | None,
    typer.Option("--sensor", metavar="NAME", callback=lambda names: _known_sensors(names or []),
                 autocompletion=completion_of(tuple(SENSORS)),
                 help=f"Sensor to use beside the camera; repeatable: {', '.join(SENSORS)}."),
]  # fmt: skip
SensorFiles = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="Sensor measurements: CSV, or a KITTI drive (.mat). Repeatable; INPUT serves other sensors.",
    ),
]
SensorColumns = Annotated[
    list[str] | None,
    typer.Option(
        "--sensor-column",
        metavar="NAME=OWN",
        help="A column of the CSV that has a name of its own: 'speed [km/h]=Wheel'; or a number in all "
        "lines: 'wx [rad/s]=0'. Repeatable.",
    ),
]
ClockOffset = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="Camera time minus sensor time, also negative, added to sensor time stamps. Default: that of "
        "Kalibr's file of the mounting or camera, else 0.",
    ),
]
Sigmas = Annotated[
    list[str] | None,
    typer.Option(
        "--sensor-sigma",
        metavar="NAME=SIGMA",
        help="Standard deviation of a sensor: metres, for imu radians; auto: estimated during the run; "
        "odometer=0.02+1%: 0.02 m plus 1 % of the distance. Repeatable.",
    ),
]
MountingOption = Annotated[
    str | None,
    typer.Option(
        "--mounting",
        metavar="HOW",
        help="Axes of the sensors: camera (x right, y down, z forward), forward (x forward, y left, z up, "
        "camera looking forward), or a file with body_from_camera, rows of [R | t], EuRoC's sensor.yaml, "
        "or Kalibr's camchain-imucam.yaml (FILE:cam1 for one of several cameras). Default: from the "
        "drive or the file of the camera, else camera.",
    ),
]
View = Annotated[bool, typer.Option("--view", help="Show the growing map in the browser, until Ctrl-C.")]
Weights = Annotated[
    str | None,
    typer.Option(metavar="RULE", help=f"How sensor weights are chosen: {', '.join(WEIGHTS)}. Default: loo."),
]
Bounds = Annotated[
    str,
    choice_option(
        WEIGHT_BOUNDS,
        "Bounds of the weights",
        "; declared: at most the weight of the sensor's standard deviation, at least what a conflict with "
        "the images leaves of it",
    ),
]
Final = Annotated[
    str,
    choice_option(
        FINAL_ADJUSTMENTS,
        "Adjust all keyframes together at the end",
        "; auto: kept if the images and all sensors improve",
    ),
]


@with_exit_code
def slam(
    source: Source,
    output: OutputFolder,
    sensor: Sensors = None,
    sensor_file: SensorFiles = None,
    sensor_column: SensorColumns = None,
    mounting: MountingOption = None,
    clock_offset: ClockOffset = None,
    sensor_sigma: Sigmas = None,
    weights: Weights = None,
    weight_bounds: Bounds = WEIGHT_BOUNDS[0],
    camera: Camera = None,
    fps: Fps = None,
    corners: Corners = CORNERS[0],
    mask: Mask = None,
    stereo: Stereo = False,
    right: Right = None,
    baseline: Baseline = None,
    window: Annotated[
        int, typer.Option(metavar="N", help="Keyframes moved by the local adjustment, at least 2.")
    ] = 8,
    final_adjustment: Final = FINAL_ADJUSTMENTS[0],
    seed: Annotated[int, typer.Option(min=0, help="Random seed.")] = 0,
    view: View = False,
    quiet: Quiet = False,
    checkpoint: Checkpoint = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = None,
) -> ExitCode:
    """Trajectory and map from a camera and other sensors."""
    from sfmcpp.cli.checkpoints import Checkpoints
    from sfmcpp.cli.slam_run import run_slam_files

    if not sensor:
        _refuse_without_sensor("--weights", None if weights == "none" else weights, "to weigh")
        other_bounds = None if weight_bounds == WEIGHT_BOUNDS[0] else weight_bounds
        _refuse_without_sensor("--weight-bounds", other_bounds, "to weigh")
        _refuse_without_sensor("--mounting", mounting, "that sits on it")
        _refuse_without_sensor("--clock-offset", clock_offset, "with a clock")
        if sensor_file:
            raise InvalidArgument("sensor_file: no --sensor is named that could use it")
    settings = {
        "sensors": sensor or [],
        "sigmas": _sigmas(sensor_sigma or []),
        "weights": weights or "loo",
        "weight_bounds": weight_bounds,
        "window": window,
        "final_adjustment": final_adjustment,
        "seed": seed,
    }
    images = {"camera": _camera(camera), "fps": fps, "corners": corners, "mask": mask}
    pair = {"stereo": stereo, "right": right, "baseline_m": baseline}
    columns = _sensor_columns(sensor_column or [])
    sensors = {"sensor_file": sensor_file, "sensor_columns": columns, "mounting": mounting}
    opening = {**images, **pair, **sensors, "clock_offset_s": clock_offset}
    kept = Checkpoints(checkpoint, checkpoint_every, resume)
    return run_slam_files(source, output, settings, opening, kept, view=view, quiet=quiet)
