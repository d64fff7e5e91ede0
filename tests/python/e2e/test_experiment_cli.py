"""`python bench/experiment.py`: what it writes, that it repeats, and how it refuses."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import TIMEOUT_S

from cli_helpers import strict_json

pytest.importorskip("matplotlib", reason="experiments draw pictures: needs the extra 'plot'")

REPOSITORY = Path(__file__).resolve().parents[3]
COMMAND = (sys.executable, str(REPOSITORY / "bench" / "experiment.py"))
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
CONVERGENCE_FIELDS = {
    "method",
    "line_search",
    "camera_model",
    "runs",
    "converged",
    "mean_iterations",
    "mean_seconds",
}


def run(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    variables = {**os.environ, **environment}
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S, env=variables)


def without_seconds(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if "seconds" not in name} for row in rows]


@pytest.fixture(scope="module")
def convergence(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder and output of table 4.1 with two runs."""
    folder = tmp_path_factory.mktemp("experiment")
    result = run("table-4.1", "--runs", "2", "--out", folder)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout


def test_a_convergence_table_has_a_row_per_camera_model_and_method(convergence: tuple[Path, str]) -> None:
    content = strict_json(convergence[0] / "table-4.1.json")
    assert (content["name"], content["seed"]) == ("table-4.1", 0)
    labels = [(row["camera_model"], row["label"]) for row in content["rows"]]
    assert len(set(labels)) == len(labels) == 28
    for row in content["rows"]:
        assert row.keys() >= CONVERGENCE_FIELDS
        assert row["runs"] == 2
        assert 0 <= row["converged"] <= 2
        if row["converged"]:
            assert 0 < row["mean_iterations_to_minimum"] <= row["mean_iterations"] <= 100
            assert row["mean_iterations"] <= row["mean_cost_evaluations"]
            assert row["mean_seconds"] > 0
        else:
            assert row["mean_iterations"] is None


def test_the_figures_of_the_thesis_stand_beside_ours(convergence: tuple[Path, str]) -> None:
    folder, printed = convergence
    thesis = strict_json(folder / "table-4.1.json")["thesis"]
    assert [row["mean_iterations"] for row in thesis] == [21.3, 18.8, 18.3, 17.2, 18.6, 21.8, 22.8]
    (line,) = [line for line in printed.splitlines() if line.startswith("projective") and "LM+T-ALS" in line]
    assert {"18.3", "151.7"} <= set(line.split())


def test_the_picture_is_a_png_with_something_drawn(convergence: tuple[Path, str]) -> None:
    from matplotlib.image import imread

    path = convergence[0] / "table-4.1.png"
    assert path.read_bytes().startswith(PNG_SIGNATURE)
    image = imread(path)
    assert min(image.shape[:2]) > 300
    assert image[..., :3].std() > 0.05


def test_rows_repeat_but_for_seconds(convergence: tuple[Path, str], tmp_path: Path) -> None:
    assert run("table-4.1", "--runs", "2", "--out", tmp_path).returncode == 0
    first, second = (strict_json(folder / "table-4.1.json")["rows"] for folder in (convergence[0], tmp_path))
    assert without_seconds(first) == without_seconds(second)


def test_the_algebraic_minimum_is_near_the_true_one_at_the_first_step(tmp_path: Path) -> None:
    assert run("figure-4.1", "--out", tmp_path).returncode == 0
    rows = strict_json(tmp_path / "figure-4.1.json")["rows"]
    first = {row["camera_model"]: row for row in rows if row["iteration"] == 1}
    assert first.keys() == {"calibrated", "projective"}
    for row in first.values():
        assert row["algebraic"] == pytest.approx(row["geometric"], abs=0.2)
        assert row["cost_geometric"] <= row["cost_algebraic"] < row["cost_unit"] < 1


def test_an_unknown_name_is_refused_in_one_line(tmp_path: Path) -> None:
    result = run("table-9.9", "--out", tmp_path / "none")
    assert result.returncode == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert "'table-9.9'" in line
    assert "table-4.1" in line
    assert not (tmp_path / "none").exists()


def test_missing_real_data_is_refused_in_one_line(tmp_path: Path) -> None:
    result = run("table-4.7", "--out", tmp_path, SFMCPP_DATA=str(tmp_path / "nowhere"))
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert "nowhere" in line
    assert list(tmp_path.iterdir()) == []


def test_every_description_loads_and_is_listed() -> None:
    lines = [line.split() for line in run("--list").stdout.splitlines()]
    listed = [words[0] for words in lines if words[1] != "see"]
    described = {path.stem for path in (REPOSITORY / "bench" / "experiments").glob("*.toml")} - {"methods"}
    assert set(listed) == described
    figures, tables = (1, 2, 5, 6, 12, 14), range(1, 8)
    assert described >= {f"figure-4.{k}" for k in figures} | {f"table-4.{k}" for k in tables}
    others = {words[0]: words[2] for words in lines if words[1] == "see"}
    assert set(others.values()) <= described
    assert not set(others) & described
    assert others["figure-4.7"] == "table-4.2"
    figures, tables = (4, 5, 6, 7, 8, 21), (2, 3, 5, 6, 7, 9)
    assert described | set(others) >= {f"figure-5.{k}" for k in figures} | {f"table-5.{k}" for k in tables}
