"""The experiment on batch factorisation, on a scene that is reconstructed in a second."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import TIMEOUT_S
from scipy.stats import binomtest

pytest.importorskip("matplotlib", reason="experiments draw pictures: needs the extra 'plot'")
pytest.importorskip("poselib", reason="fundamental matrices need the extra 'vision'")

BENCH = Path(__file__).resolve().parents[3] / "bench"
PROGRAM = """
import json, sys
from pathlib import Path
from experiments import kinds
from experiments.description import Experiment
from experiments.factorisation import interval

scene = {"name": "small", "kind": "circle", "num_cameras": 10, "num_points": 200, "pattern": "runs"}
noise = [{"pixel_sigma_px": 0.5, "outliers": 0.0}, {"pixel_sigma_px": 0.5, "outliers": 0.9}]
settings = {"noise": noise, "scenes": [{**scene, "missing": [0.4]}]}
experiment = Experiment("small", "small", "factorisation", settings=settings, runs=2)
kinds.KINDS["factorisation"](experiment).write(experiment, Path(sys.argv[1]))
print(json.dumps([interval(3, 10), interval(0, 4), interval(5, 5)]))
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder of the files, and what was printed."""
    folder = tmp_path_factory.mktemp("factorisation")
    command = [sys.executable, "-W", "error", "-c", PROGRAM, str(folder)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, cwd=BENCH)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout


def test_clean_tracks_succeed_and_hopeless_ones_fail(outcome: tuple[Path, str]) -> None:
    rows = json.loads((outcome[0] / "small.json").read_text(encoding="utf-8"))["rows"]
    clean, hopeless = rows
    assert (clean["share"], clean["runs"], clean["wrong"]) == (1.0, 2, 0.0)
    assert clean["missing"] == pytest.approx(0.4, abs=0.02)
    assert clean["error_ratio"] < 1.3
    assert hopeless["share"] == 0.0
    assert (outcome[0] / "small.png").stat().st_size > 0


def test_intervals_are_those_of_wilson(outcome: tuple[Path, str]) -> None:
    for (low, high), (hits, runs) in zip(json.loads(outcome[1]), [(3, 10), (0, 4), (5, 5)], strict=True):
        expected = binomtest(hits, runs).proportion_ci(0.95, method="wilson")
        assert (low, high) == pytest.approx((expected.low, expected.high), abs=1e-4)
