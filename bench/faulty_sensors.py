"""Faulty sensors against the camera alone: what a bias, slip, clock or mounting costs, and if it is named.

    python bench/faulty_sensors.py [--drives 0001 0036:1/2 …] [--faults "bias 5" …] [--seeds N] [--slam …]
                                   [--share 0.01] [--out FILE]

A part of a drive is `number:k/n`; by default these are eight parts of the drives for tuning, of some hundred
frames each. A line for each fault: median and worst of `over none` of bench/drives.py, where the worst was,
and in how many runs a warning named a sensor. Fault-free sensors come first: their warnings are false alarms.
Biases (5°/s, and .05 rad/s) and slips (factors on the speed) last a fifth of the run, or all of it where that
is said; a smooth slip grows to its factor and falls again; stamps late by as many seconds and a mounting
turned about the vertical are wrong all the time, and the same for both sensors; reversed velocities have the
wrong signs all the time. Faults of files are those of `experiments/file_faults.py`: streams that the reader
refuses, or that contradict each other, count as named, and as refused. `--share` is what an odometer declares
of the distance as its standard deviation.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from experiments.description import Row
from experiments.drive_names import drive_name
from experiments.drives import median
from experiments.file_faults import FILE_FAULTS, UNTOUCHED
from experiments.inputs import PROCESSES
from experiments.text_table import text_table

from drives import assignment, over_none, run, write_runs
from sfmcpp.errors import InvalidArgument

PARTS = ("0001", "0027:1/2", "0027:2/2", "0036:1/2", "0036:2/2", "0039:1/3", "0039:2/3", "0039:3/3")
SENSORS = ("imu", "odometer", "both")
FAULTS: dict[str, dict[str, float]] = {
    "none": {},
    "bias 5": {"bias": 5.0},
    "bias 2.9": {"bias": 2.865},
    **{f"bias {rate} throughout": {"bias": rate, "throughout": True} for rate in (2.0, 5.0)},
    **{f"slip {factor}": {"slip": factor} for factor in (0.6, 0.8, 0.9, 1.1, 1.4)},
    **{f"smooth slip {factor}": {"slip": factor, "smooth": True} for factor in (0.6, 0.8, 0.9, 1.1, 1.4)},
    **{f"clock {late_s}": {"clock": late_s} for late_s in (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)},
    **{f"mounting {angle_deg}": {"mounting": angle_deg} for angle_deg in (-5.0, 5.0, 15.0, 90.0)},
    "reversed": {"slip": -1.0, "throughout": True},
    **{fault: {fault: True} for fault in FILE_FAULTS},
}
# The sensor that a fault does not touch; all others are faults of both.
_UNTOUCHED = {"bias": "odometer", "slip": "imu", **UNTOUCHED}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    args = _parser().parse_args(arguments)
    asked = [("none", drive, "none", seed) for drive in args.drives for seed in range(args.seeds)]
    asked += [
        (fault, drive, sensors, seed)
        for fault in args.faults
        for sensors in SENSORS
        if sensors not in (_UNTOUCHED.get(wrong) for wrong in FAULTS[fault])
        for drive in args.drives
        for seed in range(args.seeds)
    ]
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(partial(_run, slam=dict(args.slam), share=args.share), asked))
    columns = ["fault", *(f"{s} {what}" for s in SENSORS for what in WHAT)]
    print(text_table(columns, table(found, args.faults)))
    if args.out:
        write_runs(args.out, found)


WHAT = ("median", "worst", "at", "named")


def table(found: Sequence[Row], faults: Sequence[str]) -> list[Row]:
    """A line for each fault; `over_none` is put into each row."""
    alone = {(row["drive"], row["seed"]): row for row in found if row["sensors"] == "none"}
    for row in found:
        none = alone[row["drive"], row["seed"]]
        row["over_none"] = over_none(row, none) if row["posed"] and none["posed"] else None
    return [_line(fault, [row for row in found if row["fault"] == fault]) for fault in faults]


def _line(fault: str, found: Sequence[Row]) -> Row:
    line: Row = {"fault": fault}
    for sensors in SENSORS:
        rows = [row for row in found if row["sensors"] == sensors]
        known = [row for row in rows if row["over_none"] is not None]
        if known:
            worst = max(known, key=lambda row: row["over_none"])
            cells = (median([r["over_none"] for r in known]), worst["over_none"], worst["drive"])
            line |= {f"{sensors} {what}": cell for what, cell in zip(WHAT, cells, strict=False)}
        if rows:
            line[f"{sensors} named"] = f"{sum(bool(row['warnings']) for row in rows)} of {len(rows)}"
            if refused := sum("refused" in row for row in rows):
                line[f"{sensors} named"] += f", {refused} refused"
    return line


def _run(asked: tuple[str, str, str, int], slam: Row, share: float | None) -> Row:
    fault, drive, sensors, seed = asked
    wrong = {"file": fault} if fault in FILE_FAULTS else {"fault": FAULTS[fault]}
    options = {"slam": slam, "fault": {}, "blackout": 0.0, "share": share, **wrong}
    row = {"fault": fault, "drive": drive, "sensors": sensors, "seed": seed}
    try:
        return run((drive, sensors, seed), options) | row
    except InvalidArgument as error:  # as the reader of the file tells of it
        return row | {"posed": 0, "refused": True, "warnings": [str(error)]}


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--drives", type=drive_name, nargs="+", default=list(PARTS))
    parser.add_argument("--faults", nargs="+", default=list(FAULTS), choices=list(FAULTS))
    parser.add_argument("--seeds", type=int, default=1, help="runs of each, all but one with moved pixels")
    parser.add_argument("--slam", nargs="*", default=[], type=assignment, metavar="NAME=VALUE")
    parser.add_argument("--share", type=float, help="declared by an odometer; default: that of its class")
    parser.add_argument("--out", type=Path, help="JSON file of all runs")
    return parser


if __name__ == "__main__":
    main()
