"""`sfmcpp synth`: every scene, every format, the same problem as from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, run, run_here
from sfmcpp import SCENES, add_outliers, circle_scene, perturb

SMALL = ["--cameras", "40", "--points", "900"]


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_is_written_as_python_makes_it(tmp_path: Path, scene: str) -> None:
    result = run_here("synth", scene, "-o", tmp_path / "scene.npz", *SMALL, "--seed", "3")
    assert (result.returncode, result.stderr) == (0, "")
    written, expected = sfmcpp.read(tmp_path / "scene.npz"), SCENES[scene](40, 900, seed=3)
    for array in ("cameras", "intrinsics", "points", "pixels", "camera_index", "point_index"):
        np.testing.assert_array_equal(getattr(written, array), getattr(expected, array))
    size = f"40 cameras, {expected.num_points} points, {expected.num_observations} observations"
    longest = np.bincount(expected.point_index).max()
    assert size in result.stdout
    assert result.stdout.endswith(f"at most {longest}\n")


@pytest.mark.parametrize("name", ["out.npz", "out.txt", "out.txt.gz", "out.out", "model", "40cams.txt"])
@pytest.mark.parametrize("camera_model", ["bal", "perspective"])
def test_every_format_holds_the_distorted_scene(tmp_path: Path, name: str, camera_model: str) -> None:
    options = ["--camera-model", camera_model, "--distortion=-0.1,0.02", "--pixel-sigma-px", "0.5"]
    result = run_here("synth", "circle", "-o", tmp_path / name, *SMALL, *options, "--quiet")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    expected = circle_scene(
        40, 900, camera_model=camera_model, distortion=(-0.1, 0.02), pixel_sigma_px=0.5, seed=0
    )
    written = sfmcpp.read(tmp_path / name)
    assert written.num_observations == expected.num_observations
    assert sfmcpp.cost(written) == pytest.approx(sfmcpp.cost(expected), rel=1e-6)


def test_the_start_is_the_truth_with_outliers_moved_away(tmp_path: Path) -> None:
    start, truth = tmp_path / "start.npz", tmp_path / "truth.npz"
    noise = ["--point-sigma-m", "0.3", "--position-sigma-m", "0.2", "--rotation-sigma-deg", "4"]
    options = ["--focal-px", "900", "--outliers", "0.1", "--seed", "7", "--truth", truth]
    assert run_here("synth", "circle", "-o", start, *SMALL, *noise, *options).returncode == 0
    exact = circle_scene(40, 900, focal_px=900.0, seed=7)
    expected, is_outlier = add_outliers(exact, 0.1, seed=7)
    moved = perturb(expected, point_sigma_m=0.3, position_sigma_m=0.2, rotation_sigma_deg=4.0, seed=7)
    for path, problem in ((truth, expected), (start, moved)):
        written = sfmcpp.read(path)
        for array in ("cameras", "intrinsics", "points", "pixels"):
            np.testing.assert_array_equal(getattr(written, array), getattr(problem, array))
    assert is_outlier.sum() == 3600


def test_a_solve_of_the_start_finds_back_to_the_cost_of_the_truth(tmp_path: Path) -> None:
    start, truth, solved = (tmp_path / name for name in ("start.txt", "truth.txt", "solved.txt"))
    noise = ["--point-sigma-m", "0.05", "--position-sigma-m", "0.05", "--rotation-sigma-deg", "0.3"]
    result = run_here("synth", "city-blocks", "-o", start, "--truth", truth, "--cameras", "40", *noise)
    assert result.returncode == 0
    assert run_here("solve", start, "-o", solved).returncode == 0
    problem = sfmcpp.read(solved)
    # The minimum lies below the truth by the share of the unknowns in the residuals.
    unknowns = 9 * problem.num_cameras + 3 * problem.num_points - 7
    freedom = 2 * problem.num_observations - unknowns
    assert 2 * sfmcpp.cost(sfmcpp.read(truth)) == pytest.approx(2 * problem.num_observations, rel=0.05)
    assert 2 * sfmcpp.cost(problem) == pytest.approx(freedom, abs=5 * np.sqrt(2 * freedom))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "SCENE"),
        (["circle"], "-o"),
        (["square", "-o", "a.npz"], "'square' is unknown; choose one of circle, sphere"),
        (["circle", "-o", "a.unknown"], "a.unknown: its name tells no format"),
        (["circle", "-o", "absent/a.npz"], "absent/a.npz: the folder 'absent' does not exist"),
        (["circle", "-o", "a.npz", "--truth", "absent/b.npz"], "absent/b.npz: the folder"),
        (["circle", "-o", "a.npz", "--truth", "./a.npz"], "is named twice"),
        (["circle", "-o", "a.npz", "--cameras", "0"], "--cameras 0: must be at least 1"),
        (["street-loop", "-o", "a.npz", "--cameras", "8"], "--cameras 8: no point is seen by two"),
        (["circle", "-o", "a.npz", "--cameras", "many"], "'--cameras': 'many'"),
        (["circle", "-o", "a.npz", "--points", "-1"], "--points -1"),
        (["circle", "-o", "a.npz", "--camera-model", "fisheye"], "--camera-model 'fisheye'"),
        (["circle", "-o", "a.npz", "--distortion", "0.1"], "'0.1' is not two numbers k1,k2"),
        (["circle", "-o", "a.npz", "--distortion", "a,b"], "'a,b' is not two numbers k1,k2"),
        (
            ["circle", "-o", "a.npz", "--camera-model", "bal", "--distortion", "1e300,1"],
            "distortion: |k1| = 1e+300: must be at most 1e+100",
        ),
        (["circle", "-o", "a.npz", "--point-sigma-m", "1e308"], "points[0, 0] is "),
        (["circle", "-o", "a.npz", "--distortion", "0.1,0"], "camera model 'calibrated' has none"),
        (["circle", "-o", "a.npz", "--outliers", "1.5"], "--outliers 1.5: must be"),
        (["circle", "-o", "a.npz", "--outliers", ".1", "--outlier-sigma-px", "-1"], "--outlier-sigma-px -1"),
        (["circle", "-o", "a.npz", "--outlier-sigma-px", "9"], "there are no --outliers"),
        (["circle", "-o", "a.npz", "--pixel-sigma-px", "-1"], "--pixel-sigma-px -1"),
        (["circle", "-o", "a.npz", "--point-sigma-m", "nan"], "--point-sigma-m nan"),
        (["circle", "-o", "a.npz", "--focal-px", "0"], "--focal-px 0"),
        (["circle", "-o", "a.npz", "--seed", "-1"], "-1"),
    ],
)
def test_bad_usage_is_one_line_and_nothing_is_written(
    tmp_path: Path, arguments: list[str], told: str
) -> None:
    result = run_here("synth", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_cameras_that_see_nothing_are_told(tmp_path: Path) -> None:
    few = ["--cameras", "10", "--points", "200", "--seed", "0"]
    result = run_here("synth", "street-loop", "-o", tmp_path / "scene.npz", *few)
    written = sfmcpp.read(tmp_path / "scene.npz")
    blind = 10 - len(np.unique(written.camera_index))
    assert blind > 0
    assert result.returncode == 0
    assert result.stderr == (
        f"sfmcpp: warning: {blind} of 10 cameras see no point that another one sees: they are too far apart, "
        "or the points too few; give more --cameras or --points\n"
    )


def test_the_shell_completes_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "_SFMCPP_COMPLETE": "complete_bash",
        "COMP_WORDS": "sfmcpp synth c",
        "COMP_CWORD": "2",
    }.items():
        monkeypatch.setenv(name, value)
    assert run().stdout.split() == ["circle", "corridor", "city-blocks"]
