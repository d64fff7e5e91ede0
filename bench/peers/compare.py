"""Compare bundle adjustment solvers on BAL files under one set of rules; see README.md beside this file."""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import solvers
from harness.bal_file import BalProblem, plain_copy, read_bal
from harness.measure import Entrant, Run, repeat_in_turn, tune
from harness.picture import draw
from harness.process_memory import interpreter_bytes
from harness.protocol import Job, Peer, StoppingRule
from harness.summary import Row, best_costs, make_row, median_run
from harness.table import markdown_table, notes

DEFAULT_BUILD_FOLDER = Path(__file__).resolve().parents[2] / "build" / "peers"
# Lowest cost that Ceres finds in 300 iterations with tolerances of zero.
KNOWN_BEST_COSTS = {"problem-49-7776-pre": 1.334424e4, "ladybug-49-shrink-1800": 3.001359e3}


@dataclass
class Comparison:
    """Everything measured on one file."""

    rows: list[Row]
    drawn: dict[str, Run]
    runs: list[Run]
    tuning: list[Run]
    failures: dict[str, str]


def main(arguments: Sequence[str] | None = None) -> None:
    """Compare on every file given; print the tables, write JSON and pictures."""
    args = parse(arguments)
    args.out.mkdir(parents=True, exist_ok=True)
    limit_processors(args.threads)
    peers, skipped = installed_peers(args)
    for reason in skipped:
        print(f"skipped {reason}")
    if not peers:
        raise SystemExit("no peer can run here")
    for position, path in enumerate(args.files):
        best = args.best[position] if position < len(args.best) else KNOWN_BEST_COSTS.get(stem(path))
        with tempfile.TemporaryDirectory() as folder:
            comparison, problem = compare_on(path, peers, best, args, Path(folder))
        publish(path, problem, comparison, skipped, args)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="BAL text, .bz2 or plain, or any file that sfmcpp reads",
    )
    parser.add_argument("--out", type=Path, default=Path("peers-results"), help="folder of JSON and pictures")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--tuning-repeats", type=int, default=2, help="per round; 0: first variants")
    parser.add_argument("--only", default="", help="names of peers, separated by commas")
    parser.add_argument("--best", type=float, nargs="*", default=[], metavar="COST", help="one per file")
    parser.add_argument("--max-seconds", type=float, default=120.0, help="limit of a single process")
    parser.add_argument(
        "--solve-seconds", type=float, default=1e6, help="limit of a solve, which then tells how far it came"
    )
    parser.add_argument(
        "--labels", default="", help="only these ways of Ceres, such as sparse,iterative explicit S"
    )
    parser.add_argument("--build", type=Path, default=DEFAULT_BUILD_FOLDER, help="where drivers are built")
    args = parser.parse_args(arguments)
    unknown = set(names(args.only)) - set(solvers.all_peers())
    if unknown:
        parser.error(f"--only {args.only}: no peer {', '.join(sorted(unknown))}")
    if absent := [str(path) for path in args.files if not path.is_file()]:
        parser.error(f"no such file: {', '.join(absent)}")
    return args


def names(only: str) -> list[str]:
    """The names in a list separated by commas."""
    return [name.strip() for name in only.split(",") if name.strip()]


def stem(path: Path) -> str:
    """The file's name without its suffixes."""
    return path.name.split(".")[0]


def limit_processors(threads: int) -> None:
    """Give this process and its children no more processors than threads, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])


def installed_peers(args: argparse.Namespace) -> tuple[list[Peer], list[str]]:
    """The peers asked for that can run here, and a line about each that cannot."""
    available = solvers.all_peers()
    peers, skipped = [], []
    for name in names(args.only) or available:
        reason = available[name].missing(args.build)
        if reason is None:
            peers.append(available[name])
        else:
            skipped.append(f"{name}: {reason}")
    return peers, skipped


def compare_on(
    path: Path, peers: list[Peer], best: float | None, args: argparse.Namespace, folder: Path
) -> tuple[Comparison, BalProblem]:
    """Tune, repeat and summarise on one file."""
    plain = plain_copy(path, folder)
    problem = read_bal(plain)
    rule = StoppingRule(max_seconds=args.solve_seconds)
    job = Job(plain, folder / "run", args.threads, rule, args.max_seconds)
    print(f"\n{stem(path)}: choosing the fastest settings of each solver", flush=True)
    entrants: list[Entrant] = []
    tuning: list[Run] = []
    failures: dict[str, str] = {}
    for peer in peers:
        chosen, trials, reasons = tune(peer, job, problem, args.tuning_repeats, best, say, names(args.labels))
        entrants += chosen
        tuning += trials
        failures.update(reasons)
    runs, reasons = repeat_in_turn(entrants, job, problem, args.repeats, say)
    failures.update(reasons)
    return summarise(runs, tuning, failures, best), problem


def say(line: str) -> None:
    """Progress, at once."""
    print(line, flush=True)


def summarise(
    runs: dict[str, list[Run]], tuning: list[Run], failures: dict[str, str], known_best: float | None
) -> Comparison:
    """Rows sorted as in the table, and the run to draw for each."""
    finished = [run for group in runs.values() for run in group]
    best = best_costs(finished, known_best)
    interpreter = interpreter_bytes()
    rows = [make_row(group, best[group[0].entrant.peer.objective], interpreter) for group in runs.values()]
    rows.sort(key=lambda row: row.rank)
    drawn = {row.title: median_run(runs[row.title], row.best_cost) for row in rows}
    return Comparison(rows, drawn, finished, tuning, failures)


def publish(
    path: Path, problem: BalProblem, comparison: Comparison, skipped: list[str], args: argparse.Namespace
) -> None:
    """Print the table; write JSON, the table and the picture."""
    heading = (
        f"{stem(path)}: {len(problem.cameras)} cameras, {len(problem.points)} points, "
        f"{len(problem.pixels)} observations; {args.threads} threads, {args.repeats} runs in turn"
    )
    failed = [f"failed {title}: {reason}" for title, reason in comparison.failures.items()]
    text = [heading, "", markdown_table(comparison.rows), "", *notes(comparison.rows), *failed]
    print("\n" + "\n".join(text))
    base = args.out / stem(path)
    base.with_suffix(".md").write_text("\n".join([*text, *(f"skipped {s}" for s in skipped)]) + "\n")
    document = {"input": heading, "path": str(path), **environment(args), "skipped": skipped}
    base.with_suffix(".json").write_text(json.dumps(finite({**document, **as_json(comparison)}), indent=1))
    if comparison.rows:
        curves = [(row, comparison.drawn[row.title]) for row in comparison.rows]
        draw(curves, heading, base.with_suffix(".png"))
    print(f"\nwritten: {base}.*")


def environment(args: argparse.Namespace) -> dict[str, Any]:
    """Where and when, and under which rules."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "machine": platform.platform(),
        "processors": os.cpu_count(),
        "threads": args.threads,
        "stopping_rule": asdict(StoppingRule(max_seconds=args.solve_seconds)),
    }


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Rows and runs as plain values."""
    return {
        "rows": [asdict(row) for row in comparison.rows],
        "runs": [run_as_json(run) for run in comparison.runs],
        "tuning": [run_as_json(run) for run in comparison.tuning],
        "failures": comparison.failures,
    }


def run_as_json(run: Run) -> dict[str, Any]:
    """One run with its trace."""
    values = {key: value for key, value in vars(run).items() if key not in ("entrant", "outcome")}
    settings = run.entrant.variant.describe()
    return {"title": run.entrant.title, "settings": settings, **values, **asdict(run.outcome)}


def finite(value: Any) -> Any:
    """The same with null for what is infinite: JSON has no infinity."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    main()
