"""`bench/scale.py`: sizes, solvers, kept results and bits, on scenes small enough for a test."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The program as a module with two tiny cases; what it imports is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(BENCH))
    before = set(sys.modules)
    from scaling.cases import Case

    import scale

    cases = {
        f"street{count}": Case(f"street{count}", "city-blocks", count, _arguments(count))
        for count in (20, 40)
    }
    monkeypatch.setattr(scale, "CASES", cases)
    yield scale
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("scale", "scaling"):
            del sys.modules[name]


def _arguments(count: int) -> tuple[str, ...]:
    return ("city-blocks", "--cameras", str(count), "--points", str(20 * count), "--point-sigma-m", "0.1")


def test_every_run_is_kept_and_none_is_repeated(
    bench: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ["--cases", "street20,street40", "--solvers", "auto,sparse", "--out", str(tmp_path)]
    bench.main(asked)
    table = capsys.readouterr().out
    assert "street40: auto takes" in table
    assert "the same bits for 1 and 2 threads after 2 steps" in table
    assert "street, sparse: seconds ∼ observations^" in table

    def refuse(*_: object) -> None:
        raise AssertionError("a known run was repeated")

    monkeypatch.setattr(bench, "run", refuse)
    bench.main(asked)
    kept = json.loads((tmp_path / "scale.json").read_text())
    assert len(kept) == 6
    assert (tmp_path / "scale.md").exists()


def test_a_run_that_fails_is_told_and_kept(bench: ModuleType, tmp_path: Path) -> None:
    bench.main(["--cases", "street20", "--solvers", "auto", "--gigabytes", "0.05", "--out", str(tmp_path)])
    (record,) = json.loads((tmp_path / "scale.json").read_text()).values()
    assert record["failure"]
    assert record["failure"] in (tmp_path / "scale.md").read_text()


def test_exponents_are_those_of_powers(bench: ModuleType) -> None:
    from scaling.table import exponent

    sizes = [1e3, 1e4, 1e6]
    assert exponent(sizes, [3 * size**1.2 for size in sizes]) == pytest.approx(1.2)
    assert exponent(sizes, [2e3, math.inf, 2e6]) == pytest.approx(1.0)
    assert exponent(sizes[:1], [1.0]) is None


def test_the_ratio_of_auto_is_to_the_best_by_name(bench: ModuleType) -> None:
    from scaling.table import ratio_of_auto

    rows = [{"asked": "auto", "seconds_to": 3.0}, {"asked": "a", "seconds_to": 2.0}]
    rows.append({"asked": "b", "seconds_to": math.inf})
    assert ratio_of_auto(rows) == pytest.approx(1.5)
    assert ratio_of_auto(rows[:1]) is None


def test_a_time_to_the_target_counts_what_any_solver_reached(bench: ModuleType, tmp_path: Path) -> None:
    from scaling.results import Results
    from scaling.table import rows_of

    results = Results(tmp_path / "kept.json")
    for solver, costs in {"auto": [9.0, 1.01, 1.001], "sparse": [9.0, 1.0]}.items():
        trace = [[0.5 * step, cost] for step, cost in enumerate(costs)]
        results.keep({"trace": trace, "final_cost": costs[-1]}, "now", "street20", "solve", solver)
    found = {row["asked"]: row["seconds_to"] for row in rows_of(results, "now", "street20")}
    assert found == {"auto": 1.0, "sparse": 0.5}
