"""`bench/tables.py`: sections of the page are replaced; the performance profile is what it is defined as."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
LINES = [
    {"by_solver": {"ours": 1.0, "theirs": 4.0}},
    {"by_solver": {"ours": 3.0, "theirs": 2.0}},
    {"by_solver": {"ours": 1.0, "theirs": None}},
]
KERNEL = {"kernel": "row", "precision": "double", "flops": 300, "bytes": 200, "ns": 20}
MACHINE = {"by_threads": {"1": {"flops_double": 5e10, "flops_single": 1e11, "bytes_read": 2e10}}}


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(str(REPOSITORY / "bench"))
    import tables

    yield tables
    del sys.modules["tables"]


def test_only_sections_with_results_are_replaced(tables: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "scale.md").write_text("| new |\n")
    page = "a\n<!-- scale -->\n| old |\n<!-- end -->\nb\n<!-- set -->\n| kept |\n<!-- end -->\n"
    filled = tables.filled(page, tmp_path)
    assert filled == page.replace("| old |", "| new |")
    assert tables.filled(filled, tmp_path) == filled


def test_every_section_of_the_page_is_one_that_is_written(tables: ModuleType) -> None:
    page = (REPOSITORY / "docs/benchmarks.md").read_text()
    assert {match[2] for match in tables._SECTION.finditer(page)} == {"versions", "set", "scale", "stored-w"}


def test_a_profile_is_the_share_of_files_within_a_ratio(tables: ModuleType) -> None:
    taus, shares = tables.performance_profile(LINES)
    at = {tau: {solver: share[k] for solver, share in shares.items()} for k, tau in enumerate(taus)}
    assert at[1.0] == pytest.approx({"ours": 2 / 3, "theirs": 1 / 3})
    assert at[1.5]["ours"] == 1.0
    assert at[4.0]["theirs"] == pytest.approx(2 / 3)
    assert (np.diff(shares["ours"]) >= 0).all()


def test_pictures_are_drawn_and_the_same_every_time(tables: ModuleType, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    page = tmp_path / "page.md"
    page.write_text("")
    for name, content in {"set": LINES, "machine": MACHINE, "kernels": [KERNEL]}.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    drawn = []
    for _ in range(2):
        tables.main(["--results", str(tmp_path), "--page", str(page)])
        drawn.append([path.read_bytes() for path in sorted(tmp_path.glob("*.svg"))])
    assert len(drawn[0]) == 2
    assert drawn[0] == drawn[1]
