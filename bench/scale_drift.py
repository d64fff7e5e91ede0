"""How far images alone hold the scale of a map: what a run expects of itself, and what the truth says.

    python bench/scale_drift.py [--drives tuning|reporting|0036 0036:1/4 0039@half-the-tracks …]

A line for each drive, part or altered drive (names as in bench/drives.py) and for runs without a sensor and
with the gyroscope: log(scale over the last fifth of the way / over the first), its expected standard
deviation (`sfmcpp.slam.scale_sigmas`), their quotient z, and whether the run warns. The last line has the
root mean square of z, 1 if expectations are right.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from experiments.description import Row
from experiments.drive_names import drive_name
from experiments.drives import run_setting
from experiments.inputs import PROCESSES, TUNING
from experiments.real_drives import read
from experiments.text_table import text_table

from drives import bend
from sfmcpp.slam import scale_sigmas
from sfmcpp.slam.scale_drift import warn_of_scale
from sfmcpp.study.evaluation import evaluate

CHANGES = ("half-rate", "half-the-tracks", "noisy")
# Whole drives, their quarters (of 0027 and 0095 thirds), and drives as they might have been.
PARTS = {"0001": 2, "0005": 2, "0027": 3, "0051": 2, "0095": 3, "0036": 4, "0039": 4}
SENSORS: dict[str, list[str]] = {"none": [], "gyroscope": ["imu"]}
COLUMNS = ("drive", "sensors", "keyframes", "log(end/start)", "expected", "z", "warns")
# A map of fewer has no fifths to compare.
FEWEST_KEYFRAMES = 10


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--drives", type=drive_name, nargs="+", default=["tuning"])
    names = {"tuning": variants(TUNING), "reporting": variants(("0005", "0051", "0095"))}
    drives = [name for word in parser.parse_args(arguments).drives for name in names.get(word, [word])]
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(run, product(drives, SENSORS)))
    rows = [row for row in found if row is not None]
    print(text_table(COLUMNS, rows))
    for label in SENSORS:
        z = np.array([row["z"] for row in rows if row["sensors"] == label])
        print(f"{label}: root mean square of z {np.sqrt(np.mean(z**2)):.2f}, {len(z)} runs")


def variants(drives: Sequence[str]) -> list[str]:
    """The names of drives, their parts and their changes."""
    parts = [f"{name}:{k}/{PARTS[name]}" for name in drives for k in range(1, PARTS[name] + 1)]
    return [*drives, *parts, *(f"{name}@{change}" for name in drives for change in CHANGES)]


def run(asked: tuple[str, str]) -> Row | None:
    """Run one drive; None where the map is too small to tell."""
    name, label = asked
    drive = read(name)
    result = run_setting(drive, {"sensors": SENSORS[label]})
    sigmas = scale_sigmas(result)
    if sigmas is None or len(sigmas) < FEWEST_KEYFRAMES:
        return None
    ratio = bend(evaluate(result.trajectory(), drive.truth))
    if not ratio:
        return None
    expected, change = float(sigmas[-1]), float(np.log(ratio))
    numbers = {"keyframes": len(sigmas), "log(end/start)": change, "expected": expected}
    return {
        "drive": name,
        "sensors": label,
        **numbers,
        "z": change / expected,
        "warns": bool(warn_of_scale(result)),
    }


if __name__ == "__main__":
    main()
