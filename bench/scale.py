"""Time and memory of bundle adjustment against its size, for `auto` and every linear solver by name.

    python bench/scale.py [--quick] [--cases city1000,sphere600] [--solvers auto,sparse] [--out DIR]
                          [--scenes DIR] [--seconds 150] [--gigabytes 20] [--steps-of-bits 2]

Prints a table and writes DIR/scale.md beside DIR/scale.json. Each run is a process of its own. Seconds are
those to 1e-3 of the lowest cost that any run of the case ever had; memory is the peak of the process less
what it had after reading. Results are kept by commit and case: a run that is there is not repeated, so the
program can be stopped and called again (--again repeats). Scenes are made once, by `sfmcpp synth`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scaling.cases import CASES, QUICK, Case
from scaling.results import Record, Results, commit
from scaling.table import markdown

BENCH = Path(__file__).resolve().parent
# Dense matrices of more cameras would only tell that there is no memory for them.
MOST_CAMERAS_DENSE = 3000
# A step in progress is waited for: a process may take so much longer than the limit of the solve.
PATIENCE, PATIENCE_S = 3.0, 120.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure what is not known yet; print and write the tables."""
    options = parse(arguments)
    results, version = Results(options.out / "scale.json"), commit()
    for name in options.cases:
        path = CASES[name].path(options.scenes)
        for solver in solvers_for(CASES[name], options.solvers):
            measure(results, version, name, solver, path, options)
        if options.steps_of_bits > 0:
            compare_bits(results, version, name, path, options)
    table = f"{version}, {options.threads} threads\n\n{markdown(results, version, options.cases)}\n"
    (options.out / "scale.md").write_text(table)
    print(table)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    import sfmcpp.ba

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help=f"only {', '.join(QUICK)}")
    parser.add_argument("--cases", type=_names, default=list(CASES))
    parser.add_argument("--solvers", type=_names, default=_auto_first(sfmcpp.ba.LINEAR_SOLVERS))
    parser.add_argument("--out", type=Path, default=Path("scale-results"))
    parser.add_argument("--scenes", type=Path, help="default: scenes in --out")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--iterations", type=int, default=25, help="steps at most")
    parser.add_argument("--seconds", type=float, default=150.0, help="limit of a solve")
    parser.add_argument("--gigabytes", type=float, default=20.0, help="limit of a process; 0: none")
    parser.add_argument("--steps-of-bits", type=int, default=2, help="compared for 1 and 2 threads; 0: none")
    parser.add_argument("--again", action="store_true", help="repeat what is known")
    options = parser.parse_args(arguments)
    options.cases = list(QUICK) if options.quick else options.cases
    options.scenes = options.scenes or options.out / "scenes"
    if unknown := [name for name in options.cases if name not in CASES]:
        parser.error(f"--cases: no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    return options


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _auto_first(solvers: Sequence[str]) -> list[str]:
    return sorted(solvers, key=lambda name: name != "auto")


def solvers_for(case: Case, asked: Sequence[str]) -> list[str]:
    """Those that have a chance on so many cameras."""
    return [name for name in asked if name != "dense" or case.cameras <= MOST_CAMERAS_DENSE]


def measure(
    results: Results, version: str, case: str, solver: str, path: Path, options: argparse.Namespace
) -> Record:
    """One run of a solver, if it is not known."""
    key = (version, case, "solve", solver)
    known = results.find(*key)
    if known is not None and not options.again:
        return known
    print(f"{case}: {solver}", end=" ", flush=True)
    record = run(path, options, {**limits(options), "linear_solver": solver})
    print(record.get("failure") or f"{record['seconds']:.2f} s, {record['termination']}", flush=True)
    return results.keep(record, *key)


def limits(options: argparse.Namespace) -> dict[str, Any]:
    """How long a measured solve goes on."""
    return {
        "threads": options.threads,
        "max_iterations": options.iterations,
        "max_seconds": options.seconds,
        "function_tolerance": 1e-6,
    }


def compare_bits(results: Results, version: str, case: str, path: Path, options: argparse.Namespace) -> None:
    """Whether a few steps with one thread and with two end at the same state.

    They are those of the solver that auto took: which that is may depend on the threads there are.
    """
    automatic = results.find(version, case, "solve", "auto")
    if automatic is None or "failure" in automatic:
        return
    solver, steps = automatic["solver"], options.steps_of_bits
    key = (version, case, "bits", solver)
    known = results.find(*key)
    if known is not None and not options.again:
        return
    print(f"{case}: bits of {solver}", end=" ", flush=True)
    wanted = {"linear_solver": solver, "max_iterations": steps}
    ends = [run(path, options, {**wanted, "threads": threads}) for threads in (1, 2)]
    failures = [end["failure"] for end in ends if "failure" in end]
    if failures:
        record: Record = {"failure": failures[0]}
    else:
        same = len({(end["state"], end["final_cost"]) for end in ends}) == 1
        record = {"same": same, "steps": steps, "seconds": [end["seconds"] for end in ends]}
    print(record, flush=True)
    results.keep(record, *key)


def run(path: Path, options: argparse.Namespace, solve: dict[str, Any]) -> Record:
    """Solve in a process of its own; what it says, or why it says nothing."""
    request = {"path": str(path), "options": solve, "memory_bytes": int(options.gigabytes * 2**30)}
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(BENCH), os.environ.get("PYTHONPATH", "")]),
    }
    with tempfile.TemporaryDirectory() as folder:
        wish = Path(folder, "request.json")
        wish.write_text(json.dumps(request))
        command = [sys.executable, "-m", "scaling.one_run", str(wish)]
        try:
            done = subprocess.run(
                command,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=PATIENCE * options.seconds + PATIENCE_S,
            )
        except subprocess.TimeoutExpired as error:
            return {"failure": f"no end after {error.timeout:.0f} s"}
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"ended by signal {-done.returncode}"]
        return {"failure": lines[-1][:200]}
    record: Record = json.loads(done.stdout.splitlines()[-1])
    return record


if __name__ == "__main__":
    main()
