"""Experiments on drives with sensors, on a synthetic walk that needs no real data."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import TIMEOUT_S

pytest.importorskip("matplotlib", reason="experiments draw pictures: needs the extra 'plot'")
pytest.importorskip("poselib", reason="SLAM needs the extra 'slam'")

BENCH = Path(__file__).resolve().parents[3] / "bench"
# A third of the walk, with a better tracker: made and followed in a second.
PROGRAM = """
import sys
from functools import partial
from pathlib import Path
from experiments import inputs, kinds
from experiments.description import Experiment
from sfmcpp.sources.synthetic import Tracker, table_walk

inputs.DRIVES["short"] = partial(table_walk, 3.0, seconds=12.0, tracker=Tracker(100, 0.3, 0.1, 0.02))
filtered = {"predict_by": "images", "turn_sigma_rad_sqrt_s": 0.005, "orientation_sigma_rad": 0.001}
runs = [{"label": "alone"}, {"label": "constant 1", "weights": "fixed:1"},
        {"label": "constant 300", "weights": "fixed:300"}, {"label": "EKF", "filter": filtered}]
drawn = {"group": "short", "labels": ["alone", "EKF"]}
settings = {"synthetic": ["short"], "sensors": ["rotation"], "runs": runs, "drawn": drawn}
for kind, count in (("orientations", 2), ("constant-orientations", 1), ("courses", 1)):
    experiment = Experiment(kind, kind, kind, settings=settings, runs=count)
    kinds.KINDS[kind](experiment).write(experiment, Path(sys.argv[1]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("drives")
    command = [sys.executable, "-W", "error", "-c", PROGRAM, str(found)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, cwd=BENCH)
    assert result.returncode == 0, result.stderr
    (found / "progress.txt").write_text(result.stderr)
    return found


def test_each_drive_that_is_done_is_told(folder: Path) -> None:
    told = (folder / "progress.txt").read_text().splitlines()
    assert told[:3] == [
        "orientations: 0 of 2 drives done",
        "orientations: 1 of 2 drives done, short 0",
        "orientations: 2 of 2 drives done, short 1",
    ]


def rows_of(folder: Path, kind: str) -> dict[tuple[str, str], dict[str, Any]]:
    rows = json.loads((folder / f"{kind}.json").read_text(encoding="utf-8"))["rows"]
    return {(row["drive"], row["label"]): row for row in rows}


def test_every_setting_is_run_on_every_seed_and_summed_up(folder: Path) -> None:
    rows = rows_of(folder, "orientations")
    labels = ("alone", "constant 1", "constant 300", "EKF")
    assert {(f"short {seed}", label) for seed in (0, 1) for label in labels} <= rows.keys()
    for label in labels:
        errors = [rows[f"short {seed}", label]["error_m"] for seed in (0, 1)]
        assert rows["short, median", label]["error_m"] == pytest.approx(sum(errors) / 2)
    assert rows["short, median", "best constant"]["over_alone"] == min(
        rows["short, median", label]["over_alone"] for label in labels[1:3]
    )


def test_a_navigation_system_betters_the_rotations_in_slam_and_after_it(folder: Path) -> None:
    rows = rows_of(folder, "orientations")
    for label in ("constant 300", "EKF"):
        assert (
            rows["short, median", label]["rotation_deg"]
            < 0.8 * rows["short, median", "alone"]["rotation_deg"]
        )


def test_all_kinds_say_the_same_and_draw_something(folder: Path) -> None:
    from matplotlib.image import imread

    kinds = ("orientations", "constant-orientations", "courses")
    first, *others = (rows_of(folder, kind) for kind in kinds)
    for other in others:
        for label in ("alone", "constant 1", "constant 300", "EKF"):
            assert first["short 0", label] == other["short 0", label]
    for kind in kinds:
        assert imread(folder / f"{kind}.png")[:, :, :3].std() > 0.05
