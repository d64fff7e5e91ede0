"""`sfmcpp evaluate` on models: the table, the report, the picture, and what cannot be compared."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, run, run_here, strict_json
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.sources.synthetic import circle_scene

PNG = b"\x89PNG\r\n\x1a\n"
AWAY = Similarity(0.25, np.eye(3)[[1, 2, 0]], np.array([3.0, 4.0, 5.0]))


def scene(template: str = "{:04d}.jpg") -> sfmcpp.Problem:
    problem = circle_scene(8, 40, camera_model="perspective", seed=3)
    problem.metadata.image_names = [template.format(i) for i in range(8)]
    return problem


def write_strecha(problem: sfmcpp.Problem, folder: Path) -> Path:
    folder.mkdir()
    for name, pose in zip(problem.metadata.image_names, problem.cameras, strict=True):
        rows = ["900 0 320", "0 900 240", "0 0 1", "0 0 0"]
        rows += [" ".join(map(repr, row)) for row in pose[:, :3].tolist()]
        rows += [" ".join(map(repr, pose[:, 3].tolist())), "640 480"]
        (folder / f"{name}.camera").write_text("\n".join(rows) + "\n")
    return folder


def write_run(problem: sfmcpp.Problem, folder: Path) -> Path:
    """What `sfmcpp reconstruct` leaves behind, as far as this command looks at it."""
    folder.mkdir()
    moved = problem.copy()
    moved.cameras[:] = AWAY.apply_to_poses(moved.cameras)
    moved.points[:] = AWAY.apply(moved.points)
    sfmcpp.write(moved, folder / "model")
    names = {name: {"registered": True, "reason": ""} for name in problem.metadata.image_names}
    (folder / "report.json").write_text(json.dumps({"images": names}))
    return folder


def test_a_run_is_measured_on_screen_in_the_report_and_in_the_picture(tmp_path: Path) -> None:
    ours, truth = scene(), write_strecha(scene(), tmp_path / "truth")
    ours.cameras[5, :, 3] += [0.3, 0.0, 0.4]
    model = write_run(ours, tmp_path / "run")
    report, picture = tmp_path / "report.json", tmp_path / "errors.png"
    command = ("evaluate", model, "--truth", truth, "--align", "robust")
    result = run(*command, "--report", report, "--plot", picture)
    assert (result.returncode, result.stderr) == (0, "")
    assert "registered      8 of 8, matched by name" in result.stdout
    assert "outliers        1: 0005.jpg" in result.stdout
    assert "scale 4" in result.stdout
    content = strict_json(report)
    assert content["input"] == {"path": str(model), "truth": str(truth)}
    assert content["images"]["registered"] == 8
    assert content["per_image"]["0005.jpg"]["centre_error"] == pytest.approx(0.5)
    assert content["centre_error"]["median"] == pytest.approx(0, abs=1e-9)
    assert set(content["auc"]) == {"1", "3", "5", "10"}
    assert picture.read_bytes().startswith(PNG)
    assert run_here(*command, "--quiet").stdout == ""


def test_a_colmap_model_and_a_trajectory_are_truths_too(tmp_path: Path) -> None:
    problem = scene()
    model = write_run(problem, tmp_path / "run")
    sfmcpp.write(problem, tmp_path / "truth")
    rows = [" ".join(map(repr, pose.ravel().tolist())) for pose in problem.cameras]
    (tmp_path / "poses.txt").write_text("\n".join(rows))
    for truth in ("truth", "poses.txt"):
        result = run_here(
            "evaluate", model / "model", "--truth", tmp_path / truth, "--report", tmp_path / "r.json"
        )
        assert result.returncode == 0
        assert strict_json(tmp_path / "r.json")["centre_error"]["max"] == pytest.approx(0, abs=1e-9)


def refused(*arguments: str | Path) -> str:
    result = run_here("evaluate", *arguments)
    assert result.returncode == 2
    assert is_one_error_line(result)
    return result.stderr


def test_what_cannot_be_compared_is_one_line(tmp_path: Path) -> None:
    model, truth = write_run(scene(), tmp_path / "run"), write_strecha(scene("{}.png"), tmp_path / "truth")
    told = refused(model, "--truth", write_strecha(scene("other_{}.png"), tmp_path / "others"))
    assert f"{model}: compared with {tmp_path / 'others'}: truth: no image of the model is in it" in told
    assert "'0000.jpg'" in told
    assert "'other_0.png'" in told
    assert "is a folder without a model" in refused(tmp_path, "--truth", truth)
    assert "must be one of all, robust, none for a model" in refused(
        model, "--truth", truth, "--align", "first:3"
    )
    assert "--delta is for trajectories" in refused(model, "--truth", truth, "--delta", "2")
    (tmp_path / "path.txt").write_text("0 0 0 0 0 0 0 1\n")
    assert "is taken for a trajectory, but the truth" in refused(tmp_path / "path.txt", "--truth", truth)
    assert "no such file" in refused(tmp_path / "nothing", "--truth", truth)
    (model / "trajectory.txt").touch()
    (tmp_path / "times.txt").write_text("".join(f"{1.5e9 + k} 0 0 {k} 0 0 0 1\n" for k in range(9)))
    told = refused(model, "--truth", tmp_path / "times.txt")
    assert f"; did you mean {model / 'trajectory.txt'}?" in told
    assert "no such file" in refused(model, "--truth", tmp_path / "nothing")


def test_the_report_of_the_run_is_not_overwritten(tmp_path: Path) -> None:
    model, truth = write_run(scene(), tmp_path / "run"), write_strecha(scene(), tmp_path / "truth")
    before = (model / "report.json").read_bytes()
    assert "is named twice" in refused(model, "--truth", truth, "--report", model / "report.json")
    assert (model / "report.json").read_bytes() == before
