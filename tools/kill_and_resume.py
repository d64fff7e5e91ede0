#!/usr/bin/env python3
"""Usage: kill_and_resume.py [--kills N] [--seed S]: runs killed by SIGKILL at random moments, and resumed.

Each round is a solve, with another method each time, or a run of SLAM, and takes some seconds, with a
checkpoint after every iteration or frame. It is killed at random moments and resumed, until it comes to its
end; rounds follow one another until there were as many kills as asked for. After each kill the folder must
hold no torn file and a checkpoint that is no older than before, and the end must have the bytes of a run that
was left alone. What is wrong is printed, and the program ends with 1.
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
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.sources.synthetic import circle_scene, corridor_scene, perturb

LIMITS = ("--function-tolerance", "0", "--gradient-tolerance", "0", "--parameter-tolerance", "0")


@dataclass(frozen=True)
class Way:
    """What a round runs: the words of the command, its input, and the files of its result."""

    words: tuple[str, ...]
    source: Path
    results: tuple[str, ...]

    def command(self, output: Path, *more: str) -> list[str]:
        """A command line that writes into or to `output`."""
        command, *options = self.words
        start = [sys.executable, "-m", "sfmcpp", command, str(self.source), "-o", str(output), "--quiet"]
        return [*start, *options, *more]

    def result(self, output: Path) -> bytes:
        """All bytes of the result; none if it is not complete."""
        files = [output / name for name in self.results]
        return b"".join(path.read_bytes() for path in files) if all(p.exists() for p in files) else b""


def ways(folder: Path, cameras: int, points: int, seed: int) -> list[Way]:
    """Write the inputs, and tell what is done with them."""
    scene = circle_scene(cameras, points, seed=seed)
    start = perturb(scene, point_sigma_m=0.5, position_sigma_m=0.5, rotation_sigma_deg=8, seed=seed)
    sfmcpp.write(start, folder / "start.npz")
    walk = corridor_scene(40, 2 * points, length_m=20.0, pixel_sigma_px=0.3, seed=seed)
    stamps = 0.1 * np.arange(walk.num_cameras)
    tracks = CameraTracks(stamps, walk.camera_index, walk.point_index, walk.pixels, walk.intrinsics[0])
    write_tracks(tracks, folder / "walk.csv")
    solves = (
        (),
        ("--method", "lm", "--line-search", "t-als", "--line-search-on-rejection"),
        ("--method", "dog-leg", "--loss", "huber"),
        ("--method", "conjugate-gradient"),
        ("--linear-solver", "iterative", "--precision", "single"),
        ("--camera-model", "projective", "--loss", "cauchy"),
    )
    # What a solve writes is a file, of which a path within it is the file itself.
    of_solves = [Way(("solve", *LIMITS, *options), folder / "start.npz", ("",)) for options in solves]
    of_slam = Way(("slam",), folder / "walk.csv", ("trajectory.txt", "keyframes.txt", "model/points3D.bin"))
    return [of_slam, *of_solves]


@dataclass
class Round:
    """One way, its folder, and what an uninterrupted run has given."""

    way: Way
    folder: Path
    expected: bytes
    seconds: float
    kills: int = 0
    newest: int = 0

    @property
    def result(self) -> bytes:
        """What the run has written; nothing before its end."""
        return self.way.result(self.folder / "out.npz")

    def command(self) -> list[str]:
        """The next process: it resumes as soon as there is a checkpoint."""
        checkpoints = self.folder / "checkpoints"
        words = ["--checkpoint", str(checkpoints), "--checkpoint-every", "0"]
        words += ["--resume", str(checkpoints)] if sequence_in(checkpoints) else []
        return self.way.command(self.folder / "out.npz", *words)

    def complaint_after_kill(self) -> str:
        """What is wrong with the folder of a process that was killed; empty if nothing is."""
        try:
            now = sequence_in(self.folder / "checkpoints")
        except DatasetError as error:
            return str(error)
        before, self.newest = self.newest, max(now, self.newest)
        return "" if now >= before else f"checkpoint {now} after {before}"


def sequence_in(folder: Path) -> int:
    """The how manieth checkpoint of its run is in a folder; 0 if there is none. No file may be torn."""
    if not any(folder.glob("checkpoint-*")):
        return 0
    checkpoint = sfmcpp.CheckpointFolder(folder).load()
    if checkpoint.remark:
        raise DatasetError(folder, checkpoint.remark)
    return checkpoint.sequence


def start_round(folder: Path, way: Way) -> Round:
    """Run once without a break."""
    folder.mkdir()
    begin = time.monotonic()
    subprocess.run(way.command(folder / "whole.npz"), check=True)
    return Round(way, folder, way.result(folder / "whole.npz"), time.monotonic() - begin)


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
    if not current.result:
        run_until_killed(current, 600)
    if current.result != current.expected:
        complaints.append("the result has other bytes")
    return [f"{' '.join(current.way.words)}: {text}" for text in complaints if text]


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
        all_ways = ways(Path(folder), arguments.cameras, arguments.points, arguments.seed)
        while done < arguments.kills:
            current = start_round(Path(folder) / str(rounds), all_ways[rounds % len(all_ways)])
            complaints += play(current, arguments.kills - done, rng)
            done, rounds = done + current.kills, rounds + 1
    print(f"{done} kills in {rounds} runs, {len(complaints)} complaints", *complaints, sep="\n")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
