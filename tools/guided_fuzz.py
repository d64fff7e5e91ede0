#!/usr/bin/env python3
"""Usage: guided_fuzz.py [--seconds S] [--corpus FOLDER] [FILE ...]: every reader, led by coverage.

Each reader (those of the FILEs named, as in mutate_inputs.py) is fuzzed by atheris for S seconds in a process
of its own, which counts the branches of the package's Python. It begins with the good file and with what
earlier runs have kept in FOLDER: an input stays there if it came to a branch that no other had come to.
What reads, or is refused with an error of the package, is well; anything else, 5 s of work or 4 GB of memory
is a fault: what libFuzzer tells of it is printed, the input stays in FOLDER, and the program ends with 1.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

try:
    import atheris
except ModuleNotFoundError:
    raise SystemExit("atheris is not installed: pip install 'sfmcpp[fuzz]'") from None
with contextlib.redirect_stderr(io.StringIO()), atheris.instrument_imports(include=["sfmcpp"]):
    import mutate_inputs
from sfmcpp.errors import SfmcppError

COLUMNS = ("file", "inputs", "branches", "kept", "end")
# libFuzzer's last words: "#4096 DONE cov: 512 ft: 1024 corp: 64/12Kb ...".
LAST_WORDS = re.compile(r"#(\d+)\s+DONE\s+cov: (\d+) .*? corp: (\d+)/")
FAULT_LINES = 30


def write_dictionary(path: Path) -> None:
    """Tell libFuzzer what sizes, numbers and indices are hardly ever."""
    words = (*mutate_inputs.ODD_NUMBERS, *mutate_inputs.ODD_WORDS)
    lines = ("".join(f"\\x{byte:02x}" for byte in word) for word in words)
    path.write_text("".join(f'"{line}"\n' for line in lines))


def give_up(number: int, frame: object) -> None:
    """Tell of a reader that works for too long, with the place where it does."""
    raise TimeoutError(f"{mutate_inputs.SECONDS} s of work")


def fuzz(name: str, corpus: Path, seconds: int) -> None:
    """Fuzz one reader; does not return."""
    with tempfile.TemporaryDirectory() as folder:
        path, reader = mutate_inputs.seeds(Path(folder))[name]
        (corpus / "good").write_bytes(path.read_bytes())
        write_dictionary(Path(folder) / "words.dict")

        def read(data: bytes) -> None:
            path.write_bytes(data)
            signal.setitimer(signal.ITIMER_PROF, mutate_inputs.SECONDS)
            with contextlib.suppress(SfmcppError):
                reader(path)
            signal.setitimer(signal.ITIMER_PROF, 0)

        signal.signal(signal.SIGPROF, give_up)
        limits = [
            f"-timeout={mutate_inputs.SECONDS_BY_THE_CLOCK}",
            f"-rss_limit_mb={mutate_inputs.MEMORY_BYTES >> 20}",
        ]
        budget = [f"-max_total_time={seconds}", f"-dict={folder}/words.dict", f"-artifact_prefix={corpus}/"]
        atheris.Setup([sys.argv[0], *limits, *budget, str(corpus)], read)
        # What is imported by the first file is counted, too.
        with atheris.instrument_imports(include=["sfmcpp"]):
            reader(path)
        atheris.Fuzz()


def tried(name: str, corpus: Path, seconds: int) -> tuple[object, ...]:
    """Fuzz one reader in a process of its own: a row of the table."""
    corpus.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, __file__, "--alone", "--seconds", str(seconds), "--corpus", str(corpus), name]
    process = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    counts = LAST_WORDS.findall(process.stderr)
    if process.returncode == 0 and counts:
        return (name, *map(int, counts[-1]), "no fault")
    print(name, *process.stderr.splitlines()[-FAULT_LINES:], sep="\n", flush=True)
    return (name, "", "", "", "fault")


def main(names: list[str], corpus: Path, seconds: int) -> int:
    """Print the table; 1 if there is a fault."""
    with tempfile.TemporaryDirectory() as folder:
        known = list(mutate_inputs.seeds(Path(folder)))
    print_row(COLUMNS)
    rows = []
    for name in names or known:
        rows.append(tried(name, corpus / name, seconds))
        print_row(rows[-1])
    return int(any(row[-1] == "fault" for row in rows))


def print_row(cells: tuple[object, ...]) -> None:
    """A line of the table."""
    print("".join(f"{cell:<18}" for cell in cells).rstrip(), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--corpus", type=Path, default=Path("build/fuzz-corpus"))
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        fuzz(given.names[0], given.corpus.resolve(), given.seconds)
    sys.exit(main(given.names, given.corpus.resolve(), given.seconds))
