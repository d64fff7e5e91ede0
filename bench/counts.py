"""What a step of each linear solver costs, counted instead of timed: the same on every machine.

    python bench/counts.py record  PROGRAM [--counts FILE]
    python bench/counts.py compare PROGRAM [--counts FILE] [--solvers dense,sparse,iterative]

PROGRAM is `sfmcpp_counts` of a release build with benchmarks. It runs under valgrind's cachegrind, which
knows AVX2 and not AVX-512: with one thread and SFMCPP_ISA=avx2. Counted are instructions, data references,
misses of a simulated last-level cache of 1 MB, and calls and bytes of operator new; of set-up with the first
steps, and of further ones, by the difference of two runs. `compare` ends with 1 and says what grew if a count
is above that of FILE by more than its tolerance. Where counts cannot be compared (another compiler or C
library, no valgrind, a processor without AVX2) it says why and ends with 0.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

COUNTS = Path(__file__).resolve().parent / "counts.json"
SOLVERS = ("dense", "sparse", "iterative")
# In the third the coarse space of conjugate gradients comes in: what it allocates is of the set-up.
FEW, MANY = 3, 6
FIRST, FURTHER = f"set-up and {FEW} steps", f"{MANY - FEW} further steps"
CACHES = ("--I1=32768,8,64", "--D1=32768,8,64", "--LL=1048576,16,64")
ENVIRONMENT = {
    "SFMCPP_ISA": "avx2",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "OMP_NUM_THREADS": "1",
}
# Allowed growth. Misses depend on where the heap puts blocks; single allocations are no news.
TOLERANCES = {
    "instructions": 0.03,
    "data_references": 0.03,
    "last_level_misses": 0.10,
    "allocations": 0.05,
    "allocated_bytes": 0.05,
}
# Differences below these are nothing, whatever their share.
NEGLIGIBLE = {"allocations": 3, "allocated_bytes": 4096, "last_level_misses": 2000}

Counts = dict[str, float]


class NotComparable(Exception):
    """Why nothing can be counted or compared here."""


@dataclass(frozen=True)
class Growth:
    """A count that is larger than it was."""

    solver: str
    part: str
    what: str
    before: float
    now: float

    def __str__(self) -> str:
        share = f"+{100 * (self.now / self.before - 1):.1f} %" if self.before else "from none"
        allowed = f"{100 * TOLERANCES[self.what]:.0f} % are allowed"
        what = self.what.replace("_", " ")
        return f"{self.solver}, {self.part}: {what} {self.before:,.0f} → {self.now:,.0f} ({share}, {allowed})"


def main(arguments: Sequence[str] | None = None) -> int:
    """Record or compare; the exit code."""
    args = parse(arguments)
    try:
        now = count_all(args.program, args.solvers)
        if args.command == "record":
            args.counts.write_text(json.dumps(now, indent=1) + "\n")
            print(f"{args.counts}: recorded")
            return 0
        before = recorded(args.counts, now)
    except NotComparable as reason:
        print(f"counts: skipped, {reason}")
        return 0
    return verdict(before, now)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=("record", "compare"))
    parser.add_argument("program", type=Path)
    parser.add_argument("--counts", type=Path, default=COUNTS)
    parser.add_argument("--solvers", type=lambda text: text.split(","), default=list(SOLVERS))
    return parser.parse_args(arguments)


def count_all(program: Path, solvers: Sequence[str]) -> dict[str, Any]:
    """Counts of the first steps and of further ones, of each solver; and by which compiler they were made."""
    if shutil.which("valgrind") is None:
        raise NotComparable("valgrind is not installed")
    if platform.machine() != "x86_64" or "avx2" not in processor_flags():
        raise NotComparable("this processor has no AVX2")
    if not program.exists():
        raise NotComparable(f"{program} is not built")
    runs = [(solver, steps) for solver in solvers for steps in (FEW, MANY)]
    # Side by side: what is counted does not depend on what else runs.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        counted = dict(zip(runs, pool.map(lambda run: count(program, *run), runs), strict=True))
    found: dict[str, Any] = {}
    compiler = ""
    for solver in solvers:
        (few, compiler), (many, _) = counted[solver, FEW], counted[solver, MANY]
        found[solver] = {FIRST: few, FURTHER: {what: many[what] - few[what] for what in few}}
    return {"compiler": compiler, "libc": "-".join(platform.libc_ver()), "solvers": found}


def processor_flags() -> str:
    """What Linux says the processor can do."""
    information = Path("/proc/cpuinfo")
    return information.read_text() if information.exists() else ""


def count(program: Path, solver: str, steps: int) -> tuple[Counts, str]:
    """All counts of one run, and the compiler that built the program."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "cachegrind.out")
        tool = [
            "valgrind",
            "--tool=cachegrind",
            "--cache-sim=yes",
            *CACHES,
            f"--cachegrind-out-file={target}",
        ]
        done = subprocess.run(
            [*tool, str(program), solver, str(steps)],
            env={**os.environ, **ENVIRONMENT},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            lines = (done.stderr or done.stdout).strip().splitlines() or ["no message"]
            raise NotComparable(f"{program.name} {solver} {steps} failed: {lines[-1]}")
        simulated = totals(target.read_text())
    said = json.loads(done.stdout)
    counted: Counts = {
        "instructions": simulated["Ir"],
        "data_references": simulated["Dr"] + simulated["Dw"],
        "last_level_misses": simulated["DLmr"] + simulated["DLmw"],
        "allocations": said["allocations"],
        "allocated_bytes": said["allocated_bytes"],
    }
    return counted, said["compiler"]


def totals(text: str) -> Counts:
    """The line `summary` of cachegrind's file, by the names of the line `events`."""
    events = re.search(r"^events: (.*)$", text, re.MULTILINE)
    summary = re.search(r"^summary: (.*)$", text, re.MULTILINE)
    if events is None or summary is None:
        raise NotComparable("cachegrind wrote no summary")
    return dict(zip(events[1].split(), map(float, summary[1].split()), strict=True))


def recorded(path: Path, now: dict[str, Any]) -> dict[str, Any]:
    """What was counted before, if by the same compiler and library."""
    if not path.exists():
        raise NotComparable(f"{path} is not there: record first")
    before: dict[str, Any] = json.loads(path.read_text())
    for key in ("compiler", "libc"):
        if before[key] != now[key]:
            raise NotComparable(f"{key} {now[key]} here, {before[key]} of what was recorded")
    return before


def verdict(before: dict[str, Any], now: dict[str, Any]) -> int:
    """Print what grew; 1 if anything did."""
    grown = growths(before["solvers"], now["solvers"])
    for growth in grown:
        print(f"counts: {growth}", file=sys.stderr)
    if grown:
        print(
            "counts: if that is wanted, `python bench/counts.py record PROGRAM` and say why in the commit",
            file=sys.stderr,
        )
        return 1
    steps = ", ".join(
        f"{solver} {parts[FURTHER]['instructions'] / 1e6:,.1f} M" for solver, parts in now["solvers"].items()
    )
    print(f"counts: nothing grew; instructions of {FURTHER}: {steps}")
    return 0


def growths(before: dict[str, Any], now: dict[str, Any]) -> list[Growth]:
    """Counts above what is tolerated."""
    return [
        Growth(solver, part, what, before[solver][part][what], value)
        for solver, parts in now.items()
        if solver in before
        for part, counts in parts.items()
        for what, value in counts.items()
        if value > before[solver][part][what] * (1 + TOLERANCES[what])
        and value - before[solver][part][what] > NEGLIGIBLE.get(what, 0)
    ]


if __name__ == "__main__":
    sys.exit(main())
