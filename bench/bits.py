"""Do solves and drives end at the same bits as before? Record with one version, compare with another.

    python bench/bits.py record before.json [--drives]
    python bench/bits.py compare before.json after.json

A record holds, of each case, the costs as hexadecimal numbers, a hash of the result, the number of steps
and the linear solver. Real problems are read from `$SFMCPP_DATA`, or `shared/data` beside the repository.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import sfmcpp
from sfmcpp import ConstraintGroup, Problem

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SFMCPP_DATA", REPOSITORY.parent / "shared" / "data"))
METHODS = ("lm-nielsen", "lm", "dog-leg", "gradient-descent", "conjugate-gradient", "alternation")
SOLVERS = ("dense", "sparse", "iterative")
SEARCHES = ("g-als", "t-als", "exact", "soft", "backtracking")

Case = tuple[str, Problem, dict[str, Any]]


def bal_cases() -> Iterator[Case]:
    """Every method, linear solver and line search on BAL problems."""
    for path in sorted((DATA / "bal").glob("*.txt*")):
        problem, name = sfmcpp.read(path), path.name.split(".")[0]
        for method in METHODS:
            yield f"{name} {method}", problem, {"method": method, "max_iterations": 15}
        for solver in SOLVERS:
            yield f"{name} {solver}", problem, {"linear_solver": solver, "max_iterations": 15}
        for search in SEARCHES:
            yield f"{name} {search}", problem, {"line_search": search, "max_iterations": 8}
        yield f"{name} huber", problem, {"loss": "huber", "loss_scale_px": "auto", "max_iterations": 15}


def sba_cases() -> Iterator[Case]:
    """The demos of sba, at the defaults."""
    for path in sorted((DATA / "sba_demo").glob("*cams*.txt")):
        yield f"sba {path.stem}", sfmcpp.read(path), {}


def with_one_lens(problem: Problem) -> Problem:
    """The same cameras with one row of intrinsics for all: f, k1 and k2 to be found."""
    lens = np.concatenate([problem.intrinsics[:1, :5], np.zeros((1, 7))], axis=1)
    shared = Problem(
        "perspective",
        problem.cameras,
        lens,
        problem.points,
        problem.camera_index,
        problem.point_index,
        problem.pixels,
        intrinsics_index=np.zeros(problem.num_cameras, dtype=np.int32),
    )
    shared.fixed_intrinsics[:] = True
    shared.fixed_intrinsics[:, [0, 5, 6]] = False
    return shared


def circle_cases(seed: int) -> Iterator[Case]:
    """Gauges, constraints, shared intrinsics and projective cameras on the circular scene."""
    truth = sfmcpp.circle_scene(30, 500, pixel_sigma_px=1.0, seed=seed)
    start = sfmcpp.perturb(truth, point_sigma_m=0.5, position_sigma_m=1.0, rotation_sigma_deg=15, seed=seed)
    for gauge in ("auto", "fixed"):
        yield f"circle {seed} gauge {gauge}", start, {"gauge": gauge}
    gauss_newton = {"method": "gauss-newton", "line_search": "exact", "max_iterations": 10}
    yield f"circle {seed} gauss-newton", start, gauss_newton
    gps = ConstraintGroup("position", np.arange(30), truth.centres + 0.05, weight=3.0)
    shared, projective = with_one_lens(start), sfmcpp.as_projective(start)
    for solver in SOLVERS:
        yield f"circle {seed} gps {solver}", start, {"constraints": [gps], "linear_solver": solver}
        yield f"circle {seed} shared {solver}", shared, {"linear_solver": solver, "max_iterations": 15}
    for search in ("none", "t-als"):
        yield f"circle {seed} projective {search}", projective, {"line_search": search, "max_iterations": 20}


def city_cases() -> Iterator[Case]:
    """A scene large enough for the sparse solver."""
    truth = sfmcpp.city_blocks_scene(num_cameras=200, seed=0)
    start = sfmcpp.perturb(truth, point_sigma_m=0.3, position_sigma_m=0.3, rotation_sigma_deg=1, seed=0)
    for solver in ("auto", "sparse", "iterative"):
        yield f"city {solver}", start, {"linear_solver": solver, "max_iterations": 6}


def solved(problem: Problem, options: dict[str, Any]) -> dict[str, Any]:
    """Solve a copy; what it ends at."""
    result = problem.copy()
    summary = sfmcpp.solve(result, **options)
    state = b"".join(a.tobytes() for a in (result.cameras, result.intrinsics, result.points))
    return {
        "initial_cost": summary.initial_cost.hex(),
        "final_cost": summary.final_cost.hex(),
        "state": hashlib.sha256(state).hexdigest()[:12],
        "iterations": len(summary.iterations) - 1,
        "linear_solver": summary.linear_solver,
    }


def driven(path: Path, sensors: list[str]) -> dict[str, Any]:
    """Hash of the trajectory that the command line writes."""
    with tempfile.TemporaryDirectory() as folder:
        asked = [part for sensor in sensors for part in ("--sensor", sensor)]
        command = [sys.executable, "-m", "sfmcpp", "slam", str(path), *asked, "-o", folder, "--quiet"]
        subprocess.run(command, check=True)
        return {"state": hashlib.sha256(Path(folder, "trajectory.txt").read_bytes()).hexdigest()[:12]}


def record(target: Path, *, drives: bool) -> None:
    """Run all cases and write what they end at."""
    cases = [*bal_cases(), *sba_cases(), *circle_cases(0), *circle_cases(1), *city_cases()]
    found = {name: solved(problem, options) for name, problem, options in cases}
    if drives:
        for path in sorted((DATA / "kitti_tracks").glob("*_KLT.mat")):
            for sensors in ([], ["odometer"], ["odometer", "imu"]):
                found[f"{path.stem} {'+'.join(sensors) or 'alone'}"] = driven(path, sensors)
    target.write_text(json.dumps(found, indent=1))


def compare(before: Path, after: Path) -> None:
    """Print how many cases are the same, and how the others differ."""
    old, new = (json.loads(path.read_text()) for path in (before, after))
    same = [name for name in old if old[name] == new.get(name)]
    print(f"{len(same)} of {len(old)} cases end at the same bits")
    for name in old:
        if name not in same:
            print(f"{name}: {difference(old[name], new.get(name))}")


def difference(old: dict[str, Any], new: dict[str, Any] | None) -> str:
    """How two records of a case differ, in words."""
    if new is None:
        return "not recorded"
    if "final_cost" not in old:
        return "another trajectory"
    before, after = (float.fromhex(case["final_cost"]) for case in (old, new))
    return f"cost differs by {abs(after / before - 1):.1e}, steps {old['iterations']} → {new['iterations']}"


def main() -> None:
    """Record or compare, as the command line asks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("target", type=Path)
    recording.add_argument("--drives", action="store_true", help="SLAM on the KITTI drives, too")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "record":
        record(given.target, drives=given.drives)
    else:
        compare(given.before, given.after)


if __name__ == "__main__":
    main()
