"""`bench/counts.py`: what grew is told, and where counts cannot be compared it says why."""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"
STEP = {
    "instructions": 1e7,
    "data_references": 5e6,
    "last_level_misses": 5e4,
    "allocations": 10.0,
    "allocated_bytes": 1e5,
}
COUNTED = {
    "compiler": "13.2",
    "libc": "glibc-2.36",
    "solvers": {"dense": {"set-up and 2 steps": STEP, "3 further steps": STEP}},
}


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(BENCH))
    import counts

    yield counts
    del sys.modules["counts"]


def compared(
    counts: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, before: dict[str, Any], now: Any
) -> int:
    path = tmp_path / "counts.json"
    path.write_text(json.dumps(before))
    monkeypatch.setattr(counts, "count_all", lambda *_: now)
    code: int = counts.main(["compare", "program", "--counts", str(path)])
    return code


def test_equal_counts_pass(counts: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert compared(counts, monkeypatch, tmp_path, COUNTED, COUNTED) == 0


@pytest.mark.parametrize("what", STEP)
def test_every_count_that_grows_is_named_with_its_solver(
    counts: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    what: str,
) -> None:
    now = copy.deepcopy(COUNTED)
    now["solvers"]["dense"]["3 further steps"][what] *= 1.5  # type: ignore[index]
    assert compared(counts, monkeypatch, tmp_path, COUNTED, now) == 1
    said = capsys.readouterr().err
    assert f"dense, 3 further steps: {what.replace('_', ' ')}" in said
    assert "+50.0 %" in said
    assert compared(counts, monkeypatch, tmp_path, now, COUNTED) == 0


def test_another_compiler_is_a_reason_to_skip(
    counts: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    now = {**COUNTED, "compiler": "14.1", "solvers": {}}
    assert compared(counts, monkeypatch, tmp_path, COUNTED, now) == 0
    assert "skipped, compiler 14.1 here, 13.2" in capsys.readouterr().out


def test_a_program_that_is_not_built_is_a_reason_to_skip(
    counts: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert counts.main(["compare", str(tmp_path / "sfmcpp_counts")]) == 0
    assert "counts: skipped" in capsys.readouterr().out


def test_totals_are_read_by_name(counts: ModuleType) -> None:
    assert counts.totals("events: Ir Dr Dw\nfn=x\n1 2 3 4\nsummary: 10 20 30\n") == {
        "Ir": 10,
        "Dr": 20,
        "Dw": 30,
    }
