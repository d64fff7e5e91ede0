"""One table over all drives: none, each sensor, both, and the sensors' streams integrated without a camera.

    python bench/drives.py [--drives tuning|reporting|all|0027 …] [--seeds N] [--tracks SHARE]
                           [--slam window=3 …] [--fault bias=5 slip=0.8]
                           [--blackout SECONDS] [--share 0.01] [--out FILE]

Settings are chosen on the drives for tuning, 0001, 0027, 0036 and 0039 of `$SFMCPP_DATA/kitti_tracks`, and on
no other; 0005, 0051, 0095, 0020 and kitti_clip, whose images are tracked here, are for reporting.

Errors are mean distances of all frames with a pose from the truth [m], aligned to all of it: by a similarity
where no sensor is used, rigidly elsewhere. `posed` counts these frames; `over none` is of those that both
have, as a gyroscope bridges what images alone lose; and `end/start` is the scale over the last fifth of the
way over that over the first. Of several seeds, cells are means, and the last columns their 95 % bootstrap
intervals. Further seeds move the pixels by 1e-6 of one; with `--tracks 0.95` each keeps another choice of
95 % of the tracks, which tells what of a difference is chance. A fault, degrees per second added to the yaw
rate or a factor on the speed (`smooth=true`: little by little), lasts a fifth of the run, from its second
fifth on, or with `throughout=true` all of it; stamps late by `clock` seconds and a camera turned by
`mounting` degrees are wrong all the time; a blackout is in the middle. `--sensors none stereo` takes the
right images, too; the clip has none. `distances` takes no directions from the odometer, and `--share` is what
an odometer declares of the distance as its standard deviation. A part of a drive is
`0036:1/2`, and `0036@stops` a drive as it might have been: see `experiments/altered_drives.py`;
`simulated/u-turn` or `"simulated/usual, late streams"` is one of `experiments/other_motions.py`. All faults
in one table: bench/faulty_sensors.py.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from experiments.altered_drives import with_some_tracks
from experiments.description import Row
from experiments.drive_names import drive_name
from experiments.drives import median, run_setting
from experiments.faults import SensorFaults
from experiments.file_faults import with_file_fault
from experiments.inputs import PROCESSES, TUNING, dead_reckoning, moved
from experiments.real_drives import read, with_blackout
from experiments.summaries import interval_of_mean
from experiments.text_table import text_table

from sfmcpp.model import Trajectory
from sfmcpp.slam.gap_check import UNSEEN
from sfmcpp.slam.scale_drift import warn_of_scale
from sfmcpp.sources.io.kitti_mat import KittiDrive
from sfmcpp.study.evaluation import Evaluation, evaluate

REPORTING = ("0005", "0051", "0095", "0020", "clip")
SENSORS: dict[str, list[str]] = {
    "none": [],
    "odometer": ["velocity"],
    "imu": ["imu"],
    "both": ["velocity", "imu"],
}
# The odometer as in the thesis, its velocities taken for distances.
DISTANCES = {"distances": ["odometer"], "distances, imu": ["odometer", "imu"]}
# With the right camera's tracks beside the left one's.
STEREO = {"stereo": [], "stereo, both": ["velocity", "imu"]}
ALL = {**SENSORS, **DISTANCES, **STEREO}
DEAD = "dead reckoning"
# The fields of `SensorFaults` by the words of the command line.
_FAULTS = {
    "bias": "bias_deg_s",
    "slip": "factor",
    "smooth": "smooth",
    "clock": "clock_s",
    "mounting": "mounting_deg",
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    args = _parser().parse_args(arguments)
    names = {"tuning": TUNING, "reporting": REPORTING, "all": TUNING + REPORTING}
    drives = [name for word in args.drives for name in names.get(word, (word,))]
    options = {"slam": dict(args.slam), "fault": dict(args.fault)}
    options |= {"blackout": args.blackout, "tracks": args.tracks, "share": args.share}
    asked = list(product(drives, args.sensors, range(args.seeds)))
    with ProcessPoolExecutor(PROCESSES) as pool:
        found = list(pool.map(run, asked, [options] * len(asked)))
    print(table(found, drives))
    if args.out:
        write_runs(args.out, found)


def write_runs(path: Path, found: Sequence[Row]) -> None:
    """Write all runs as JSON, without their trajectories."""
    rows = [{key: value for key, value in row.items() if key != "trajectory"} for row in found]
    path.write_text(json.dumps(rows))


def table(found: Sequence[Row], drives: Sequence[str]) -> str:
    """A line for each drive, means over seeds, and for more than one drive their medians and worst."""
    labels = list(dict.fromkeys(row["sensors"] for row in found))
    lines = [_line(name, [row for row in found if row["drive"] == name], labels) for name in drives]
    over = [f"{label} over none" for label in labels if label != "none"]
    if len(lines) > 1:
        known = {name: [line[name] for line in lines if line.get(name) is not None] for name in over}
        worst = {name: max(values, default=None) for name, values in known.items()}
        lines.append({"drive": "median", **{name: median(values) for name, values in known.items()}})
        lines.append({"drive": "worst", **worst})
    columns = ["drive", "frames", *labels, DEAD, *over]
    last = ("posed", "end/start", "interval", "over none interval")
    columns += [f"{label} {what}" for what in last for label in (*labels, DEAD)]
    return text_table([name for name in columns if any(line.get(name) is not None for line in lines)], lines)


def _line(name: str, found: Sequence[Row], labels: Sequence[str]) -> Row:
    line: Row = {"drive": name, **{key: found[0][key] for key in ("frames", DEAD, f"{DEAD} end/start")}}
    alone = {row["seed"]: row for row in found if row["sensors"] == "none"}
    for label in labels:
        rows = [row for row in found if row["sensors"] == label]
        line |= _summed_up(label, [row["error_m"] for row in rows if row["error_m"] is not None])
        line[f"{label} posed"] = min(row["posed"] for row in rows)
        line[f"{label} end/start"] = median([row["bend"] for row in rows if row["bend"] is not None])
        posed = [row for row in rows if row["posed"] and alone.get(row["seed"], {}).get("posed")]
        ratios = [over_none(row, alone[row["seed"]]) for row in posed]
        if label != "none":
            line |= _summed_up(f"{label} over none", ratios)
    return line


def _summed_up(name: str, values: Sequence[float]) -> Row:
    """Mean and interval over seeds, where there is anything."""
    if not values:
        return {}
    return {name: float(np.mean(values)), f"{name} interval": interval_of_mean(values)}


def over_none(row: Row, none: Row) -> float:
    """Error with sensors over that without, of the frames to which both gave a pose: none gives fewer."""
    truth, common = read(row["drive"]).truth, np.intersect1d(row["trajectory"].t_s, none["trajectory"].t_s)
    errors = [_error_m(run["trajectory"], common, truth, metric=run["metric"]) for run in (row, none)]
    return errors[0] / errors[1]


def _error_m(found: Trajectory, times_s: np.ndarray, truth: Trajectory, *, metric: bool) -> float:
    kept = np.isin(found.t_s, times_s)
    some = Trajectory(found.t_s[kept], found.poses[kept])
    return evaluate(some, truth, with_scale=not metric).mean_3d_error_m


def run(asked: tuple[str, str, int], options: Row) -> Row:
    """Run one drive with some sensors and a seed; `options` are those of the command line."""
    name, label, seed = asked
    drive = with_blackout(_drawn(read(name), seed, options.get("tracks", 1.0)), options["blackout"])
    if fault := options.get("file"):
        drive = with_file_fault(drive, fault, ALL[label])
    slam = dict(options["slam"])
    setting = {"sensors": ALL[label], "weights": slam.pop("weights", "loo"), "slam": slam}
    setting |= {"stereo": label in STEREO, "share": options.get("share")}
    result = run_setting(drive, setting, faults_of(drive, options["fault"]))
    row: Row = {"drive": name, "sensors": label, "seed": seed, "frames": len(drive.t_s)}
    row |= {"posed": len(result.poses), "error_m": None, "bend": None}
    # Those of sensors: that images hold the scale poorly, or see nothing, is no fault of one.
    of_scale = warn_of_scale(result)
    others = (told for told in result.warnings if told not in of_scale)
    row["warnings"] = [told for told in others if not told.startswith(UNSEEN)]
    row["final"] = None if result.final is None else result.final.kept
    if result.poses:
        found = evaluate(result.trajectory(), drive.truth, with_scale=not result.metric)
        row |= {"error_m": found.mean_3d_error_m, "bend": bend(found)}
        row |= {"trajectory": result.trajectory(), "metric": result.metric}
    dead = evaluate(dead_reckoning(read(name)), drive.truth, with_scale=False)
    row |= {DEAD: dead.mean_3d_error_m, f"{DEAD} end/start": bend(dead)}
    return row


def _drawn(drive: KittiDrive, seed: int, share: float) -> KittiDrive:
    """The drive with the seed's choice of its tracks; with all of them, its pixels moved by the seed."""
    return moved(drive, seed) if share == 1.0 else with_some_tracks(drive, share, seed)


def faults_of(drive: KittiDrive, wrong: dict[str, float]) -> SensorFaults | None:
    """The faults of the command line, over the second fifth of the run or throughout."""
    if not wrong:
        return None
    seconds = float(drive.t_s[-1] - drive.t_s[0])
    fields = {_FAULTS[name]: value for name, value in wrong.items() if name != "throughout"}
    start_s, lasting_s = (0.0, np.inf) if wrong.get("throughout") else (seconds / 5, seconds / 5)
    return SensorFaults(start_s, lasting_s, **fields)


def bend(found: Evaluation) -> float | None:
    """Scale over the last fifth of the way, over that over the first; None where nothing moves."""
    steps, true = (
        np.linalg.norm(np.diff(t.poses[:, :, 3], axis=0), axis=1) for t in (found.estimate, found.truth)
    )
    way = np.cumsum(true) / max(true.sum(), 1e-9)
    ratios = [steps[part].sum() / max(true[part].sum(), 1e-9) for part in (way < 0.2, way > 0.8)]
    return float(ratios[1] / ratios[0]) if ratios[0] > 0 else None


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--drives", type=drive_name, nargs="+", default=["tuning"])
    parser.add_argument("--sensors", nargs="+", default=list(SENSORS), choices=list(ALL))
    parser.add_argument("--seeds", type=int, default=1, help="runs of each, all but one with moved pixels")
    parser.add_argument("--tracks", type=float, default=1.0, metavar="SHARE", help="drawn by each seed")
    parser.add_argument("--slam", nargs="*", default=[], type=assignment, metavar="NAME=VALUE")
    faults = "|".join(_FAULTS) + "=VALUE"
    parser.add_argument("--fault", nargs="*", default=[], type=assignment, metavar=faults)
    parser.add_argument("--blackout", type=float, default=0.0, metavar="SECONDS")
    parser.add_argument("--share", type=float, help="declared by an odometer; default: that of its class")
    parser.add_argument("--out", type=Path, help="JSON file of all runs")
    return parser


def assignment(text: str) -> tuple[str, Any]:
    """Read ``NAME=VALUE``, the value as JSON or as text."""
    name, _, value = text.partition("=")
    try:
        return name, json.loads(value)
    except json.JSONDecodeError:
        return name, value


if __name__ == "__main__":
    main()
