"""Usage: PYTHON tools/try_wheel.py: whether the sfmcpp installed beside this Python is whole, and works.

Looks at the files that its wheel brought, then runs the command line: its help, a scene, a solve. Fails by an
exception. For `make wheel` and cibuildwheel.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from importlib.metadata import distribution
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[1] / "python/sfmcpp"
EXTENSION = re.compile(r"sfmcpp/_core\.[\w-]+\.(so|pyd)")
LICENCES = {"LICENSE", "licenses/Eigen.txt", "licenses/pybind11.txt"}


def names_of_sources() -> set[str]:
    """What belongs into the package: all sources, with the stub, `py.typed` and the pages' templates."""
    files = (p.relative_to(SOURCES.parent) for p in SOURCES.rglob("*") if p.is_file())
    return {
        f.as_posix() for f in files if "__pycache__" not in f.parts and not EXTENSION.fullmatch(f.as_posix())
    }


def check_files() -> None:
    """The package holds its sources and one extension, nothing else is there but licence texts."""
    names = {f.as_posix() for f in distribution("sfmcpp").files or ()}
    installed = {n for n in names if not n.endswith(".pyc")}
    extensions = {n for n in installed if EXTENSION.fullmatch(n)}
    package = {n for n in installed if n.startswith("sfmcpp/")} - extensions
    metadata = {n for n in installed if n.startswith("sfmcpp-") and ".dist-info/" in n}
    scripts = {n for n in installed if n.startswith("../")}
    licences = {n.partition(".dist-info/licenses/")[2] for n in metadata} - {""}

    expect("extensions", len(extensions), 1)
    expect(
        "files of the package but not of the sources, and the reverse", package ^ names_of_sources(), set()
    )
    expect("programs", {Path(n).stem for n in scripts}, {"sfmcpp"})
    expect("licence texts", licences, LICENCES)
    expect("stray files", installed - extensions - package - metadata - scripts, set())


def check_command_line() -> None:
    """`sfmcpp --help`, a scene, and a solve that finds its minimum, from another folder."""
    with tempfile.TemporaryDirectory() as folder:
        assert "reconstruct" in sfmcpp("--help", folder=folder)
        sfmcpp("synth", "circle", "-o", "scene.npz", "--point-sigma-m", "0.1", folder=folder)
        sfmcpp("solve", "scene.npz", "-o", "solved.npz", "--report", "report.json", folder=folder)
        report = json.loads(Path(folder, "report.json").read_text(encoding="utf-8"))
    expect("termination", report["termination"], "converged")


def sfmcpp(*arguments: str, folder: str) -> str:
    """Run the command line in a folder, and give what it prints."""
    # -I: what is installed, whatever the environment or the folder have of that name.
    command = [sys.executable, "-I", "-m", "sfmcpp", *arguments]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def expect(what: str, found: object, expected: object) -> None:
    """End the program where something is not as expected."""
    if found != expected:
        raise SystemExit(f"try_wheel.py: {what}: {found}, expected {expected}")


if __name__ == "__main__":
    check_files()
    check_command_line()
    print(f"try_wheel.py: sfmcpp is whole and works with Python {sys.version.split()[0]}")
