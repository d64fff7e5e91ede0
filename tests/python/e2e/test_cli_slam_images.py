"""`sfmcpp slam` on images: a real clip is followed to its end, and what is missing beside images is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cli_helpers import is_one_error_line, run, run_here, strict_json
from sfmcpp import CheckpointFolder, slam
from sfmcpp.sources.io.trajectories import read_trajectory

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

from stereo_images import write_rectified  # noqa: E402

CLIP = "kitti_clip/image_l"
DRIVE = "kitti_tracks/2011_09_30_drive_0020_sync_KLT.mat"
CAMERA = "707.0912,601.8873,183.1104"


@pytest.mark.real
@pytest.mark.parametrize("corners", ["shi-tomasi", "harris"])
def test_every_image_of_a_real_clip_has_a_pose_near_its_true_one(
    tmp_path: Path, data_dir: Path, corners: str
) -> None:
    result = run("slam", data_dir / CLIP, "--corners", corners, "-o", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    content = strict_json(tmp_path / "report.json")
    assert (content["input"]["frames"], content["input"]["corners"]) == (51, corners)
    assert content["input"]["tracks"] > 1000
    assert 0 < content["seconds_tracking"] < content["seconds"]
    assert content["totals"]["frames"] == content["totals"]["poses"] == 51
    assert content["totals"]["lost"] == content["totals"]["bridged"] == 0
    np.testing.assert_allclose(read_trajectory(tmp_path / "trajectory.txt").t_s, 0.1 * np.arange(51))
    # The camera's scale is free: the first tenth gives it, and a fifth of a metre becomes 1 % at the end.
    truth = content["truth"]
    assert truth["truth_length_m"] == pytest.approx(59.86, abs=0.01)
    assert content["drift"]["mean_3d_error_m"] < 0.01 * truth["truth_length_m"]


@pytest.mark.real
def test_the_sensors_of_its_drive_make_a_real_clip_metric(tmp_path: Path, data_dir: Path) -> None:
    sensors = ("--sensor", "odometer", "--sensor", "imu", "--sensor-file", data_dir / DRIVE)
    result = run_here("slam", data_dir / CLIP, *sensors, "-o", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    content = strict_json(tmp_path / "report.json")
    assert content["totals"]["poses"] == 51
    found = read_trajectory(tmp_path / "trajectory.txt")
    np.testing.assert_array_equal(found.t_s, read_trajectory(data_dir / DRIVE).t_s[:51])
    truth = read_trajectory(data_dir / "kitti_clip/poses.txt")
    assert found.length_m == pytest.approx(truth.length_m, rel=0.05)
    assert content["truth"]["mean_3d_error_m"] < 0.005 * truth.length_m


@pytest.mark.real
def test_a_clip_goes_on_from_a_checkpoint_to_the_same_bytes(tmp_path: Path, data_dir: Path) -> None:
    whole, out, kept = tmp_path / "whole", tmp_path / "out", tmp_path / "kept"
    assert run_here("slam", data_dir / CLIP, "-o", whole, "--quiet").returncode == 0
    slam.run(data_dir / CLIP, callback=lambda frame, _: frame < 30, checkpoint=CheckpointFolder(kept))
    assert run_here("slam", data_dir / CLIP, "-o", out, "--quiet", "--resume", kept).returncode == 0
    for name in ("trajectory.txt", "model/points3D.bin", "model/images.bin"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.real
def test_a_video_is_followed_at_its_own_rate(tmp_path: Path, data_dir: Path) -> None:
    files = sorted((data_dir / CLIP).iterdir())[:12]
    writer = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 12.5, (1226, 370))
    for file in files:
        writer.write(cv2.imread(str(file)))
    writer.release()
    result = run_here("slam", tmp_path / "clip.avi", "--camera", CAMERA, "-o", tmp_path / "out")
    assert (result.returncode, result.stderr) == (0, "")
    found = read_trajectory(tmp_path / "out/trajectory.txt")
    np.testing.assert_allclose(found.t_s, np.arange(12) / 12.5)
    assert strict_json(tmp_path / "out/report.json")["truth"] is None


@pytest.mark.parametrize(
    ("file", "content", "options", "told"),
    [
        (None, "", [], "there is no calib.txt, K.txt or sensor.yaml beside it; give --camera"),
        (
            None,
            "",
            ["--camera", "90,32,24", "--stereo"],
            "no images of a right camera are beside it; give --right",
        ),
        (
            None,
            "",
            ["--camera", "90,32,24", "--right", "images"],
            "images: where its camera is beside the left",
        ),
        (
            None,
            "",
            ["--camera", "90,32,24", "--baseline", "1"],
            "no images of a right camera are beside it; give",
        ),
        (None, "", ["--camera", "90,32,24", "--right", "none"], "none: no such file or directory"),
        (None, "", ["--camera", "90,200,20"], "principal point (200, 20) lies outside of the images of 64"),
        ("K.txt", "90 0 32 0 90 24", [], "K.txt: holds 6 numbers: must be 9"),
        ("times.txt", "0\n0.1\n", ["--camera", "90,32,24"], "times.txt: holds 2 times for 3 images"),
        ("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n", ["--camera", "90,32,24"], "holds 1 poses for 3 images"),
    ],
)
def test_what_is_missing_or_wrong_beside_images_is_one_line(
    tmp_path: Path, file: str | None, content: str, options: list[str], told: str
) -> None:
    (tmp_path / "images").mkdir()
    for number in range(3):
        assert cv2.imwrite(str(tmp_path / f"images/{number}.png"), np.zeros((48, 64), np.uint8))
    if file is not None:
        (tmp_path / file).write_text(content)
    result = run_here("slam", "images", "-o", "out", *options, cwd=tmp_path)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert told in result.stderr
    assert not (tmp_path / "out").exists()


def test_images_without_texture_give_no_map_and_say_so(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    for number in range(3):
        assert cv2.imwrite(str(tmp_path / f"images/{number}.png"), np.zeros((48, 64), np.uint8))
    result = run_here("slam", "images", "--camera", "90,32,24", "-o", "out", cwd=tmp_path)
    assert result.returncode == 3
    assert is_one_error_line(result)
    assert "images: no map could be started" in result.stderr


@pytest.mark.real
def test_a_bad_image_is_left_out_and_named(tmp_path: Path, data_dir: Path) -> None:
    (tmp_path / "images").mkdir()
    for file in sorted((data_dir / CLIP).iterdir())[:16]:
        (tmp_path / "images" / file.name).write_bytes(
            b"no picture" if "05." in file.name else file.read_bytes()
        )
    out = tmp_path / "out"
    result = run_here("slam", tmp_path / "images", "--camera", CAMERA, "--fps", "10", "-o", out)
    assert result.returncode == 0
    warning = "1 image is left out, as if lost by the camera: 000005.png: is no image that can be decoded"
    content = strict_json(out / "report.json")
    assert any(warning in told for told in content["warnings"])
    assert (content["totals"]["frames"], content["totals"]["poses"]) == (15, 15)
    times = [0.1 * number for number in range(16) if number != 5]
    np.testing.assert_allclose(read_trajectory(out / "trajectory.txt").t_s, times)


def test_right_images_beside_make_metres(tmp_path: Path) -> None:
    poses = write_rectified(tmp_path, 6)
    result = run_here("slam", "image_0", "--stereo", "-o", "out", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    report = strict_json(tmp_path / "out/report.json")
    assert report["warnings"] == []
    used = report["input"]["right_images"]
    assert used["frames"] == 6
    assert 0 < used["corners"] <= report["input"]["tracks"]
    assert f"right images    used in 6 of 6 frames, {used['corners']:.0f} corners in each" in result.stdout
    found = read_trajectory(tmp_path / "out/trajectory.txt")
    true_m = np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1).sum()
    assert found.length_m == pytest.approx(true_m, rel=0.02)
