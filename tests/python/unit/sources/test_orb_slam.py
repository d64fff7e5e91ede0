"""Settings of ORB-SLAM tell a camera, and the pair of a stereo camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.geometry.so3 import rotation_from_angle_axis
from sfmcpp.sources.cameras import read_camera, read_intrinsics
from sfmcpp.sources.stereo_pair import StereoPair, stereo_pair

pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")

# As in ORB-SLAM2's KITTI00-02.yaml.
RECTIFIED = """%YAML:1.0
Camera.fx: 718.856
Camera.fy: 718.856
Camera.cx: 607.1928
Camera.cy: 185.2157
Camera.k1: 0.0
Camera.width: 1241
Camera.height: 376
Camera.bf: 386.1448
"""
POSE = np.column_stack(
    [rotation_from_angle_axis(np.array([[0.01, -0.02, 0.005]]))[0], [0.11, 0.0004, -0.0008]]
)
# As in ORB-SLAM3's EuRoC.yaml, of images as taken.
AS_TAKEN = """%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 458.654
Camera1.fy: 457.296
Camera1.cx: 367.215
Camera1.cy: 248.375
Camera1.k1: -0.28
Camera1.k2: 0.07
Camera1.p1: 0.0002
Camera1.p2: 1.8e-05
Camera2.fx: 457.587
Camera2.fy: 456.134
Camera2.cx: 379.999
Camera2.cy: 255.238
Camera2.k1: -0.27
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [POSE]
"""
AS_TAKEN = AS_TAKEN.replace("POSE", ", ".join(f"{x:.9f}" for x in np.vstack([POSE, [0, 0, 0, 1]]).ravel()))


def settings(place: Path, text: str) -> Path:
    (place / "settings.yaml").write_text(text)
    return place / "settings.yaml"


def pair_of(file: Path) -> StereoPair:
    return stereo_pair(file.parent / "left", file.parent / "right", read_intrinsics(file), file, None)


def test_a_rectified_pair_has_one_lens_and_the_baseline_bf_over_f(tmp_path: Path) -> None:
    pair = pair_of(settings(tmp_path, RECTIFIED))
    for lens in (pair.left, pair.right):
        np.testing.assert_array_equal(lens, [718.856, 1, 607.1928, 185.2157, 0])
    np.testing.assert_allclose(pair.pose, np.column_stack([np.eye(3), [0.5371657, 0, 0]]), rtol=0, atol=1e-7)
    assert read_camera(tmp_path / "settings.yaml").size == (1241, 376)


def test_version_3_tells_a_baseline_in_metres(tmp_path: Path) -> None:
    text = RECTIFIED.replace("Camera.f", "Camera1.f").replace("Camera.c", "Camera1.c")
    pair = pair_of(settings(tmp_path, text.replace("Camera.bf: 386.1448", "Stereo.b: 0.25")))
    np.testing.assert_allclose(pair.centre_m, [0.25, 0, 0], rtol=0, atol=1e-15)


def test_two_cameras_as_they_are_have_lenses_and_a_pose(tmp_path: Path) -> None:
    pair = pair_of(settings(tmp_path, AS_TAKEN))
    left = [458.654, 457.296 / 458.654, 367.215, 248.375, 0, -0.28, 0.07, 0, 0, 0, 0.0002, 1.8e-05]
    np.testing.assert_allclose(pinhole_rows(pair.left), left, rtol=1e-15)
    np.testing.assert_allclose(pair.right[[0, 2, 5, 6]], [457.587, 379.999, -0.27, 0], rtol=1e-15)
    np.testing.assert_allclose(pair.pose, POSE, rtol=0, atol=1e-8)
    assert read_intrinsics(tmp_path / "settings.yaml:Camera2")[0] == 457.587


def test_the_baseline_of_a_depth_camera_makes_no_pair(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="where its camera is beside the left one is not known"):
        pair_of(settings(tmp_path, RECTIFIED.replace("k1: 0.0", "k1: 0.26")))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (AS_TAKEN.replace("PinHole", "KannalaBrandt8"), "yaml:3: camera type 'KannalaBrandt8': must"),
        (RECTIFIED.replace("Camera.fy: 718.856\n", ""), "settings.yaml:2: lacks Camera.fy"),
        (RECTIFIED.replace("607.1928", "x"), "settings.yaml:4: 'x' is not a finite number"),
        (RECTIFIED.replace("fy: 718.856", "fy: -1"), "the calibration matrix is"),
    ],
)  # fmt: skip
def test_what_is_no_camera_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(DatasetError) as caught:
        read_intrinsics(settings(tmp_path, text))
    assert told in str(caught.value)
    with pytest.raises(DatasetError, match=r"holds no camera 'Camera3': it holds Camera"):
        read_intrinsics(Path(f"{settings(tmp_path, RECTIFIED)}:Camera3"))
