"""Everything on docs/benchmarks.md that is measured, with one command; what is known is not measured again.

    python bench/reproduce.py [--quick] [--build build/release] [--scenes DIR] [--extra FILE …]

Runs `bench/scale.py`, `bench/peers/whole_set.py`, `bench/stored_w.py` and the probe of the machine on an
otherwise idle machine, puts their results into `bench/results`, and fills in the page by `bench/tables.py`.
All of it takes hours. --quick, a trial of some minutes, leaves results and page as they are: it fills in a
copy of the page, in build/benchmarks/quick. Kernels (kernels.json) are measured by the C++ benchmarks.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

BENCH = Path(__file__).resolve().parent
RESULTS = BENCH / "results"
PAGE = BENCH.parent / "docs" / "benchmarks.md"
DATA = Path(os.environ.get("SFMCPP_DATA", BENCH.parents[1] / "shared" / "data"))
PROGRAMS = ("sfmcpp_stored_w", "sfmcpp_probe")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, collect, fill in."""
    args = parse(arguments)
    scenes = args.scenes or args.work / "scenes"
    results = trial_folder(args.work / "quick") if args.quick else RESULTS
    page = results / PAGE.name if args.quick else PAGE
    scale(args.work / "scale", scenes, args.quick, results)
    whole_set(args.work / "set", scenes, args.quick, args.extra, results)
    stored_w(args.build, scenes, results)
    probe(args.build, results)
    (results / "versions.md").write_text(versions() + "\n")
    run("tables.py", "--results", str(results), "--page", str(page))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line; what the last steps need is asked for before the first."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--build", type=Path, default=BENCH.parent / "build" / "release")
    parser.add_argument("--work", type=Path, default=BENCH.parent / "build" / "benchmarks")
    parser.add_argument("--scenes", type=Path, help="default: scenes in --work")
    parser.add_argument("--extra", type=Path, nargs="*", default=[], help="more files for the set")
    args = parser.parse_args(arguments)
    if absent := [name for name in PROGRAMS if not program(args.build, name).is_file()]:
        parser.error(
            f"--build {args.build}: no {', '.join(absent)} in bench/cpp: `cmake --preset release && cmake "
            "--build build/release` builds them"
        )
    if absent := [str(path) for path in args.extra if not path.is_file()]:
        parser.error(f"--extra: no such file: {', '.join(absent)}")
    return args


def trial_folder(folder: Path) -> Path:
    """A folder for the results of a trial, with the known kernels and a copy of the page."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in (RESULTS / "kernels.json", PAGE):
        shutil.copy(path, folder)
    return folder


def program(build: Path, name: str) -> Path:
    """Where a build has a program of the C++ benchmarks."""
    return build / "bench" / "cpp" / name


def run(program: str, *arguments: str) -> None:
    """A program of this folder."""
    subprocess.run([sys.executable, str(BENCH / program), *arguments], check=True)


def scale(out: Path, scenes: Path, quick: bool, results: Path) -> None:
    """Time and memory against size; the page has the table alone."""
    run("scale.py", "--out", str(out), "--scenes", str(scenes), *(["--quick"] if quick else []))
    shutil.copy(out / "scale.md", results)


def whole_set(out: Path, scenes: Path, quick: bool, extra: Sequence[Path], results: Path) -> None:
    """All peers on the set of small and middle problems."""
    from scaling.results import commit

    fewer = ["--cameras", "50", "--repeats", "1", "--tuning-repeats", "0"] if quick else []
    more = ["--extra", *map(str, extra)] if extra else []
    run("peers/whole_set.py", "--out", str(out), "--scenes", str(scenes), *fewer, *more)
    for name in ("set.md", "set.json"):
        shutil.copy(out / commit() / name, results)


def stored_w(build: Path, scenes: Path, results: Path) -> None:
    """Both variants of W, on the city of 1,000 cameras and, if it is there, the BAL problem."""
    from scaling.cases import CASES

    files = [*sorted((DATA / "bal").glob("problem-49*")), CASES["city1000"].path(scenes)]
    stored_w = program(build, "sfmcpp_stored_w")
    run("stored_w.py", str(stored_w), *map(str, files), "--out", str(results / "stored-w.json"))


def probe(build: Path, results: Path) -> None:
    """What the machine can do at most."""
    command = [program(build, "sfmcpp_probe")]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    (results / "machine.json").write_text(json.dumps(json.loads(found.stdout), indent=1) + "\n")


def versions() -> str:
    """A list of what was used."""
    import numpy as np

    import sfmcpp

    lines = {
        "sfmcpp": f"{sfmcpp.__version__}, {_first_line('git', '-C', str(BENCH), 'log', '-1', '--format=%h')}",
        "processor": _processor(),
        "system": platform.platform(),
        "compiler": _first_line("g++", "--version"),
        "Python, NumPy": f"{platform.python_version()}, {np.__version__}",
        "Ceres (Debian)": _debian("libceres-dev"),
        "SuiteSparse (Debian)": _debian("libsuitesparse-dev"),
        "OpenBLAS (Debian)": _debian("libopenblas-dev"),
        **{name: _python_package(name) for name in ("pycolmap", "gtsam")},
    }
    return "\n".join(f"- {name}: {value}" for name, value in lines.items())


def _first_line(*command: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "not installed"
    return done.stdout.strip().splitlines()[0] if done.stdout.strip() else "not installed"


def _debian(package: str) -> str:
    return _first_line("dpkg-query", "--show", "--showformat=${Version}", package)


def _python_package(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    count = sum(line.startswith("processor") for line in lines)
    return f"{model or platform.machine()}, {count} processors"


if __name__ == "__main__":
    main()
