"""`sfmcpp bag`: the command it prints runs as it is, and gives what the files that went into a bag give."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from bag_writing import START_NS, Messages, messages_for, write_bag
from cli_helpers import is_one_error_line, run_here, strict_json
from sfmcpp.sources.cameras import read_intrinsics
from sfmcpp.sources.io.kitti_mat import read_kitti_mat

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

CLIP = "kitti_clip/image_l"
CALIBRATION = "kitti_clip/calib.txt"
DRIVE = "kitti_tracks/2011_09_30_drive_0020_sync_KLT.mat"
# body_from_camera of a camera that looks ahead, as wxyz.
LOOKING_AHEAD = (0.5, -0.5, 0.5, -0.5)


def small_bag(folder: Path, **imu: Any) -> Path:
    made = messages_for("bag")
    recorded = [("/imu/data", made.imu(START_NS + k * 10**7, (0, 0, 0.1), **imu)) for k in range(3)]
    return write_bag(folder / "drive.bag", made, recorded)


def clip_with_odometer(
    messages: Messages, data_dir: Path
) -> tuple[list[tuple[str, Any]], dict[int, Path], dict[int, Sequence[float]]]:
    """Messages of a real clip, and what went into them: files and velocities by their times [ns]."""
    drive = read_kitti_mat(data_dir / DRIVE)
    files = sorted((data_dir / CLIP).iterdir())
    times = [round(t * 1e6) * 1000 for t in drive.t_s]
    f, aspect, cx, cy, skew = read_intrinsics(data_dir / CALIBRATION)
    matrix = [[f, skew, cx], [0, aspect * f, cy], [0, 0, 1]]
    images = dict(zip(times, files, strict=False))
    recorded: list[tuple[str, Any]] = [("/cam/camera_info", messages.camera_info(times[0], matrix))]
    for t, file in images.items():
        pixels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        recorded.append(("/cam/image_raw", messages.image(t, pixels)))
    velocities = dict(zip(times, drive.velocity.values.tolist(), strict=False))
    recorded += [("/odom", messages.odometry(t, values)) for t, values in velocities.items()]
    return recorded, images, velocities


@pytest.fixture(scope="module")
def without_bag(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of SLAM on what goes into the bags of the clip."""
    direct = tmp_path_factory.mktemp("direct")
    _, images, velocities = clip_with_odometer(messages_for("bag"), data_dir)
    (direct / "images").mkdir()
    for t, file in images.items():
        (direct / "images" / f"{t}{file.suffix}").symlink_to(file)
    rows = [f"{t},{','.join(map(repr, values))}\n" for t, values in velocities.items()]
    (direct / "speeds.csv").write_text("".join(["t [ns],vx [m/s],vy [m/s],vz [m/s]\n", *rows]))
    given = ("--sensor-file", direct / "speeds.csv", "--camera", data_dir / CALIBRATION)
    options = ("--sensor", "odometer", "--mounting", "forward", *given, "-o", direct / "slam", "--quiet")
    assert run_here("slam", direct / "images", *options).returncode == 0
    return direct / "slam"


@pytest.mark.real
@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_slam_on_a_bag_is_slam_on_what_went_into_it(
    tmp_path: Path, data_dir: Path, without_bag: Path, kind: str
) -> None:
    messages = messages_for(kind)
    recorded, _, _ = clip_with_odometer(messages, data_dir)
    path = write_bag(tmp_path / f"drive.{kind}", messages, recorded)
    made = run_here("bag", path, "-o", tmp_path / "files")
    assert made.returncode == 0
    command = shlex.split(made.stdout.splitlines()[-1])
    assert command[:2] == ["sfmcpp", "slam"]
    assert run_here(*command[1:], "--quiet").returncode == 0
    for name in ("trajectory.txt", "model/points3D.bin"):
        assert (tmp_path / "files/slam" / name).read_bytes() == (without_bag / name).read_bytes(), name


@pytest.mark.real
def test_static_transforms_make_a_clip_metric_without_a_word(tmp_path: Path, data_dir: Path) -> None:
    messages = messages_for("mcap")
    recorded, _, _ = clip_with_odometer(messages, data_dir)
    # 'base_link' is what the velocities are of; where the camera sits on it is not told exactly.
    static = messages.transforms(("base_link", "cam", LOOKING_AHEAD, (1.0, 0.3, 1.0)))
    made = run_here(
        *("bag", write_bag(tmp_path / "drive.mcap", messages, [("/tf_static", static), *recorded])),
        *("-o", tmp_path / "files"),
    )
    assert (made.returncode, made.stderr) == (0, "")
    command = shlex.split(made.stdout.splitlines()[-1])
    (tmp_path / "files/poses.txt").write_bytes((data_dir / "kitti_clip/poses.txt").read_bytes())
    assert run_here(*command[1:], "--quiet").returncode == 0
    truth = strict_json(tmp_path / "files/slam/report.json")["truth"]
    assert truth["mean_3d_error_m"] < 0.01 * truth["truth_length_m"]


def test_topics_are_listed_with_what_is_read_of_them(tmp_path: Path) -> None:
    result = run_here("bag", small_bag(tmp_path))
    assert (result.returncode, result.stderr) == (0, "")
    head, *_, columns, row, _, hint = result.stdout.splitlines()
    assert head.endswith("drive.bag: bag of ROS 1, 0.0 s, 3 messages")
    assert columns.split() == ["topic", "type", "messages", "rate", "[Hz]", "read", "as"]
    assert row.split() == ["/imu/data", "sensor_msgs/Imu", "3", "100.0", "imu"]
    assert hint.startswith("sfmcpp bag ")


def test_a_guessed_mounting_is_told(tmp_path: Path) -> None:
    result = run_here("bag", small_bag(tmp_path), "-o", tmp_path / "out")
    assert result.returncode == 0
    assert "--mounting forward is a guess" in result.stderr
    assert "slam IMAGES --camera FILE --sensor imu" in result.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--topic", "/imu/data"), "give their folder with --output"),
        (("-o", "out", "--topic", "/none"), "holds no topic '/none': it holds /imu/data"),
        (("-o", "no/out"), "does not exist"),
        (("-o", "drive.bag"), "is a file, a folder is wanted"),
    ],
)
def test_what_cannot_be_done_is_told_in_one_line(tmp_path: Path, options: tuple[str, ...], told: str) -> None:
    small_bag(tmp_path)
    result = run_here("bag", "drive.bag", *options, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["drive.bag"]


def test_a_damaged_bag_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "drive.bag").write_bytes(small_bag(tmp_path).read_bytes()[:-50])
    result = run_here("bag", "drive.bag", "-o", "out", cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert result.stderr.startswith("sfmcpp: error: drive.bag: is damaged")
    assert [file.name for file in tmp_path.iterdir()] == ["drive.bag"]
