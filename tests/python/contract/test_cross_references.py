"""What docstrings refer to is there, under the name they give."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[3] / "python/sfmcpp"
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
