#!/usr/bin/env python3
"""Usage: stop_at_random.py [COUNT [SEED]] [--in-solve]: solves told to stop, or killed, at random moments.

SIGTERM, SIGINT and SIGKILL in turn, at any time from the start of the process to a little after its end;
with --in-solve from the first iteration on, which the first checkpoint tells. Whatever the moment, a file is
the old one or a new one, whole; a process that could answer ends with 0 or 130, says in one line what it
kept, and what it says is true. The program prints how the processes ended, and ends with 1 if one did
otherwise.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sfmcpp

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGKILL)
KEPT, NOTHING_KEPT = "the best state so far is in", "sfmcpp: interrupted"
# Before the program takes the signals over, as the interpreter starts, and after it has given them back.
UNANSWERED = {-signal.SIGTERM, -signal.SIGINT}


@dataclass(frozen=True)
class Solve:
    """A solve that overwrites the results of an earlier one."""

    folder: Path
    is_awaited: bool  # whether stops wait for the first iteration

    @property
    def output(self) -> Path:
        """The problem solved."""
        return self.folder / "out.npz"

    @property
    def report(self) -> Path:
        """What is told of it."""
        return self.folder / "report.json"

    @property
    def checkpoints(self) -> Path:
        """Where every iteration is saved, if stops wait for the first."""
        return self.folder / "checkpoints"

    def start(self) -> subprocess.Popen[str]:
        """Start it as a process."""
        targets = ["-o", str(self.output), "--report", str(self.report)]
        options = ["--max-iterations", "60", "--function-tolerance", "0"]
        if self.is_awaited:
            options += ["--method", "gradient-descent", "--checkpoint-every", "0"]
            options += ["--checkpoint", str(self.checkpoints)]
        command = [sys.executable, "-m", "sfmcpp", "solve", str(self.folder / "in.npz"), *targets, *options]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def prepare(self) -> None:
        """Leave what an earlier solve would have left."""
        sfmcpp.write(sfmcpp.read(self.folder / "in.npz"), self.output)
        self.report.write_text('{"termination": "earlier"}\n')
        shutil.rmtree(self.checkpoints, ignore_errors=True)

    def await_iterations(self, process: subprocess.Popen[str]) -> None:
        """Return when the first iteration is over, if stops wait for it, or the process."""
        while self.is_awaited and process.poll() is None and not any(self.checkpoints.glob("checkpoint-*")):
            time.sleep(0.001)


def faults_of(solve: Solve, code: int, told: str, by: signal.Signals) -> list[str]:
    """What is wrong with how a solve ended."""
    faults = []
    termination = json.loads(solve.report.read_text())["termination"]
    sfmcpp.read(solve.output)
    if by == signal.SIGKILL:
        return faults
    answered = {"interrupted", "earlier"} if solve.is_awaited else {"interrupted"}
    unanswered = code in UNANSWERED and termination not in answered
    if code not in (0, 130) and not unanswered:
        faults.append(f"code {code}")
    if code == 130 and told.strip() != NOTHING_KEPT and KEPT not in told:
        faults.append(f"130 says {told!r}")
    if KEPT in told and termination != "interrupted":
        faults.append(f"{KEPT} ..., but the report says {termination}")
    if "Traceback" in told and not unanswered:
        faults.append("a traceback")
    if list(solve.folder.glob(".sfmcpp-*")) and not unanswered:
        faults.append("temporary files are left")
    return faults


def stopped_at(solve: Solve, after: float, by: signal.Signals) -> tuple[int, str]:
    """Exit code and stderr of a solve that gets a signal after some seconds."""
    solve.prepare()
    with solve.start() as process:
        solve.await_iterations(process)
        time.sleep(after)
        process.send_signal(by)
        told = process.communicate()[1]
    return process.returncode, told


def how_it_ended(code: int, told: str) -> str:
    """One of the few ways to end."""
    if code == 130:
        return "130, best state kept" if KEPT in told else "130, nothing begun"
    return str(code)


def main(count: int, seed: int, in_solve: bool) -> int:
    """Print how they ended; 1 if one ended otherwise than it should."""
    rng, ends, num_faults = np.random.default_rng(seed), Counter[tuple[str, str]](), 0
    with tempfile.TemporaryDirectory() as folder:
        solve = Solve(Path(folder), in_solve)
        scene = sfmcpp.circle_scene(40, 1500, camera_model="bal", seed=seed)
        sfmcpp.write(
            sfmcpp.perturb(scene, point_sigma_m=0.3, rotation_sigma_deg=3, seed=seed), solve.folder / "in.npz"
        )
        longest = seconds_of(solve)
        for number in range(count):
            by, after = SIGNALS[number % len(SIGNALS)], float(rng.uniform(0.0, 1.05 * longest))
            code, told = stopped_at(solve, after, by)
            ends[by.name, how_it_ended(code, told)] += 1
            faults = faults_of(solve, code, told, by)
            num_faults += bool(faults)
            if faults:
                print(f"number {number}, {by.name} after {after:.3f} s: {'; '.join(faults)}\n{told}")
    for (name, end), times in sorted(ends.items()):
        print(f"{name:<10}{end:<24}{times}")
    return int(num_faults > 0)


def seconds_of(solve: Solve) -> float:
    """How long a solve takes that nobody stops, from where stops may begin."""
    solve.prepare()
    with solve.start() as process:
        solve.await_iterations(process)
        started = time.perf_counter()
        process.communicate()
    return time.perf_counter() - started


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=200)
    parser.add_argument("seed", nargs="?", type=int, default=0)
    parser.add_argument("--in-solve", action="store_true")
    given = parser.parse_args()
    sys.exit(main(given.count, given.seed, given.in_solve))
