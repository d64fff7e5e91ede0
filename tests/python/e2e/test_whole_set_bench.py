"""`bench/peers/whole_set.py`: what a peer that never came to the target is held to."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from bench_programs import BENCH, as_module


@pytest.fixture
def whole_set(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    yield from as_module(monkeypatch, BENCH / "peers", "whole_set")


def row(title: str, peer: str, seconds: float | None, megabytes: float) -> dict[str, Any]:
    return {
        "title": title,
        "peer": peer,
        "seconds_to_median": {"0.001": seconds},
        "above_inputs": 1e6 * megabytes,
    }


def test_a_peer_that_never_came_ran_for_as_long_as_its_runs(whole_set: ModuleType, tmp_path: Path) -> None:
    document = {
        "input": "a scene",
        "stopping_rule": {"max_seconds": 10.0},
        "rows": [
            row("sfmcpp", "sfmcpp", 0.5, 20),
            row("GTSAM", "gtsam", 2.0, 80),
            row("Ceres (sparse)", "ceres", None, 40),
            row("Ceres (dense)", "ceres", None, 50),
        ],
        "runs": [
            {"title": title, "seconds_total": seconds}
            for title, seconds in [
                ("sfmcpp", 0.9),
                ("GTSAM", 10.0),
                ("Ceres (sparse)", 7.0),
                ("Ceres (dense)", 6.0),
                ("Ceres (dense)", 9.0),
                ("Ceres (dense)", 5.0),
            ]
        ],
    }
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document))
    line = whole_set.line_of(path)
    assert line.ratios == {"gtsam": 4.0, "ceres": 12.0}
    assert line.is_limit == {"gtsam": False, "ceres": True}
    assert "≥ 12.0" in whole_set.markdown([line])
