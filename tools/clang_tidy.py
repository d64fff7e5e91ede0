#!/usr/bin/env python3
"""Usage: clang_tidy.py BUILD_FOLDER JOBS: clang-tidy on cpp/src, with the compile commands of BUILD_FOLDER.

Nearly all of its time goes into the headers of Eigen and pybind11, which it matches line by line against
every check. So forty sources are looked at together, as one that includes them: what two of a room define for
themselves must not have the same name. Kernels, which may share names, are looked at one by one, for one
instruction set.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from pathlib import Path

SOURCES_AT_ONCE = 40
ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / "cpp/src"
# The commands were written for g++ 12, some of whose warnings clang 14 lacks. The configuration is named,
# because the files that are put together here lie in no folder that has one.
OPTIONS = [
    "--quiet",
    f"--config-file={ROOT}/.clang-tidy",
    "--extra-arg=-Wno-unknown-warning-option",
    "--extra-arg=-Wno-error",
]


def compile_flags(build: Path) -> dict[Path, tuple[str, ...]]:
    """Compiler and flags of each source, of the first command where there are several."""
    flags: dict[Path, tuple[str, ...]] = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        words = shlex.split(entry["command"])
        if Path(entry["file"]).is_relative_to(SOURCES):
            flags.setdefault(Path(entry["file"]), tuple(words[: words.index("-o")]))
    return flags


def including(folder: Path, sources: list[Path]) -> Path:
    """A file in `folder` that includes `sources`."""
    path = folder / f"{sources[0].parent.name}_{sources[0].stem}.cpp"
    lines = [f'#include "{source}"  // NOLINT(bugprone-suspicious-include)\n' for source in sources]
    path.write_text("".join(lines))
    return path


def parts(flags: dict[Path, tuple[str, ...]]) -> list[list[Path]]:
    """Sources to look at together: of the same flags, in order of their paths."""
    kernels = sorted(path for path in flags if path.stem.endswith("_kernels"))
    others = sorted(set(flags) - set(kernels), key=lambda path: (flags[path], path))
    groups = [list(group) for _, group in groupby(others, flags.get)]
    batches = [g[k : k + SOURCES_AT_ONCE] for g in groups for k in range(0, len(g), SOURCES_AT_ONCE)]
    return batches + [[path] for path in kernels]


def main(build: Path, jobs: int) -> int:
    """Run clang-tidy; the number of files that it finds fault with."""
    folder = build / "clang-tidy"
    folder.mkdir(exist_ok=True)
    flags = compile_flags(build)
    missing = [str(path) for path in SOURCES.rglob("*.cpp") if path not in flags]
    if missing or not flags:
        print(f"sfmcpp: no compile command in {build} for {', '.join(missing)}", file=sys.stderr)
        return 1

    files = {including(folder, sources): flags[sources[0]] for sources in parts(flags)}
    commands = [
        {"directory": str(build), "file": str(path), "arguments": [*words, "-c", str(path)]}
        for path, words in files.items()
    ]
    (folder / "compile_commands.json").write_text(json.dumps(commands))
    tidy = ["clang-tidy", *OPTIONS, "-p", str(folder)]
    with ThreadPoolExecutor(jobs) as pool:
        runs = [pool.submit(subprocess.run, [*tidy, str(path)], check=False) for path in files]
        return sum(run.result().returncode != 0 for run in runs)


if __name__ == "__main__":
    sys.exit(min(main(Path(sys.argv[1]).resolve(), int(sys.argv[2])), 1))
