"""The type stub that ships with the package is the one of the module that ships with it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]


def test_committed_stub_equals_the_generated_one(tmp_path: Path) -> None:
    pytest.importorskip("pybind11_stubgen", reason="pybind11-stubgen is not installed")
    generated = tmp_path / "_core.pyi"
    command = [str(REPOSITORY / "tools/make_stub.sh"), sys.executable, str(generated)]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    committed = (REPOSITORY / "python/sfmcpp/_core.pyi").read_text(encoding="utf-8")
    assert committed == generated.read_text(encoding="utf-8"), "write it anew with: make stubs"
