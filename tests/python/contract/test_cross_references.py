"""What docstrings and documents refer to is there, under the name they give."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]
PACKAGE = REPOSITORY / "python/sfmcpp"
# Where paths in documents begin: both languages call a file by its layer.
ROOTS = (".", "python/sfmcpp", "python/sfmcpp/sources", "cpp/include", "cpp/include/sfmcpp", "cpp/src")
SOURCE_PATH = re.compile(r"`([\w-]+/[\w/-]+\.(?:py|hpp|cpp|toml|md))`")
REFERENCE = re.compile(r":(?:func|class|mod|meth|attr|data):`~?(sfmcpp\.[\w.]+)`")


def references() -> dict[str, str]:
    """Every full name that a docstring refers to, and a file that does."""
    return {
        name: str(path.relative_to(PACKAGE))
        for path in sorted(PACKAGE.rglob("*.py"))
        for name in REFERENCE.findall(path.read_text(encoding="utf-8"))
    }


def is_there(name: str) -> bool:
    """Whether a module, or what is in one, has this name."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            found = getattr(found, part, None)
        return found is not None
    return False


def test_every_reference_leads_somewhere() -> None:
    found = references()
    assert len(found) > 20
    assert {name: path for name, path in found.items() if not is_there(name)} == {}


def test_a_name_that_is_not_there_is_found() -> None:
    assert is_there("sfmcpp.sfm.reconstruct")
    assert is_there("sfmcpp.geometry.similarity")
    assert not is_there("sfmcpp.sfm.read_nothing")
    assert not is_there("sfmcpp.sfm.nothing.at_all")


def paths_that_lead_nowhere(document: str) -> set[str]:
    """Paths of sources and documents between backticks that are those of no file."""
    named = set(SOURCE_PATH.findall(document))
    return {path for path in named if not any((REPOSITORY / root / path).is_file() for root in ROOTS)}


def test_every_file_that_a_document_names_is_there() -> None:
    documents = [REPOSITORY / "ARCHITECTURE.md", REPOSITORY / "README.md"]
    documents += sorted((REPOSITORY / "docs").rglob("*.md"))
    found = {path.name: paths_that_lead_nowhere(path.read_text(encoding="utf-8")) for path in documents}
    assert {name: paths for name, paths in found.items() if paths} == {}


def test_a_path_that_leads_nowhere_is_found() -> None:
    assert (
        paths_that_lead_nowhere("`ba/rigs.hpp`, `sfm/growth.py`, `io/api.py`, `docs/equations.md`") == set()
    )
    assert paths_that_lead_nowhere("`sfm/no_such_file.py`, `own.hpp`") == {"sfm/no_such_file.py"}
