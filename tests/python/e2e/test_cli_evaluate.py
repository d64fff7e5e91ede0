"""`sfmcpp evaluate`: the table, the report and the picture, and one line for what cannot be measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cli_helpers import is_one_error_line, run, run_here, strict_json
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Trajectory
from sfmcpp.sources.io.trajectories import write_trajectory

PNG = b"\x89PNG\r\n\x1a\n"


def helix(count: int = 50) -> Trajectory:
    """A path of known length: a helix, the camera always looking the same way."""
    angle = 0.1 * np.arange(count)
    poses = np.tile(np.eye(3, 4), (count, 1, 1))
    poses[:, :, 3] = np.stack([10 * np.cos(angle), 10 * np.sin(angle), 0.5 * angle], axis=1)
    return Trajectory(10.0 + angle, poses)


def lifted(truth: Trajectory, height_m: float) -> Trajectory:
    """The same path with every second pose too high."""
    poses = truth.poses.copy()
    poses[::2, 2, 3] += height_m
    return truth.with_poses(poses)


def write_pair(folder: Path, estimate: Trajectory) -> tuple[Path, Path]:
    files = folder / "estimate.txt", folder / "truth.csv"
    write_trajectory(estimate, files[0])
    write_trajectory(helix(), files[1], format="euroc")
    return files


def test_a_known_error_is_told_on_screen_and_in_the_report(tmp_path: Path) -> None:
    estimate, truth = write_pair(tmp_path, lifted(helix(), 0.5))
    report, picture = tmp_path / "report.json", tmp_path / "errors.png"
    result = run(
        "evaluate", estimate, "--truth", truth, "--align", "none", "--report", report, "--plot", picture
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "mean 3-D error  0.25 m" in result.stdout
    content = strict_json(report)
    assert content["input"] == {"path": str(estimate), "truth": str(truth)}
    assert content["matched_poses"] == 50
    assert content["mean_3d_error_m"] == pytest.approx(0.25)
    assert content["ape"]["translation_part"]["rmse"] == pytest.approx(0.5 / np.sqrt(2))
    assert content["rpe"]["translation_part"]["mean"] == pytest.approx(0.5)
    assert content["rpe"]["rotation_angle_deg"]["max"] == pytest.approx(0.0, abs=1e-9)
    assert picture.read_bytes().startswith(PNG)


def test_poses_that_nothing_is_compared_with_are_counted_in_a_warning(tmp_path: Path) -> None:
    there = helix()
    late = Trajectory(there.t_s + np.where(np.arange(50) % 5 == 0, 0.0, 0.04), there.poses)
    estimate, truth = write_pair(tmp_path, late)
    told = "warning         only 10 poses are matched, of 49 estimated and 50 true ones"
    assert told in run_here("evaluate", estimate, "--truth", truth).stdout
    assert "warning" not in run_here("evaluate", estimate, "--truth", truth, "--match", "interpolate").stdout


def test_a_path_at_another_scale_is_aligned_unless_told_not_to(tmp_path: Path) -> None:
    away = Similarity(0.25, np.eye(3)[[1, 2, 0]], np.array([3.0, 4.0, 5.0]))
    truth = helix()
    files = write_pair(tmp_path, truth.with_poses(away.apply_to_poses(truth.poses)))
    report = tmp_path / "report.json"
    command = ("evaluate", files[0], "--truth", files[1], "--report", report, "--quiet")
    result = run_here(*command, "--align", "first:0.4")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    content = strict_json(report)
    assert content["alignment"]["scale"] == pytest.approx(4.0)
    assert content["alignment"]["pairs"] == 20
    assert content["mean_3d_error_m"] == pytest.approx(0.0, abs=1e-9)
    assert run_here(*command, "--no-scale").returncode == 0
    content = strict_json(report)
    assert content["alignment"]["scale"] == 1.0
    assert content["scale_ratio"]["mean"] == pytest.approx(0.25)


def test_a_straight_start_is_warned_of(tmp_path: Path) -> None:
    estimate, truth = write_pair(tmp_path, lifted(helix(), 1e-3))
    result = run_here("evaluate", estimate, "--truth", truth, "--align", "first:3")
    assert result.returncode == 0
    assert "warning" in result.stdout
    assert "hardly determined" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["evaluate", "t.txt"], "--truth"),
        (["evaluate", "t.txt", "--truth", "x.txt", "--align", "most"], "--align 'most': must be all, none"),
        (["evaluate", "t.txt", "--truth", "x.txt", "--match", "far"], "'far' is unknown"),
        (["evaluate", "t.txt", "--truth", "x.txt", "--format", "ros"], "'ros' is unknown; choose one of tum"),
        (["evaluate", "t.txt", "--truth", "x.txt"], "t.txt: no such file"),
    ],
)
def test_bad_usage_is_one_line(arguments: list[str], told: str, tmp_path: Path) -> None:
    result = run_here(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr


def test_what_cannot_be_compared_is_named_and_writes_nothing(tmp_path: Path) -> None:
    late = helix()
    estimate, truth = write_pair(tmp_path, Trajectory(late.t_s + 1000, late.poses))
    result = run_here("evaluate", estimate, "--truth", truth, "--report", tmp_path / "report.json")
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{estimate}: compared with {truth}: truth: no pose within 0.01 s" in result.stderr
    assert not (tmp_path / "report.json").exists()


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--max-difference-s", "-1", "--max-difference-s -1.0: must be finite and not negative"),
        ("--delta", "1.5", "--delta 1.5 frames: must be a whole number"),
        ("--delta", "0", "--delta 0.0: must be"),
    ],
)
def test_options_are_named_as_they_were_given(tmp_path: Path, option: str, value: str, told: str) -> None:
    estimate, truth = write_pair(tmp_path, helix())
    result = run_here("evaluate", estimate, "--truth", truth, option, value)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert f"{estimate}: compared with {truth}: {told}" in result.stderr


def test_neither_input_is_overwritten_by_the_report(tmp_path: Path) -> None:
    estimate, truth = write_pair(tmp_path, helix())
    for file in (estimate, truth):
        before = file.read_bytes()
        result = run_here("evaluate", estimate, "--truth", truth, "--report", file)
        assert result.returncode == 2
        assert is_one_error_line(result)
        assert file.read_bytes() == before


@pytest.mark.real
def test_the_truth_of_a_drive_agrees_with_itself_in_another_format(tmp_path: Path, data_dir: Path) -> None:
    from sfmcpp.sources.io.trajectories import read_trajectory

    drive = data_dir / "kitti_tracks/2011_09_26_drive_0005_sync_KLT.mat"
    write_trajectory(read_trajectory(drive), tmp_path / "copy.txt")
    report = tmp_path / "report.json"
    result = run_here(
        "evaluate", tmp_path / "copy.txt", "--truth", drive, "--align", "none", "--report", report
    )
    assert result.returncode == 0
    assert strict_json(report)["matched_poses"] == 154
    assert strict_json(report)["mean_3d_error_m"] == pytest.approx(0.0, abs=1e-9)
