"""All peers on a whole set of problems: how many times as fast sfmcpp is, and with how much of the memory.

    python bench/peers/whole_set.py [--out DIR] [--data DIR] [--repeats 3] [--cameras 50,100,200,500]
                                    [--only sfmcpp,ceres] [--tuning-repeats 1] [--extra FILE …]

The set: `bal/*`, `dbat_roma` and `malaga` of the folder of real data, the extra files (of any format that
sfmcpp reads and BAL can hold), and synthetic cities and photo collections of 50 to 500 cameras. Each file is
compared by the rules of `compare.py`; results are kept in DIR by commit, and a file that is there is not run
again. Ratios are the peer's seconds to 1e-3 over ours, of the best of its linear solvers.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import compare
from harness.summary import MEGABYTE
from real_blocks import real_block_files

BENCH = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SFMCPP_DATA", BENCH.parents[1] / "shared" / "data"))
TARGET = "0.001"
GOAL, FLOOR, MEMORY_SHARE = 15.0, 8.0, 1 / 3


@dataclass(frozen=True)
class Line:
    """What came out for one file.

    Attributes
    ----------
    ratios, is_limit, memory_ratios : dict
        By the name of the peer; lower limits where it never came to 1e-3: its solvers ran so much longer at
        least, until they were stopped or stopped by themselves.
    by_solver : dict
        Seconds to 1e-3 of each solver of each peer; None where it never came there.
    """

    name: str
    heading: str
    seconds: float
    ratios: dict[str, float]
    is_limit: dict[str, bool]
    megabytes: float
    memory_ratios: dict[str, float]
    by_solver: dict[str, float | None]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing; print and write the table."""
    args = parse(arguments)
    sys.path.append(str(BENCH))
    from scaling.results import commit

    folder = args.out / commit()
    folder.mkdir(parents=True, exist_ok=True)
    scenes = args.scenes or args.out / "scenes"
    real = [*sorted((args.data / "bal").glob("*.txt*")), *real_block_files(args.data, scenes)]
    files = [*real, *args.extra, *synthetic_files(args.cameras, scenes)]
    for path in files:
        if not (folder / f"{compare.stem(path)}.json").exists():
            compare.main([str(path), "--out", str(folder), *passed_on(args)])
    lines = [line for path in files if (line := line_of(folder / f"{compare.stem(path)}.json")) is not None]
    table = markdown(lines)
    (folder / "set.md").write_text(table + "\n")
    (folder / "set.json").write_text(json.dumps(compare.finite([vars(line) for line in lines]), indent=1))
    print(table)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("peers-set"))
    parser.add_argument("--data", type=Path, default=DATA, help="default: $SFMCPP_DATA")
    parser.add_argument("--extra", type=Path, nargs="*", default=[], metavar="FILE")
    parser.add_argument("--cameras", default="50,100,200,500", help="of the synthetic scenes")
    parser.add_argument("--scenes", type=Path, help="where they are kept; default: scenes in --out")
    parser.add_argument("--only", default="")
    parser.add_argument("--labels", default="")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--tuning-repeats", type=int, default=1)
    parser.add_argument("--solve-seconds", type=float, default=60.0)
    parser.add_argument("--max-seconds", type=float, default=180.0)
    return parser.parse_args(arguments)


def passed_on(args: argparse.Namespace) -> list[str]:
    """Options that `compare.py` has, too."""
    names = ("only", "labels", "threads", "repeats", "tuning_repeats", "solve_seconds", "max_seconds")
    return [part for name in names for part in (f"--{name.replace('_', '-')}", str(getattr(args, name)))]


def synthetic_files(cameras: str, folder: Path) -> list[Path]:
    """Cities and photo collections with a poor start, made once."""
    from scaling.cases import scene_of

    counts = [int(count) for count in cameras.split(",") if count.strip()]
    shapes = (("city-blocks", "city"), ("photo-collection", "photos"))
    return [scene_of(shape, stem, count).path(folder) for shape, stem in shapes for count in counts]


def line_of(path: Path) -> Line | None:
    """Ratios from the JSON of one comparison; None if sfmcpp never came to 1e-3."""
    document = json.loads(path.read_text())
    best: dict[str, dict[str, Any]] = {}
    for row in document["rows"]:
        best.setdefault(row["peer"], row)  # rows are sorted by their seconds to 1e-3
    own = best.pop("sfmcpp", None)
    if own is None or own["seconds_to_median"][TARGET] is None:
        return None
    seconds = {peer: row["seconds_to_median"][TARGET] for peer, row in best.items()}
    limits = seconds_run(document)
    own_seconds = own["seconds_to_median"][TARGET]
    return Line(
        name=path.stem,
        heading=document["input"],
        seconds=own_seconds,
        ratios={peer: (limits[peer] if s is None else s) / own_seconds for peer, s in seconds.items()},
        is_limit={peer: s is None for peer, s in seconds.items()},
        megabytes=own["above_inputs"] / MEGABYTE,
        memory_ratios={
            peer: own["above_inputs"] / row["above_inputs"]
            for peer, row in best.items()
            if row["above_inputs"]
        },
        by_solver={row["title"]: row["seconds_to_median"][TARGET] for row in document["rows"]},
    )


def seconds_run(document: dict[str, Any]) -> dict[str, float]:
    """How long runs of each peer were: of its solvers the one that stopped first, in the median."""
    peers = {row["title"]: row["peer"] for row in document["rows"]}
    runs: dict[str, list[float]] = {}
    for run in document["runs"]:
        runs.setdefault(run["title"], []).append(run["seconds_total"])
    medians = [(peers[title], median(seconds)) for title, seconds in runs.items()]
    return {peer: min(seconds for other, seconds in medians if other == peer) for peer, _ in medians}


def markdown(lines: Sequence[Line]) -> str:
    """The table, and below it geometric means."""
    peers = list(dict.fromkeys(peer for line in lines for peer in line.ratios))
    head = ["file", "ms to 1e-3", *(f"× {peer}" for peer in peers), "MB", *(f"of {p}'s MB" for p in peers)]
    rows = [[line.name, f"{1e3 * line.seconds:.1f}", *_shown(line, peers)] for line in lines]
    table = ["| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows)]
    return "\n".join([*table, "", *(_verdict(lines, peer) for peer in peers)])


def _shown(line: Line, peers: Sequence[str]) -> list[str]:
    times = [f"{'≥ ' * line.is_limit[p]}{line.ratios[p]:.1f}" if p in line.ratios else "–" for p in peers]
    memory = [f"{line.memory_ratios[p]:.2f}" if p in line.memory_ratios else "–" for p in peers]
    return [*times, f"{line.megabytes:.1f}", *memory]


def _verdict(lines: Sequence[Line], peer: str) -> str:
    ratios = [line.ratios[peer] for line in lines if peer in line.ratios]
    memory = [line.memory_ratios[peer] for line in lines if peer in line.memory_ratios]
    mean, least = geometric_mean(ratios), min(ratios)
    text = f"- {peer}: geometric mean {mean:.1f} times (goal {GOAL:g}), least {least:.1f} (goal {FLOOR:g})"
    if not memory:
        return text
    return f"{text}; memory {geometric_mean(memory):.2f} of its own (goal {MEMORY_SHARE:.2f})"


def geometric_mean(values: Sequence[float]) -> float:
    """Of positive numbers."""
    return math.exp(sum(map(math.log, values)) / len(values))


if __name__ == "__main__":
    main()
