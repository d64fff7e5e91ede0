"""Running the command line the way a user does."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from conftest import TIMEOUT_S

import sfmcpp
from sfmcpp.cli.main import main
from sfmcpp.sources.synthetic import circle_scene, perturb

COMMAND = (sys.executable, "-m", "sfmcpp")


def run(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `sfmcpp` to its end, with its output captured."""
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, cwd=cwd)


def run_here(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run `sfmcpp` in this process, which takes no time to start; its output is captured."""
    given, before = list(map(str, arguments)), Path.cwd()
    out, err = io.StringIO(), io.StringIO()
    os.chdir(before if cwd is None else cwd)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = main(given)
    finally:
        os.chdir(before)
    return subprocess.CompletedProcess(given, code, out.getvalue(), err.getvalue())


def read_terminal(terminal: int) -> bytes:
    """Read what comes next; nothing once the other end is closed."""
    try:
        return os.read(terminal, 65536)
    except OSError:
        return b""


def noisy_circle(num_cameras: int = 6, num_points: int = 60, **options: Any) -> sfmcpp.Problem:
    """Make a small scene with a start away from its solution."""
    scene = circle_scene(num_cameras, num_points, seed=3, **options)
    return perturb(scene, point_sigma_m=0.3, position_sigma_m=0.3, rotation_sigma_deg=3.0, seed=3)


def write_noisy_circle(folder: Path, **options: Any) -> Path:
    """Write the small scene to a file."""
    path = folder / "start.npz"
    sfmcpp.write(noisy_circle(**options), path)
    return path


def strict_json(path: Path) -> dict[str, Any]:
    """Load JSON, refusing NaN and Infinity, which are not JSON."""

    def refuse(constant: str) -> float:
        raise ValueError(f"{path}: {constant} is not JSON")

    content: dict[str, Any] = json.loads(path.read_text(), parse_constant=refuse)
    return content


def is_one_error_line(result: subprocess.CompletedProcess[str]) -> bool:
    """Whether the command failed with exactly one line, on stderr."""
    lines = result.stderr.splitlines()
    return result.stdout == "" and len(lines) == 1 and lines[0].startswith("sfmcpp: error: ")
