"""Compare the linear solver that `auto` takes with every other, and fit the rates that it is chosen by.

    python bench/choice.py table [--shapes corridor200,sphere600 …] [--files FILE …] [--out DIR]
    python bench/choice.py rates [--out DIR]

`table` solves every shape with each linear solver by name and with `auto`, in a process of its own on two
threads, the fastest of five runs where these are short, and prints seconds to 1e-3 of the lowest cost of any
of them, those before the first step included, and how far `auto` is behind the best. `rates` fits seconds per
unit of each kind of work to the steps that `table` has measured of shapes with odd seeds, and prints them as
the table in cpp/src/linear/solver_costs.cpp; the rows of even seeds are what it has not seen.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from peers.harness.process_memory import peak_bytes, reset_peak, resident_bytes
from scaling.other_shapes import problem_of

import sfmcpp
from sfmcpp.ba import LINEAR_SOLVERS
from sfmcpp.model import Problem
from sfmcpp.sources.synthetic import SCENES, hide_observations, perturb

Record = dict[str, Any]
WITHIN = 1e-3
ALLOWED = 1.3
LIMITS: dict[str, Any] = {"threads": 2, "max_iterations": 25, "max_seconds": 8.0}
POOR = {"point_sigma_m": 0.3, "position_sigma_m": 0.3, "rotation_sigma_deg": 1.0}
PATIENCE_S = 200.0
REPEATS, WORTH_REPEATING_S = 4, 3.0


def scene(
    name: str, cameras: int, points: int, seed: int, hidden: float = 0.0, **more: Any
) -> Callable[[], Problem]:
    """A scene with a poor start."""

    def make() -> Problem:
        truth = SCENES[name](num_cameras=cameras, num_points=points, seed=seed, camera_model="bal", **more)
        if hidden:
            truth = hide_observations(truth, hidden, seed=seed)
        return perturb(truth, seed=seed, **POOR)

    return make


# Shapes that nothing was chosen on, for reporting alone.
OTHERS = (
    ("survey", 300, "own"),
    ("survey", 300, "one"),
    ("survey", 1500, "own"),
    ("survey", 1500, "one"),
    ("scan", 150, "one"),
    ("scan", 300, "own"),
    ("scan", 600, "one"),
    ("room", 300, "one"),
    ("room", 1000, "one"),
    ("square", 200, "own"),
    ("square", 1000, "own"),
    ("square", 2500, "own"),
)

# Name and seed: rates are fitted to odd seeds.
SHAPES: dict[str, tuple[int, Callable[[], Problem]]] = {
    f"{name}{cameras}-{seed}": (seed, scene(name, cameras, points, seed))
    for name, cameras, points in (
        ("corridor", 100, 6000),
        ("corridor", 300, 18000),
        ("corridor", 600, 40000),
        ("sphere", 50, 2000),
        ("sphere", 200, 4000),
        ("sphere", 400, 3000),
        ("street-loop", 200, 12000),
        ("street-loop", 600, 36000),
        ("city-blocks", 200, 12000),
        ("city-blocks", 500, 30000),
    )
    for seed in (1, 2)
} | {
    f"{name}{images}-{lenses}": (2, partial(problem_of, name, images, lenses))
    for name, images, lenses in OTHERS
}


def main() -> None:
    """Measure, fit, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("table", "rates", "run"))
    parser.add_argument("--shapes", nargs="*", default=list(SHAPES))
    parser.add_argument("--files", nargs="*", default=[])
    parser.add_argument("--solvers", nargs="*", default=list(LINEAR_SOLVERS))
    parser.add_argument("--out", type=Path, default=Path("choice-results"))
    parser.add_argument("--again", nargs="*", default=[], help="solvers to run although they are known")
    arguments = parser.parse_args()
    if arguments.what == "run":
        print(json.dumps(run(arguments.shapes[0], arguments.solvers[0])))
        return
    results = Results(arguments.out / "choice.json")
    if arguments.what == "rates":
        print_rates(results)
        return
    for shape in [*arguments.shapes, *arguments.files]:
        for solver in arguments.solvers:
            if solver in arguments.again or results.find(shape, solver) is None:
                results.keep(shape, solver, in_a_process(shape, solver))
        print(results.row(shape), flush=True)


def run(shape: str, solver: str) -> Record:
    """Solve a shape, or a file, with one solver: the fastest of a few runs.

    The first solve of a process waits for memory that nothing has touched, at times longer than it computes.
    """
    problem = SHAPES[shape][1]() if shape in SHAPES else sfmcpp.read(shape)
    resident = resident_bytes()
    reset_peak()
    summary = sfmcpp.solve(problem.copy(), linear_solver=solver, **LIMITS)
    for _ in range(REPEATS if summary.seconds_total < WORTH_REPEATING_S else 0):
        again = sfmcpp.solve(problem.copy(), linear_solver=solver, **LIMITS)
        summary = min(summary, again, key=lambda s: s.seconds_total)
    return {
        "solver": summary.linear_solver,
        "reason": summary.linear_solver_reason,
        "changes": [vars(change) for change in summary.linear_solver_changes],
        "forecast": [vars(forecast) for forecast in summary.linear_solver_forecast],
        "seconds_setup": summary.seconds_setup,
        "trace": [[s.seconds, s.cost, s.linear_solver_iterations] for s in summary.iterations],
        "peak_bytes": peak_bytes() - resident,
        "size": [problem.num_cameras, problem.num_points, problem.num_observations],
    }


def in_a_process(shape: str, solver: str) -> Record:
    """The record of a run, or why there is none."""
    command = [sys.executable, __file__, "run", "--shapes", shape, "--solvers", solver]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        return {"failure": f"no end after {PATIENCE_S:.0f} s"}
    if done.returncode:
        return {"failure": (done.stderr.strip().splitlines() or ["killed"])[-1]}
    record: Record = json.loads(done.stdout.splitlines()[-1])
    return record


class Results:
    """Records by shape and solver, in a JSON file written after each run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.records: dict[str, dict[str, Record]] = json.loads(path.read_text()) if path.exists() else {}

    def find(self, shape: str, solver: str) -> Record | None:
        """What was measured."""
        return self.records.get(shape, {}).get(solver)

    def keep(self, shape: str, solver: str, record: Record) -> None:
        """Write it down."""
        self.records.setdefault(shape, {})[solver] = record
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._path.write_text(json.dumps(self.records))

    def row(self, shape: str) -> str:
        """Seconds to 1e-3 with each solver, and the ratio of auto to the best by name."""
        runs = {solver: record for solver, record in self.records[shape].items() if "trace" in record}
        lowest = min((cost for record in runs.values() for _, cost, _ in record["trace"]), default=math.inf)
        seconds = {solver: seconds_to(record, lowest) for solver, record in runs.items()}
        named = [value for solver, value in seconds.items() if solver != "auto"]
        auto = seconds.get("auto", math.inf)
        behind = auto / min(named) if named and math.isfinite(min(named)) else math.nan
        cells = " | ".join(f"{seconds.get(solver, math.inf):8.3f}" for solver in LINEAR_SOLVERS)
        record = runs.get("auto", {})
        took = "+".join([record.get("solver", "?"), *(c["solver"] for c in record.get("changes", []))])
        mark = "  <<<" if behind > ALLOWED else ""
        return f"{Path(shape).stem:18} | {cells} | {took:16} | {behind:5.2f}{mark}"


def seconds_to(record: Record, lowest: float) -> float:
    """When a run first came within 1e-3 of the lowest cost."""
    reached = [s for s, cost, _ in record["trace"] if cost <= lowest * (1 + WITHIN)]
    return float(reached[0]) if reached else math.inf


def print_rates(results: Results) -> None:
    """Least squares of relative errors, none of the rates negative."""
    from scipy.optimize import nnls

    kinds: list[str] = []
    rows: list[tuple[str, str, dict[str, float], float]] = []
    for shape, runs in results.records.items():
        for solver, record in runs.items():
            if solver == "auto" or len(record.get("trace", ())) < 2:
                continue  # without a step
            work, seconds = work_of_a_step(record)
            rows.append((shape, solver, work, seconds))
            kinds += [kind for kind in work if kind not in kinds]
    fitted = [row for row in rows if SHAPES.get(row[0], (1,))[0] % 2 == 1]
    matrix = np.array([[work.get(kind, 0.0) / seconds for kind in kinds] for _, _, work, seconds in fitted])
    scale = np.maximum(np.abs(matrix).max(axis=0), 1e-300)
    rates = nnls(matrix / scale, np.ones(len(matrix)))[0] / scale
    for kind, rate in zip(kinds, rates, strict=True):
        print(f"{kind:16} {rate:.3g}")
    for shape, solver, work, seconds in rows:
        predicted = sum(work.get(kind, 0.0) * rate for kind, rate in zip(kinds, rates, strict=True))
        seen = "fitted" if any(row[:2] == (shape, solver) for row in fitted) else "not seen"
        print(f"{Path(shape).stem:18} {solver:10} {seconds:9.4f} s {predicted / seconds:6.2f} {seen}")


def work_of_a_step(record: Record) -> tuple[dict[str, float], float]:
    """Work and seconds of the median step after the first; iterations as they were."""
    forecast = min(
        (f for f in record["forecast"] if f["solver"] == record["solver"]),
        key=lambda f: f["seconds"],
    )
    trace = record["trace"]
    trace = trace[1:] if len(trace) > 2 else trace
    steps = [(later[0] - earlier[0], later[2]) for earlier, later in pairwise(trace)]
    seconds, iterations = (float(np.mean([step[k] for step in steps])) for k in (0, 1))
    work = dict(forecast["work_of_step"])
    for kind, amount in forecast["work_of_iteration"].items():
        work[kind] = work.get(kind, 0.0) + iterations * amount
    return work, seconds


if __name__ == "__main__":
    main()
