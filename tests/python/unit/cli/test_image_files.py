"""The camera and the times of images, from the files beside them or from the user, the nearest first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.cli.camera_files import find_intrinsics, read_intrinsics
from sfmcpp.cli.slam_images import read_images
from sfmcpp.cli.slam_job import ImageOptions
from sfmcpp.errors import DatasetError

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

ROW = "700 0 600 {} 0 770 180 0 0 0 1 0"
CAMERA = ImageOptions(intrinsics=(90.0, 1.0, 32.0, 24.0, 0.0))


def write_images(folder: Path, count: int = 3) -> Path:
    folder.mkdir()
    for number in range(count):
        assert cv2.imwrite(str(folder / f"{number}.png"), np.zeros((48, 64), np.uint8))
    return folder


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("calib.txt", f"{ROW.format(0)}\n{ROW.format(-379.8)}", (700, 1.1, 600, 180, 0)),
        ("calib.txt", f"P0: {ROW.format(0)}\nTr: 0 0 0 0 0 0 0 0 0 0 0 0\n", (700, 1.1, 600, 180, 0)),
        ("calib.txt", f"calib_time: 09-Jan-2012\nS_rect_00: 1 2\nP_rect_00: {ROW.format(0)}\n",
         (700, 1.1, 600, 180, 0)),
        ("K.txt", "700 0.5 600\n0 770 180\n0 0 1", (700, 1.1, 600, 180, 0.5)),
        ("K.txt", "# a camera\n7e2, 0, 600\n0, 770, 180\n0, 0, 1\n", (700, 1.1, 600, 180, 0)),
    ],
)  # fmt: skip
def test_a_camera_is_read_in_the_forms_in_which_data_sets_give_it(
    tmp_path: Path, name: str, content: str, expected: tuple[float, ...]
) -> None:
    (tmp_path / name).write_text(content)
    np.testing.assert_allclose(read_intrinsics(tmp_path / name), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("calib.txt", "Tr: 1 2 3", "holds no row of 12 numbers"),
        ("calib.txt", f"P0: {ROW.format(0)}\nP2: 9{ROW.format(0)}", "its cameras differ"),
        ("calib.txt", ROW.format(0).replace("770", "-770"), "fu and fv positive"),
        ("K.txt", "700 0 600 0 770 180 0 0 2", "must be"),
        ("K.txt", "700 0 x 0 770 180 0 0 1", "K.txt:1: 'x' is not a finite number"),
    ],
)
def test_a_file_without_one_camera_is_refused(tmp_path: Path, name: str, content: str, told: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DatasetError) as caught:
        read_intrinsics(tmp_path / name)
    assert told in str(caught.value)


def test_the_camera_nearest_to_the_images_counts(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    (tmp_path / "calib.txt").write_text(ROW.format(0))
    assert find_intrinsics(images)[0] == 700
    assert find_intrinsics(tmp_path / "video.mp4")[0] == 700
    (images / "K.txt").write_text("500 0 32 0 500 24 0 0 1")
    assert find_intrinsics(images)[0] == 500


def test_times_come_from_the_user_then_the_sensors_then_the_file_then_a_tenth_of_a_second(
    tmp_path: Path,
) -> None:
    images, stamps = write_images(tmp_path / "images"), np.array([50.0, 50.2, 50.3, 50.5])
    np.testing.assert_allclose(read_images(images, CAMERA)[0].t_s, [0, 0.1, 0.2])
    (tmp_path / "times.txt").write_text("7\n7.5\n9\n")
    np.testing.assert_array_equal(read_images(images, CAMERA)[0].t_s, [7, 7.5, 9])
    np.testing.assert_array_equal(read_images(images, CAMERA, stamps)[0].t_s, [50, 50.2, 50.3])
    twice = ImageOptions(CAMERA.intrinsics, fps=2.0)
    np.testing.assert_array_equal(read_images(images, twice, stamps)[0].t_s, [50, 50.5, 51])
    np.testing.assert_array_equal(read_images(images, twice)[0].t_s, [0, 0.5, 1])


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("1\n2\n2\n", "times.txt:3: time 2 s: must be later than the one before"),
        ("1 2 3\n", "must be 1, the time of an image"),
    ],
)
def test_times_that_cannot_be_are_refused(tmp_path: Path, content: str, told: str) -> None:
    (tmp_path / "times.txt").write_text(content)
    with pytest.raises(DatasetError, match=told):
        read_images(write_images(tmp_path / "images"), CAMERA)


def test_a_drive_shorter_than_the_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="3 images for 2 stamps of the sensors' drive: give --fps"):
        read_images(write_images(tmp_path / "images"), CAMERA, np.array([0.0, 0.1]))


def test_true_poses_beside_the_images_get_their_times(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    assert read_images(images, CAMERA)[1] is None
    (tmp_path / "poses.txt").write_text("".join(f"1 0 0 {k} 0 1 0 0 0 0 1 0\n" for k in range(3)))
    _, truth = read_images(images, CAMERA)
    assert truth is not None
    np.testing.assert_allclose(truth.t_s, [0, 0.1, 0.2])
    np.testing.assert_array_equal(truth.centres[:, 0], [0, 1, 2])
