"""Trajectories in TUM, KITTI and EuRoC files: read back the same, known by their columns, bad lines named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.sensors import SensorStream, travelled_distance
from sfmcpp.sources.io.kitti_mat import read_kitti_mat
from sfmcpp.sources.io.trajectories import read_trajectory, write_trajectory
from trajectory_helpers import path

NAMES = {"tum": "t.txt", "kitti": "t.txt", "euroc": "t.csv"}


@pytest.mark.parametrize("format", NAMES)
def test_what_is_written_reads_back_the_same(tmp_path: Path, format: str) -> None:
    truth, file = path(start_s=1317042145.968), tmp_path / NAMES[format]
    write_trajectory(truth, file, format=format)
    found = read_trajectory(file)
    np.testing.assert_array_equal(found.centres, truth.centres)
    np.testing.assert_allclose(found.rotations, truth.rotations, atol=1e-15)
    assert found.stamped == (format != "kitti")
    if found.stamped:
        np.testing.assert_allclose(found.t_s, truth.t_s, rtol=0, atol=3e-7 if format == "euroc" else 0)


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".xz"])
@pytest.mark.parametrize("format", ["tum", "kitti", "euroc"])
def test_what_is_written_is_compressed_as_its_name_says(tmp_path: Path, format: str, suffix: str) -> None:
    written, file = path(8, seed=2), tmp_path / f"t{'.csv' if format == 'euroc' else '.txt'}{suffix}"
    write_trajectory(written, file, format=format)
    np.testing.assert_allclose(read_trajectory(file).poses, written.poses, atol=1e-12)


@pytest.mark.parametrize("t_s", [[0.0, 1e-10], [0.0, 1.4e12]])
def test_times_that_whole_nanoseconds_cannot_hold_are_refused(tmp_path: Path, t_s: list[float]) -> None:
    written = Trajectory(np.array(t_s), np.tile(np.eye(3, 4), (2, 1, 1)))
    with pytest.raises(DatasetError, match=r"t_s\[1\] is .*: must be whole nanoseconds in 64 bits"):
        write_trajectory(written, tmp_path / "t.csv", format="euroc")
    assert not (tmp_path / "t.csv").exists()


def test_each_format_orders_the_quaternion_as_its_own_definition(tmp_path: Path) -> None:
    x, y, z, w = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_quat().tolist()
    expected = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    tum, euroc = tmp_path / "t.txt", tmp_path / "t.csv"
    tum.write_text(f"# t tx ty tz qx qy qz qw\n1.5 1 2 3 {x} {y} {z} {w}\n")
    euroc.write_text(f"#timestamp [ns],p,p,p,q,q,q,q,v,v,v\n1500000000,1,2,3,{w},{x},{y},{z},9,9,9\n")
    for file in (tum, euroc):
        found = read_trajectory(file)
        assert found.t_s[0] == pytest.approx(1.5)
        np.testing.assert_allclose(found.poses[0], np.column_stack([expected, [1, 2, 3]]), atol=1e-15)


def test_kitti_rows_may_be_3x4_or_4x4_or_numbered(tmp_path: Path) -> None:
    truth, file = path(4), tmp_path / "poses.txt"
    for numbered, bottom in [(False, ""), (False, " 0 0 0 1"), (True, " 0 0 0 1")]:
        rows = [" ".join(map(repr, pose.ravel().tolist())) + bottom for pose in truth.poses]
        file.write_text("\n".join(f"{7 * i} {row}" if numbered else row for i, row in enumerate(rows)))
        found = read_trajectory(file)
        assert not found.stamped
        np.testing.assert_allclose(found.poses, truth.poses, atol=1e-15)


def test_rotations_of_six_digits_become_rotations(tmp_path: Path) -> None:
    truth, file = path(5), tmp_path / "poses.txt"
    file.write_text("\n".join(" ".join(f"{v:.6e}" for v in pose.ravel()) for pose in truth.poses))
    np.testing.assert_allclose(read_trajectory(file).poses, truth.poses, atol=2e-5)


GOOD = "1 0 0 0 0 0 0 1"


@pytest.mark.parametrize(
    ("name", "lines", "line", "told"),
    [
        ("t.txt", [GOOD, "2 0 0 0 0 0 0"], 2, "holds 7 numbers: must be 8, as on the lines before"),
        ("t.txt", ["1 2 3"], 1, "hold 3 numbers: must be 8"),
        ("t.txt", [GOOD, "2 0 0 zero 0 0 0 1"], 2, "'zero' is not a finite number"),
        ("t.txt", [GOOD, "2 0 0 nan 0 0 0 1"], 2, "nan"),
        ("t.txt", [GOOD, "2 0 0 0 0 0 0 2"], 2, "quaternion has length 2: must be 1"),
        ("t.txt", [GOOD, "2 0 0 0 0 0 1e300 2"], 2, "quaternion has length inf: must be 1"),
        ("t.txt", ["# t", GOOD, "2 0 0 0 0 0 0 1", "2 0 0 0 0 0 0 1"], 4, "time 2 s: must be later"),
        ("t.txt", [GOOD, "0.5 0 0 0 0 0 0 1"], 2, r"time 0\.5 s: must be later"),
        ("t.txt", ["1 0 0 0 0 1 0 0 0 0 1 0", "1 0 0 0 0 1 0 0 0 0 -1 0"], 2, "no rotation"),
        ("t.txt", ["1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 2"], 1, "must be 0 0 0 1"),
        ("t.txt", [f"{k} 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" for k in (3, 5, 4)], 3, "frame 4: must increase"),
        ("t.csv", ["1,0,0,0,1,0,0"], 1, "holds 7 numbers: must be 8 or more"),
        ("t.txt", ["# nothing"], None, "holds no poses"),
        ("t.mat", ["1 2 3"], None, "not a MATLAB file"),
    ],
)
def test_a_bad_file_is_named_with_its_line(
    tmp_path: Path, name: str, lines: list[str], line: int | None, told: str
) -> None:
    file = tmp_path / name
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(DatasetError, match=told) as caught:
        read_trajectory(file)
    assert (caught.value.path, caught.value.line) == (str(file), line)


def test_a_format_asked_for_is_held_to(tmp_path: Path) -> None:
    file = tmp_path / "t.dat"
    file.write_text(GOOD)
    assert len(read_trajectory(file, format="tum")) == 1
    with pytest.raises(DatasetError, match="holds 8 numbers: must be 12, 16"):
        read_trajectory(file, format="kitti")
    with pytest.raises(InvalidArgument, match="format = 'ros': must be one of tum, kitti, euroc, mat"):
        read_trajectory(file, format="ros")
    with pytest.raises(InvalidArgument, match="format = 'mat': must be one of tum, kitti, euroc"):
        write_trajectory(path(), file, format="mat")


def test_poses_without_times_are_not_given_any(tmp_path: Path) -> None:
    poses = Trajectory(np.arange(3.0), path(3).poses, stamped=False)
    with pytest.raises(DatasetError, match="has no times: format tum needs them"):
        write_trajectory(poses, tmp_path / "t.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.real
def test_the_clip_is_as_long_as_the_odometer_of_its_drive_says(data_dir: Path) -> None:
    """The clip is frames 0 to 50 of the drive, whose sensors end 0.7 % off at best."""
    clip = read_trajectory(data_dir / "kitti_clip/poses.txt")
    drive = read_kitti_mat(data_dir / "kitti_tracks/2011_09_30_drive_0020_sync_KLT.mat")
    assert (len(clip), clip.stamped) == (51, False)
    forward = SensorStream(drive.velocity.t_s, drive.velocity.values[:, 0], "speed")
    driven = travelled_distance(forward, drive.t_s[0], drive.t_s[50])
    assert clip.length_m == pytest.approx(driven, rel=0.007)
