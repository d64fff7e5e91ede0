"""Who may include or import whom: the layer table of the architecture, held as data."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]

# Each layer with those directly below it; what these may include, it may include too.
CPP_BELOW: dict[str, set[str]] = {
    "core": set(),
    "math": {"core"},
    "features": {"core"},
    "cameras": {"math"},
    "linear": {"math"},
    "residuals": {"cameras"},
    "optim": {"linear"},
    "ba": {"residuals", "optim"},
    "bindings": {"ba", "features"},
}
# Foreign headers that stay behind one layer.
CPP_HOME_OF_HEADER = {"pybind11": "bindings", "Python.h": "bindings"}

# Each level may import every level before it; neighbours on one level do not import each other.
PYTHON_LEVELS: list[set[str]] = [
    {"_core", "errors", "wording"},
    {"model"},
    {"geometry"},
    {"sensors"},
    {"ba"},
    {"weighting", "sources"},
    {"map", "doctor"},
    {"slam", "sfm"},
    {"study"},
    {"cli"},
]
PYTHON_LEVEL = {layer: level for level, layers in enumerate(PYTHON_LEVELS) for layer in layers}
# Layers above others that still know nothing of them.
PYTHON_APART = {"ba": {"geometry", "sensors"}}
# The package's own __init__, its public names and __main__, which re-export and start.
PYTHON_ROOT = "sfmcpp"
# What every layer may import beside the standard library; SciPy inside functions only, as it loads slowly.
# Of typing_extensions type checkers have their own copy; nothing imports it at run time.
PYTHON_EVERYWHERE = {"numpy", "scipy", "typing_extensions"}
PYTHON_FOREIGN = {
    "cli": {"rich", "typer", "matplotlib", "mpi4py"},
    "study": {"matplotlib", "viser"},
    "geometry": {"poselib"},
    "sources": {"cv2", "PIL", "pycolmap", "yaml", "rerun", "rosbags", "lz4"},
}

INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*[<"]([^>"]+)[>"]', re.MULTILINE)


def cpp_layers_allowed(layer: str) -> set[str]:
    """The layer itself and all layers below it."""
    return {layer}.union(*(cpp_layers_allowed(below) for below in CPP_BELOW[layer]))


def included_layer(include: str) -> str | None:
    """Layer of an include such as ``sfmcpp/math/so3.hpp``, ``../math/so3.hpp``; None for one of no layer."""
    parts = [part for part in PurePosixPath(include).parts if part != ".."]
    if parts[0] == "sfmcpp":
        return parts[1]
    return parts[0] if parts[0] in CPP_BELOW else None


def is_include_allowed(layer: str, include: str) -> bool:
    home = CPP_HOME_OF_HEADER.get(PurePosixPath(include).parts[0])
    if home is not None:
        return layer == home
    target = included_layer(include)
    return target is None or target in cpp_layers_allowed(layer)


def cpp_files(root: Path) -> Iterator[tuple[str, Path]]:
    """Layer and path of every C++ file below ``cpp/include/sfmcpp`` and ``cpp/src``."""
    for top in (root / "cpp/include/sfmcpp", root / "cpp/src"):
        for path in sorted(top.rglob("*.[ch]pp")):
            yield path.relative_to(top).parts[0], path


def cpp_violations(root: Path) -> list[str]:
    """Every include that points up or sideways, and every file that belongs to no layer."""
    found = []
    for layer, path in cpp_files(root):
        name = path.relative_to(root).as_posix()
        if layer not in CPP_BELOW:
            found.append(f"{name}: {layer!r} is no layer")
            continue
        includes = INCLUDE.findall(path.read_text(encoding="utf-8"))
        found += [f"{name} includes {i}" for i in includes if not is_include_allowed(layer, i)]
    return found


def imported_modules(path: Path, package: list[str]) -> Iterator[list[str]]:
    """Absolute dotted names, as lists, of all that a file of `package` imports, inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = base + (node.module.split(".") if node.module else [])
            yield from (([*base, alias.name]) for alias in node.names)


def python_layer(module: list[str]) -> str:
    """Layer of a dotted name that starts with ``sfmcpp``."""
    return module[1] if len(module) > 1 and module[1] in PYTHON_LEVEL else PYTHON_ROOT


def is_import_allowed(layer: str, module: list[str]) -> bool:
    if module[0] != PYTHON_ROOT:
        return module[0] in sys.stdlib_module_names | PYTHON_EVERYWHERE | PYTHON_FOREIGN.get(layer, set())
    target = python_layer(module)
    if layer in (PYTHON_ROOT, "cli") or target == layer:
        return True
    if target == PYTHON_ROOT or target in PYTHON_APART.get(layer, set()):
        return False
    return PYTHON_LEVEL[target] < PYTHON_LEVEL[layer]


def python_violations(root: Path) -> list[str]:
    """Every import that points up or sideways or out of the package, and every file of no layer."""
    found = []
    top = root / "python/sfmcpp"
    for path in sorted(top.rglob("*.py")):
        inside = path.relative_to(top)
        layer = inside.parts[0].removesuffix(".py")
        layer = PYTHON_ROOT if layer in ("__init__", "__main__", "_public") else layer
        name = path.relative_to(root).as_posix()
        if layer != PYTHON_ROOT and layer not in PYTHON_LEVEL:
            found.append(f"{name}: {layer!r} is no layer")
            continue
        modules = imported_modules(path, [PYTHON_ROOT, *inside.parts[:-1]])
        found += [f"{name} imports {'.'.join(m)}" for m in modules if not is_import_allowed(layer, m)]
    return found


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def test_no_cpp_include_points_up_or_sideways() -> None:
    assert list(cpp_files(REPOSITORY))
    assert cpp_violations(REPOSITORY) == []


def test_no_python_import_points_up_or_sideways() -> None:
    assert (REPOSITORY / "python/sfmcpp/__init__.py").is_file()
    assert python_violations(REPOSITORY) == []


@pytest.mark.parametrize(
    ("file", "include"),
    [
        ("include/sfmcpp/linear/a.hpp", '"sfmcpp/cameras/bal.hpp"'),
        ("include/sfmcpp/optim/a.hpp", '"sfmcpp/residuals/loss.hpp"'),
        ("src/residuals/a.cpp", '"sfmcpp/linear/schur.hpp"'),
        ("src/residuals/a.cpp", "<sfmcpp/optim/state.hpp>"),
        ("src/core/a.cpp", '"../math/so3.hpp"'),
        ("src/math/a.cpp", '"cameras/bal.hpp"'),
        ("src/ba/a.cpp", "<pybind11/numpy.h>"),
        ("src/ba/a.cpp", "<Python.h>"),
        ("src/ba/a.cpp", '"sfmcpp/bindings/views.hpp"'),
        ("src/helpers/a.cpp", "<vector>"),
    ],
)
def test_a_forbidden_include_is_found(tmp_path: Path, file: str, include: str) -> None:
    write(tmp_path / "cpp" / file, f"#pragma once\n  #  include {include}\n")
    assert len(cpp_violations(tmp_path)) == 1


@pytest.mark.parametrize(
    ("file", "include"),
    [
        ("src/ba/a.cpp", '"sfmcpp/core/error.hpp"'),
        ("src/optim/a.cpp", '"sfmcpp/math/so3.hpp"'),
        ("src/bindings/a.cpp", "<pybind11/numpy.h>"),
        ("src/core/a.cpp", "<Eigen/Core>"),
        ("src/math/a.cpp", '"local.hpp"'),
    ],
)
def test_an_allowed_include_passes(tmp_path: Path, file: str, include: str) -> None:
    write(tmp_path / "cpp" / file, f"#include {include}\n")
    assert cpp_violations(tmp_path) == []


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("geometry/so3.py", "from sfmcpp.sensors import Mounting"),
        ("ba/solve.py", "import sfmcpp.sources.io.bal"),
        ("ba/solve.py", "from ..sources.io import bal"),
        ("ba/solve.py", "from .. import sources"),
        ("sources/io/bal.py", "from sfmcpp.weighting import solve"),
        ("ba/solve.py", "from sfmcpp import Problem"),
        ("model/problem.py", "from sfmcpp.ba import solve"),
        ("errors.py", "from sfmcpp import _core"),
        ("slam/loop.py", "def f() -> None:\n    from sfmcpp.study.plotting import plot"),
        ("ba/solve.py", "import cv2"),
        ("sources/io/ply.py", "from rich.progress import track"),
        ("study/plotting/plot.py", "import typer"),
        ("helpers.py", ""),
    ],
)
def test_a_forbidden_import_is_found(tmp_path: Path, file: str, text: str) -> None:
    write(tmp_path / "python/sfmcpp" / file, text)
    assert len(python_violations(tmp_path)) == 1


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("__init__.py", "from sfmcpp.ba import solve"),
        ("cli/main.py", "import typer\nfrom sfmcpp import io, Problem"),
        (
            "ba/solve.py",
            "import os.path\nimport numpy as np\nfrom sfmcpp import _core\nfrom ..model import Problem",
        ),
        ("ba/solve.py", "from . import options\nfrom .options import SolveOptions"),
        ("weighting/fits.py", "from sfmcpp.ba import adjust\nfrom scipy import sparse"),
        ("study/evaluation/rms.py", "from sfmcpp.ba import adjust"),
    ],
)
def test_an_allowed_import_passes(tmp_path: Path, file: str, text: str) -> None:
    write(tmp_path / "python/sfmcpp" / file, text)
    assert python_violations(tmp_path) == []


LIBRARIES = {"numpy", "rich", "typer", "matplotlib", "scipy", "poselib", "cv2", "viser"}


def libraries_loaded_by(code: str) -> set[str]:
    code += "; import sys; print(*{name.split('.')[0] for name in sys.modules})"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "sfmcpp" in told.split()
    return LIBRARIES & set(told.split())


@pytest.mark.parametrize("module", ["sfmcpp", "sfmcpp.cli.main", "sfmcpp.cli.dispatch"])
def test_importing_the_package_or_its_commands_loads_no_library(module: str) -> None:
    assert libraries_loaded_by(f"import {module}") == set()


@pytest.mark.parametrize("name", ["solve", "sfm", "slam", "study"])
def test_using_a_name_of_the_package_loads_numpy_and_no_other_library(name: str) -> None:
    assert libraries_loaded_by(f"import sfmcpp; sfmcpp.{name}") == {"numpy"}


@pytest.mark.parametrize(
    "code",
    [
        "import sfmcpp; assert {'solve', 'Problem', 'sfm', '__version__'} <= set(dir(sfmcpp))",
        "import sfmcpp; assert set(sfmcpp.__all__) <= set(dir(sfmcpp))",
        "import sfmcpp; assert not {'os', 'Any', 'RLock', 'import_module'} & set(dir(sfmcpp))",
        "from sfmcpp import *; solve, Problem, SCENES",
        "import sfmcpp; sfmcpp.weighting.solve, sfmcpp.geometry.Similarity, sfmcpp._core.SolveOptions",
        "import sfmcpp; assert not hasattr(sfmcpp, 'solv') and not hasattr(sfmcpp, '_solve')",
        "import pickle, sfmcpp; pickle.loads(pickle.dumps(sfmcpp.InvalidArgument('x')))",
    ],
)
def test_names_that_are_loaded_late_are_there_as_any_others(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True)


FIRST_NAMES_ON_THREADS = """
import sys, threading, time
from importlib.abc import MetaPathFinder

begun, second_asks, loading = threading.Event(), threading.Event(), []

class Watching(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.startswith("sfmcpp."):
            loading.append(threading.current_thread().name)
            if not begun.is_set():
                begun.set()
                second_asks.wait()
                time.sleep(0.2)  # in which the second would load what it could

import sfmcpp
sys.meta_path.insert(0, Watching())

def first():
    sfmcpp.geometry

def second():
    begun.wait()
    second_asks.set()
    sfmcpp.read

threads = [threading.Thread(target=task, name=task.__name__) for task in (first, second)]
threads[0].start()
threads[1].start()
for thread in threads:
    thread.join()
assert loading == sorted(loading) and set(loading) == {"first", "second"}, loading
assert sfmcpp.geometry and sfmcpp.read
"""


def test_threads_load_the_names_that_they_use_first_one_after_the_other() -> None:
    subprocess.run([sys.executable, "-c", FIRST_NAMES_ON_THREADS], check=True)
