"""The C++ example builds in a project of C++17, with the installed library and with the sources."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
EXAMPLE = REPOSITORY / "examples/cpp"
OBJECT = "CMakeFiles/bundle_adjustment.dir/bundle_adjustment.cpp.o"


def run(*command: str | Path) -> str:
    return subprocess.run([*map(str, command)], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def built() -> Path:
    """A build folder of this repository that holds the library."""
    if shutil.which("cmake") is None or shutil.which("ninja") is None:
        pytest.skip("no cmake or no ninja")
    for name in ("python", "release"):
        if (REPOSITORY / "build" / name / "cpp/libsfmcpp.a").is_file():
            return REPOSITORY / "build" / name
    pytest.skip("no library in build/python or build/release (make install)")


def test_the_example_runs_with_the_installed_library(built: Path, tmp_path: Path) -> None:
    run("cmake", "--install", built, "--component", "development", "--prefix", tmp_path / "first")
    shutil.move(tmp_path / "first", tmp_path / "moved")
    build = tmp_path / "build"
    run("cmake", "-S", EXAMPLE, "-B", build, "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={tmp_path / 'moved'}")
    run("cmake", "--build", build)
    assert run(build / "bundle_adjustment").startswith("RMS ")


def test_the_example_compiles_with_the_sources(built: Path, tmp_path: Path) -> None:
    """Its own file alone: the library, with its sources, would take minutes."""
    run("cmake", "-S", EXAMPLE, "-B", tmp_path, "-G", "Ninja", f"-DSFMCPP_SOURCES={REPOSITORY}")
    run("cmake", "--build", tmp_path, "--target", OBJECT)
    assert (tmp_path / OBJECT).is_file()
