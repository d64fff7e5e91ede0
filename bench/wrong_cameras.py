"""Whether a run notices that its camera is wrong: focal lengths off by 10 to 30 %, a distortion not given.

    python bench/wrong_cameras.py [--drives tuning|reporting|0036 0036:1/4 0039@half-the-tracks …]

For each change of the camera and for the right one, without sensors and with odometer and gyroscope: in how
many of the drives, their parts and changes (names as in bench/scale_drift.py) the run warns, and what it
blames. `--each` prints a line for each run: what the images prefer, over the truth, and how many standard
deviations that is from what was given.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
from experiments.description import Row
from experiments.drive_names import drive_name
from experiments.drives import run_setting
from experiments.inputs import PROCESSES, TUNING
from experiments.real_drives import read
from experiments.text_table import text_table
from scale_drift import variants

from sfmcpp.slam.camera_check import FreedIntrinsic, freed_intrinsics, warn_of_camera
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.sources.io.kitti_mat import KittiDrive

SENSORS: dict[str, list[str]] = {"none": [], "both": ["odometer", "imu"]}
COLUMNS = ("camera", "sensors", "runs", "blame f", "blame k1")
EACH = ("drive", "sensors", "camera", "f", "z of f", "fall of f", "k1", "z of k1", "fall of k1", "blames")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=drive_name, nargs="+", default=["tuning"])
    parser.add_argument("--each", action="store_true")
    asked = parser.parse_args(arguments)
    names = {"tuning": variants(TUNING), "reporting": reporting()}
    drives = [name for word in asked.drives for name in names.get(word, [word])]
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(run, product(drives, SENSORS, CAMERAS)))
    rows = [row for row in found if row is not None]
    if asked.each:
        print(text_table(EACH, rows))
    print(text_table(COLUMNS, [summed(rows, *case) for case in product(CAMERAS, SENSORS)]))


def reporting() -> list[str]:
    """Names of drives that nothing was chosen on."""
    return [*variants(("0005", "0051", "0095")), *(f"0020:{k}/4" for k in range(1, 5)), "clip"]


def with_focal(factor: float) -> Callable[[KittiDrive], KittiDrive]:
    """The drive with a focal length that is not its own."""
    return lambda drive: replace(drive, focal_px=factor * drive.focal_px)


def with_distortion(k1: float) -> Callable[[KittiDrive], KittiDrive]:
    """The drive seen through a lens that distorts, which nobody says."""

    def seen(drive: KittiDrive) -> KittiDrive:
        rays = (drive.left_px - drive.principal_point_px) / drive.focal_px
        distorted = rays * (1 + k1 * np.sum(rays**2, axis=1, keepdims=True))
        return replace(drive, left_px=distorted * drive.focal_px + drive.principal_point_px)

    return seen


CAMERAS: dict[str, Callable[[KittiDrive], KittiDrive]] = {
    "right": lambda drive: drive,
    "f × 0.8": with_focal(0.8),
    "f × 1.1": with_focal(1.1),
    "f × 1.3": with_focal(1.3),
    "k1 = −0.25": with_distortion(-0.25),
    "k1 = 0.1": with_distortion(0.1),
}


def run(asked: tuple[str, str, str]) -> Row | None:
    """Run one drive; None where there is no map."""
    name, sensors, camera = asked
    drive = read(name)
    world = run_setting(CAMERAS[camera](drive), {"sensors": SENSORS[sensors]}).world
    freed = {} if world is None else freed_intrinsics(world, SlamSettings())
    if not freed:
        return None
    warning = "".join(warn_of_camera(world, SlamSettings()))
    f, k1 = freed["f"], freed["k1"]
    return {
        "drive": name,
        "sensors": sensors,
        "camera": camera,
        "f": f.preferred / float(drive.focal_px[0]),
        "z of f": deviations(f),
        "fall of f": f.fall,
        "k1": k1.preferred,
        "z of k1": deviations(k1),
        "fall of k1": k1.fall,
        "blames": "k1" if "k1" in warning else "f" if warning else "",
    }


def deviations(freed: FreedIntrinsic) -> float:
    """How far what the images prefer is from what was given, in standard deviations."""
    return (freed.preferred - freed.given) / max(freed.sigma, 1e-12)


def summed(rows: Sequence[Row], camera: str, sensors: str) -> Row:
    """The line of a table for a camera and a set of sensors."""
    blames = Counter(row["blames"] for row in rows if (row["camera"], row["sensors"]) == (camera, sensors))
    return {
        "camera": camera,
        "sensors": sensors,
        "runs": blames.total(),
        "blame f": blames["f"],
        "blame k1": blames["k1"],
    }


if __name__ == "__main__":
    main()
