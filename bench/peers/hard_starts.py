"""Far starts: from how many of them each solver finds the minimum that the truth leads to.

    python bench/peers/hard_starts.py [--seeds 600 601 …] [--levels 1 2 4]
                                      [--ways sfmcpp all-at-once whole ceres]
                                      [--extra FILE …] [--loss squared] [--out DIR]

Seven synthetic scenes; at level n points and positions start 0.3 n m off, rotations n degrees, the focal
lengths of photo collections 5 n %. A line for each level and way, over the scenes and seeds:

    arrived     how many end within 1e-3 of the cost that a solve from the truth ends at
    excess      geometric mean of the end over that cost, no less than 1
    seconds     geometric mean, one thread

`sfmcpp` runs with its defaults, `all-at-once` without holding intrinsics, `whole` also without refitted
points, `ceres` with DENSE_SCHUR and its defaults; each for 100 iterations at a function tolerance of 1e-7.
Extra files have no truth: their ends are listed. Seeds below 600 were used for tuning.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import sfmcpp
from harness.protocol import Job, StoppingRule
from solvers.ceres import PEER as CERES

SCENES = (
    ("city-blocks", 30),
    ("city-blocks", 80),
    ("photo-collection", 40),
    ("drive-with-loops", 80),
    ("corridor", 50),
    ("sphere", 40),
    ("street-loop", 60),
)
WAYS = {
    "sfmcpp": {},
    "all-at-once": {"intrinsic_steps": "whole"},
    "whole": {"intrinsic_steps": "whole", "point_steps": "whole"},
}
RULE = StoppingRule(max_iterations=100, function_tolerance=1e-7)
WITHIN = 1e-3


@dataclass(frozen=True)
class End:
    """Where a solve ended, and after how many seconds."""

    cost: float
    seconds: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    args = _parser().parse_args(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    if "ceres" in args.ways and (reason := CERES.missing(args.build)):
        sys.exit(f"ceres: {reason}")
    print("| level | way | arrived | excess | seconds |\n|---|---|--:|--:|--:|")
    for level in args.levels:
        starts = [_scene(args.out, *scene, seed, level) for scene in SCENES for seed in args.seeds]
        least = [_sfmcpp(truth, args.loss, {}).cost for _, truth in starts]
        for way in args.ways:
            ends = [_solve(way, start, args.loss) for start, _ in starts]
            excess = np.maximum([end.cost for end in ends], least) / least
            arrived = np.count_nonzero(excess <= 1.0 + WITHIN)
            seconds = _geometric_mean([end.seconds for end in ends])
            line = f"{arrived} of {len(ends)} | {_geometric_mean(excess):.3f} | {seconds:.3f}"
            print(f"| {level:g} | {way} | {line} |", flush=True)
    for path in args.extra:
        ends = [_solve(way, path, args.loss) for way in args.ways]
        told = ", ".join(f"{way} {end.cost:.6g}" for way, end in zip(args.ways, ends, strict=True))
        print(f"{path.name}: {told}", flush=True)


def _scene(folder: Path, name: str, cameras: int, seed: int, level: float) -> tuple[Path, Path]:
    """The files of a scene, from its start and from the truth; made once."""
    start = folder / f"{name}-{cameras}-{seed}-{level:g}.npz"
    truth = start.with_suffix(".truth.npz")
    if not truth.exists():
        noise = [
            "--point-sigma-m",
            0.3 * level,
            "--position-sigma-m",
            0.3 * level,
            "--rotation-sigma-deg",
            level,
        ]
        if name == "photo-collection":
            noise += ["--focal-sigma", 0.05 * level, "--outliers", 0.05, "--outlier-sigma-px", 10]
        files = ["-o", start, "--truth", truth, "--quiet"]
        options = ["--cameras", cameras, "--camera-model", "bal", "--seed", seed, *noise, *files]
        command = [sys.executable, "-m", "sfmcpp", "synth", name, *map(str, options)]
        subprocess.run(command, check=True)
    return start, truth


def _solve(way: str, path: Path, loss: str) -> End:
    if way == "ceres":
        return _ceres(path)
    return _sfmcpp(path, loss, WAYS[way])


def _sfmcpp(path: Path, loss: str, options: Mapping[str, str]) -> End:
    problem = sfmcpp.read(path)
    begin = time.perf_counter()
    summary = sfmcpp.solve(
        problem,
        **options,
        loss=loss,
        threads=1,
        max_iterations=RULE.max_iterations,
        function_tolerance=RULE.function_tolerance,
    )
    return End(summary.final_cost, time.perf_counter() - begin)


def _ceres(path: Path) -> End:
    with tempfile.TemporaryDirectory() as folder:
        bal = Path(folder) / "problem.txt"
        sfmcpp.write(sfmcpp.read(path), bal)
        job = Job(bal, Path(folder), threads=1, rule=RULE, max_seconds=600.0)
        variant = next(v for v in CERES.variants(1) if v.label == "dense")
        subprocess.run(CERES.command(job, variant), check=True, capture_output=True)
        outcome = CERES.outcome(job)
    return End(outcome.own_cost, outcome.seconds_total)


def _geometric_mean(values: Sequence[float] | np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(values))))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[600, 601, 602, 603, 604])
    parser.add_argument("--levels", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    parser.add_argument("--ways", nargs="+", default=[*WAYS, "ceres"], choices=[*WAYS, "ceres"])
    parser.add_argument("--extra", type=Path, nargs="*", default=[], metavar="FILE")
    parser.add_argument("--loss", default="squared", help="of sfmcpp; ceres has none here")
    parser.add_argument("--out", type=Path, default=Path("hard-starts"))
    parser.add_argument("--build", type=Path, default=Path("build/peers"))
    return parser


if __name__ == "__main__":
    main()
