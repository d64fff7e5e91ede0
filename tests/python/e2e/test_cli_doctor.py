"""`sfmcpp doctor`: a ranked list, a report, a repaired file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, noisy_circle, run, run_here, strict_json, write_noisy_circle


def write_broken(folder: Path) -> Path:
    """The small scene with y up, and its last image the same as the first."""
    problem = noisy_circle()
    problem.pixels[:, 1] = 480 - problem.pixels[:, 1]
    first, last = (problem.camera_index == k for k in (0, 5))
    problem.pixels[last] = problem.pixels[first]
    sfmcpp.write(problem, folder / "broken.npz")
    return folder / "broken.npz"


def test_findings_are_listed_gravest_first_with_what_to_do(tmp_path: Path) -> None:
    result = run("doctor", write_broken(tmp_path))
    assert (result.returncode, result.stderr) == (0, "")
    text = result.stdout
    assert "6 cameras, 60 points, 360 observations: 1 error, 1 warning, 1 note" in text.splitlines()[0]
    places = [text.index(code) for code in ("mirrored-y", "duplicate-cameras", "gauge-freedoms")]
    assert places == sorted(places)
    assert text.count("→") == 3


def test_the_report_holds_what_python_finds(tmp_path: Path) -> None:
    path = write_broken(tmp_path)
    result = run_here("doctor", path, "--report", tmp_path / "report.json", "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    report = strict_json(tmp_path / "report.json")
    expected = sfmcpp.diagnose(sfmcpp.read(path))
    assert report["input"] == {"path": str(path), "cameras": 6, "points": 60, "observations": 360}
    assert [f["code"] for f in report["findings"]] == expected.codes
    assert (report["healthy"], report["repaired"]) == (False, None)


def test_a_repaired_file_is_healthy_and_says_what_was_done(tmp_path: Path) -> None:
    fixed = tmp_path / "fixed.npz"
    result = run_here("doctor", write_broken(tmp_path), "--fix", fixed)
    assert result.returncode == 0
    assert "mended   duplicate-cameras: 60 of 360 observations dropped" in result.stdout
    assert "mended   mirrored-y" in result.stdout
    assert sfmcpp.diagnose(sfmcpp.read(fixed)).is_healthy


def test_what_is_left_as_it_is_says_why(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(12, 150, seed=4)
    sfmcpp.write(problem, tmp_path / "sound.npz")
    rotations = problem.rotations.transpose(0, 2, 1).copy()
    problem.cameras[:, :, 3] = -np.einsum("nij,nj->ni", rotations, problem.centres)
    problem.cameras[:, :, :3] = rotations
    sfmcpp.write(problem, tmp_path / "inverse.npz")
    sound, inverse = (
        run_here("doctor", tmp_path / name, "--fix", tmp_path / "fixed.npz").stdout.splitlines()
        for name in ("sound.npz", "inverse.npz")
    )
    assert "mended   nothing" in sound
    assert "mended   nothing: no finding has a safe repair, follow their remedies" in inverse


def test_after_a_solve_variances_are_looked_at_too(tmp_path: Path) -> None:
    path = write_noisy_circle(tmp_path)
    assert "worst-cameras" not in run_here("doctor", path).stdout
    solved = run_here("doctor", path, "--solve")
    assert (solved.returncode, solved.stderr) == (0, "")
    assert "worst-cameras" in solved.stdout


@pytest.mark.parametrize(
    "arguments",
    [["missing.npz"], ["start.npz", "--fix", "no/folder/out.npz"], ["start.npz", "--report", "start.npz"]],
)
def test_what_cannot_be_read_or_written_is_one_line(tmp_path: Path, arguments: list[str]) -> None:
    write_noisy_circle(tmp_path)
    result = run_here("doctor", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)


def test_a_repaired_file_has_no_points_that_have_lost_all_observations(tmp_path: Path) -> None:
    problem = sfmcpp.perturb(sfmcpp.circle_scene(8, 100, seed=2), point_sigma_m=0.05, seed=2)
    few = np.flatnonzero(problem.point_index == 4)
    problem = problem.with_observations(np.delete(np.arange(problem.num_observations), few[2:]))
    problem.pixels[problem.point_index == 4] += [[300, -200], [-250, 300]]
    sfmcpp.write(problem, tmp_path / "wrong.npz")
    run_here("doctor", tmp_path / "wrong.npz", "--fix", tmp_path / "fixed.npz")
    fixed = sfmcpp.read(tmp_path / "fixed.npz")
    assert fixed.num_points == np.unique(fixed.point_index).size < problem.num_points
