"""`bench/outliers.py`: what it counts, on a scene small enough for a test."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The program as a module; it is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(BENCH))
    import outliers

    yield outliers
    for name in set(sys.modules):
        if name.split(".")[0] in ("outliers", "experiments"):
            del sys.modules[name]


def test_half_of_the_observations_wrong(
    bench: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "runs.json"
    bench.main(
        [
            "--scenes",
            "circle",
            "--shares",
            "0.5",
            "--seeds",
            "2",
            "--ways",
            "tukey",
            "auto",
            "--out",
            str(out),
        ]
    )
    runs = json.loads(out.read_text())
    assert len(runs) == 2 * 2 * 2  # kinds, seeds, ways
    for run in runs:
        assert (run["way"] == "auto") == (run["excess"] <= 0.01)
        assert run["told"] > 0.98 or run["way"] == "tukey"
    assert "2 of 2" in capsys.readouterr().out


# Of so many pairs of views as once were tried, none met near enough to some points.
def test_half_of_real_pixels_swapped(
    bench: ModuleType, data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SFMCPP_DATA", str(data_dir))
    [run] = bench.runs("bal-1800", 0.5, "swapped", 7, ["auto"])
    assert run["excess"] <= bench.WITHIN
