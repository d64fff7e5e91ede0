"""Programs of `bench` as modules."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"


def as_module(monkeypatch: pytest.MonkeyPatch, folder: Path, name: str) -> Iterator[ModuleType]:
    """The program `name` of a folder, for fixtures; what it imports from there is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield importlib.import_module(name)
    for imported in set(sys.modules) - before:
        if str(folder) in str(getattr(sys.modules[imported], "__file__", "")):
            del sys.modules[imported]
