"""`sfmcpp bag`: what a ROS bag holds, and files of it that `sfmcpp slam` reads."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sfmcpp.cli.choices import Quiet
from sfmcpp.cli.console import ExitCode, print_note, print_result, with_exit_code
from sfmcpp.errors import InvalidArgument

if TYPE_CHECKING:
    from sfmcpp.sources.bags import Bag, UnpackedBag

Source = Annotated[
    Path,
    typer.Argument(metavar="BAG", help="A .bag of ROS 1; of ROS 2 a folder, or a .db3 or .mcap file."),
]
Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="New folder for the files. Default: list the topics."),
]
Topics = Annotated[
    list[str] | None,
    typer.Option(
        "--topic",
        metavar="NAME",
        help="Topic to take, one for images and one for each sensor; repeatable. Default: the only one of "
        "its kind.",
    ),
]
NoCamera = Annotated[
    bool, typer.Option("--no-camera", help="Leave out the calibration (CameraInfo) beside the images.")
]


@with_exit_code
def bag(
    source: Source,
    output: Output = None,
    topic: Topics = None,
    no_camera: NoCamera = False,
    quiet: Quiet = False,
) -> ExitCode:
    """Make files for slam of a ROS bag, or list its topics.

    Images, their calibration, gyroscope (Imu), GPS (NavSatFix) and odometer (Odometry, TwistStamped).
    """
    from sfmcpp.cli.display import shown_stages
    from sfmcpp.sources.bags import open_bag, unpack_bag

    if output is None:
        if topic or no_camera:
            raise InvalidArgument("--topic, --no-camera: are for files, give their folder with --output")
        with open_bag(source) as opened:
            print_result(bag_table(opened))
            print_result(
                f"\nsfmcpp bag {shlex.quote(str(source))} -o DIR   makes files of it for sfmcpp slam"
            )
        return ExitCode.DONE
    with shown_stages(quiet=quiet) as show:
        progress = partial(show, "messages")
        made = unpack_bag(source, output, topics=topic or (), camera=not no_camera, progress=progress)
    if not quiet:
        _print_made(made)
    return ExitCode.DONE


def bag_table(opened: Bag) -> str:
    """Topics of a bag, with what is read of them."""
    from rich.table import Table

    from sfmcpp.cli.display import rendered
    from sfmcpp.sources.bags import ROLES

    total = sum(topic.count for topic in opened.topics)
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for name in ("topic", "type"):
        table.add_column(name, overflow="fold")
    for name in ("messages", "rate [Hz]"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("read as", no_wrap=True)
    for topic in opened.topics:
        rate = f"{(topic.count - 1) / opened.duration_s:.1f}" if opened.duration_s and topic.count > 1 else ""
        role = ROLES.get(topic.type, "")
        table.add_row(topic.name, topic.type.replace("/msg/", "/"), f"{topic.count:,}", rate, role)
    head = f"{opened.path}: bag of ROS {opened.ros}, {opened.duration_s:.1f} s, {total:,} messages"
    return f"{head}\n\n{rendered(table)}"


def _print_made(made: UnpackedBag) -> None:
    for name, topic in made.topics.items():
        count = made.counts.get(name)
        print_result(f"{name:9} {topic}" + ("" if count is None else f": {count:,}"))
    for note in made.notes:
        print_note(f"note: {note}")
    if made.sensors and made.mounting is None:
        print_note(
            "note: the mounting is unknown: --mounting forward is a guess, for a camera that looks ahead"
        )
    print_result(f"written   {made.folder}\n\n{slam_command(made)}")


def slam_command(made: UnpackedBag) -> str:
    """The command line that runs SLAM on the files."""
    from sfmcpp.sources.bags.unpack import CAMERA_FILE, IMAGE_FOLDER, SENSOR_FILE

    words = [str(made.folder / IMAGE_FOLDER) if "images" in made.topics else "IMAGES"]
    words += ["--camera", str(made.folder / CAMERA_FILE) if "camera" in made.topics else "FILE"]
    for name in made.sensors:
        words += ["--sensor", name]
    if made.sensors:
        told = made.mounting or "forward"
        mounting = told if told in ("camera", "forward") else str(made.folder / told)
        words += ["--sensor-file", str(made.folder / SENSOR_FILE), "--mounting", mounting]
    if made.gps_sigma_m is not None:
        words += ["--sensor-sigma", f"gps={made.gps_sigma_m:.3g}"]
    return shlex.join(["sfmcpp", "slam", *words, "-o", str(made.folder / "slam")])
