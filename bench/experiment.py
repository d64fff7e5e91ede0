"""Reproduce one table or figure of the thesis, or one study beyond it; see README.md in `experiments`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from experiments.description import Experiment, ExperimentError, load, names, other_names, titles
from experiments.kinds import KINDS

from sfmcpp import SfmcppError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment that is named, or list all."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.list:
        print(_listing())
        return 0
    name = other_names().get(args.name, args.name)
    if name not in names():
        parser.error(f"NAME = {args.name!r}: must be one of {', '.join(names())}")
    try:
        run(load(name, runs=args.runs), args.out)
    except (ExperimentError, SfmcppError, OSError) as failure:
        parser.error(str(failure))
    return 0


def run(experiment: Experiment, out: Path) -> None:
    """Make the report, print it, and write its JSON and PNG."""
    out.mkdir(parents=True, exist_ok=True)
    report = KINDS[experiment.kind](experiment)
    print(report.text(experiment))
    for path in report.write(experiment, out):
        print(path)


def _listing() -> str:
    lines = titles() | {other: f"see {name}" for other, name in other_names().items()}
    width = max(map(len, lines)) + 2
    return "\n".join(f"{name:<{width}}{lines[name]}" for name in sorted(lines))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="experiment.py", description=__doc__)
    parser.add_argument("name", nargs="?", metavar="NAME", help="which; --list names them all")
    parser.add_argument("--out", type=Path, default=Path("experiment-results"), help="folder of JSON and PNG")
    parser.add_argument("--runs", type=_positive, help="runs per setting, in place of the described number")
    parser.add_argument("--list", action="store_true", help="list the experiments")
    return parser


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r}: must be at least 1")
    return value


if __name__ == "__main__":
    sys.exit(main())
