#!/usr/bin/env python3
"""Usage: kill_and_resume.py [--kills N] [--seed S]: solves killed by SIGKILL at random moments, resumed.

Each round solves a problem of some seconds with a checkpoint after every iteration, by a method drawn at
random. It is killed and resumed at random moments until as many rounds were killed as asked for; after each
kill the folder must hold a whole checkpoint that is no older than before, and the end must have the bytes of
one solve that was left alone. What is wrong is printed, and the program ends with 1.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sfmcpp
from sfmcpp.errors import DatasetError
from sfmcpp.sources.synthetic import circle_scene, perturb

WAYS: tuple[tuple[str, ...], ...] = (
    (),
    ("--method", "lm", "--line-search", "t-als", "--line-search-on-rejection"),
    ("--method", "dog-leg", "--loss", "huber"),
    ("--method", "conjugate-gradient"),
    ("--linear-solver", "iterative", "--precision", "single"),
    ("--camera-model", "projective", "--loss", "cauchy"),
)
LIMITS = ("--function-tolerance", "0", "--gradient-tolerance", "0", "--parameter-tolerance", "0")


@dataclass
class Round:
    """One solve: its options, its folder, and what an uninterrupted one has written."""

    source: Path
    options: tuple[str, ...]
    folder: Path
    expected: bytes
    seconds: float
    kills: int = 0
    newest: int = 0

    def command(self) -> list[str]:
        """The next process: it resumes as soon as there is a checkpoint."""
        checkpoints = self.folder / "checkpoints"
        words = ["--checkpoint", str(checkpoints), "--checkpoint-every", "0"]
        if sequence_in(checkpoints):
            words += ["--resume", str(checkpoints)]
        return solve_command(self.source, self.folder / "out.npz", self.options) + words

    def complaint_after_kill(self) -> str:
        """What is wrong with the folder of a process that was killed; empty if nothing is."""
        try:
            now = sequence_in(self.folder / "checkpoints")
        except DatasetError as error:
            return str(error)
        before, self.newest = self.newest, max(now, self.newest)
        return "" if now >= before else f"checkpoint {now} after {before}"


def solve_command(source: Path, output: Path, options: tuple[str, ...]) -> list[str]:
    """The command line of a solve."""
    return [sys.executable, "-m", "sfmcpp", "solve", str(source), "-o", str(output), "--quiet", *options]


def sequence_in(folder: Path) -> int:
    """Iterations in the newest checkpoint of a folder, and one; 0 if there is none. No file may be torn."""
    if not any(folder.glob("checkpoint-*")):
        return 0
    checkpoint = sfmcpp.CheckpointFolder(folder).load()
    if checkpoint.remark:
        raise DatasetError(folder, checkpoint.remark)
    return 1 + checkpoint.sequence


def start_round(folder: Path, source: Path, options: tuple[str, ...]) -> Round:
    """Solve once without a break."""
    folder.mkdir()
    begin = time.monotonic()
    subprocess.run(solve_command(source, folder / "whole.npz", options), check=True)
    return Round(source, options, folder, (folder / "whole.npz").read_bytes(), time.monotonic() - begin)


def run_until_killed(current: Round, wait_s: float) -> bool:
    """Run the next process of a round; whether it was killed before its end."""
    with subprocess.Popen(current.command()) as process:
        try:
            process.wait(wait_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.returncode not in (0, -9):
            raise SystemExit(f"exit code {process.returncode}: {' '.join(current.command())}")
        return process.returncode != 0


def play(current: Round, kills: int, rng: np.random.Generator) -> list[str]:
    """Kill and resume a round up to `kills` times, then let it end; what is wrong."""
    complaints = []
    while current.kills < kills and run_until_killed(current, rng.uniform(0, 1.2 * current.seconds)):
        current.kills += 1
        complaints.append(current.complaint_after_kill())
    if not (current.folder / "out.npz").exists():
        run_until_killed(current, 600)
    if (current.folder / "out.npz").read_bytes() != current.expected:
        complaints.append("the result has other bytes")
    return [f"{' '.join(current.options) or 'default'}: {text}" for text in complaints if text]


def main() -> int:
    """Play rounds until all kills are used up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cameras", type=int, default=20)
    parser.add_argument("--points", type=int, default=1500)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    complaints: list[str] = []
    done = rounds = 0
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "start.npz"
        scene = circle_scene(arguments.cameras, arguments.points, seed=arguments.seed)
        start = perturb(
            scene, point_sigma_m=0.5, position_sigma_m=0.5, rotation_sigma_deg=8, seed=arguments.seed
        )
        sfmcpp.write(start, source)
        while done < arguments.kills:
            options = (*WAYS[rounds % len(WAYS)], *LIMITS)
            current = start_round(Path(folder) / str(rounds), source, options)
            complaints += play(current, arguments.kills - done, rng)
            done, rounds = done + current.kills, rounds + 1
    print(f"{done} kills in {rounds} solves, {len(complaints)} complaints", *complaints, sep="\n")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
