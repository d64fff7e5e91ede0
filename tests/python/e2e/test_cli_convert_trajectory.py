"""`sfmcpp convert --format tum|kitti|euroc`: trajectories of one another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sfmcpp
from cli_helpers import is_one_error_line, run_here, write_noisy_circle
from sfmcpp.model import Trajectory
from sfmcpp.sources.io.trajectories import read_trajectory, write_trajectory


def winding() -> Trajectory:
    t_s = 1317042145.25 + np.arange(30) / 8
    rotations = Rotation.from_rotvec(np.linspace([0, 0, 0], [0.3, -0.8, 2.0], 30)).as_matrix()
    centres = np.linspace([0, 0, 0], [10.0, -3, 40], 30)
    return Trajectory(t_s, np.concatenate([rotations, centres[:, :, None]], axis=2))


@pytest.fixture
def tum(tmp_path: Path) -> Path:
    write_trajectory(winding(), tmp_path / "trajectory.txt")
    return tmp_path / "trajectory.txt"


def test_a_way_round_all_formats_ends_where_it_began(tmp_path: Path, tum: Path) -> None:
    (tmp_path / "times.txt").write_text("".join(f"{t:.9f}\n" for t in winding().t_s))
    way = [(tum, "a.csv", "euroc"), ("a.csv", "b.txt", "kitti"), ("b.txt", "c.txt", "tum")]
    for source, target, format in way:
        times = ["--times", "times.txt"] if source == "b.txt" else []
        result = run_here("convert", source, target, "--format", format, *times, cwd=tmp_path)
        assert (result.returncode, result.stderr) == (0, "")
        assert f"{target}: 30 poses ({format})" in result.stdout
    found = read_trajectory(tmp_path / "c.txt")
    np.testing.assert_allclose(found.poses, winding().poses, atol=1e-9)
    np.testing.assert_allclose(found.t_s, winding().t_s, rtol=0, atol=1e-6)
    assert len((tmp_path / "b.txt").read_text().split("\n")[0].split()) == 12


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ["kitti.txt", "out.txt", "--format", "tum"],
            "kitti.txt: has no times, which tum needs: --times FILE",
        ),
        (
            ["kitti.txt", "out.txt", "--format", "tum", "--times", "short.txt"],
            "short.txt: holds 2 times for 30 poses: must be as many",
        ),
        (
            ["trajectory.txt", "out.csv", "--format", "euroc", "--times", "short.txt"],
            "trajectory.txt: has times of its own",
        ),
        (["trajectory.txt", "out.txt"], "trajectory.txt: is a trajectory of 30 poses: --format says"),
        (["trajectory.txt", "out.csv"], "trajectory.txt: is a trajectory of 30 poses: --format says"),
        (["start.npz", "out.txt", "--times", "short.txt"], "--times: for trajectories"),
        (["trajectory.txt", "no/out.txt", "--format", "kitti"], "the folder 'no' does not exist"),
    ],
)
def test_what_cannot_be_converted_is_told(tmp_path: Path, tum: Path, arguments: list[str], told: str) -> None:
    write_trajectory(winding(), tmp_path / "kitti.txt", format="kitti")
    write_noisy_circle(tmp_path)
    (tmp_path / "short.txt").write_text("0\n1\n")
    result = run_here("convert", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert not (tmp_path / "out.txt").exists()


@pytest.mark.parametrize("model", ["start.npz", "start.out", "model"])
def test_the_poses_of_a_problem_are_a_trajectory(tmp_path: Path, model: str) -> None:
    write_noisy_circle(tmp_path)
    start = sfmcpp.read(tmp_path / "start.npz")
    sfmcpp.write(start, tmp_path / model)
    poses = sfmcpp.read(tmp_path / model).cameras
    count = start.num_cameras
    (tmp_path / "times.txt").write_text("".join(f"{k / 8}\n" for k in range(count)))
    for format, how in (("kitti", ()), ("tum", ("--times", "times.txt"))):
        result = run_here("convert", model, "out.txt", "--format", format, *how, cwd=tmp_path)
        assert (result.returncode, result.stdout) == (0, f"out.txt: {count} poses ({format})\n")
        np.testing.assert_allclose(read_trajectory(tmp_path / "out.txt").poses, poses, atol=1e-9)
    result = run_here("convert", model, "out.txt", "--format", "tum", cwd=tmp_path)
    assert f"{model}: has no times, which tum needs: --times FILE" in result.stderr


def test_projective_cameras_have_no_trajectory(tmp_path: Path) -> None:
    sfmcpp.write(sfmcpp.as_projective(sfmcpp.circle_scene(3, 20, seed=0)), tmp_path / "p.npz")
    result = run_here("convert", "p.npz", "out.txt", "--format", "kitti", cwd=tmp_path)
    assert result.returncode == 2
    assert "p.npz: its 3 projective cameras have no poses" in result.stderr


def test_the_file_of_times_is_not_replaced(tmp_path: Path) -> None:
    write_trajectory(winding(), tmp_path / "kitti.txt", format="kitti")
    times = "".join(f"{t:.9f}\n" for t in winding().t_s)
    (tmp_path / "times.txt").write_text(times)
    how = ("--format", "tum", "--times", "./times.txt")
    result = run_here("convert", "kitti.txt", "times.txt", *how, cwd=tmp_path)
    assert (result.returncode, (tmp_path / "times.txt").read_text() == times) == (2, True)
    assert "times.txt: is named twice" in result.stderr
