"""Cameras from the files of OpenCV, Kalibr and EuRoC: their lenses are ours, or are refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import to_pixels
from sfmcpp.sfm.cameras import parse_camera_argument
from sfmcpp.sources.cameras import find_camera, read_intrinsics

pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")

OPENCV = """%YAML:1.0
---
image_width: 752
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 458., 0., 367., 0., 457., 248., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28, 7.4e-02, 2e-04, 1.8e-05, 0.01 ]
"""
KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.074, 0.0002, 1.8e-05]
  distortion_model: radtan
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  camera_model: pinhole
  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]
  distortion_model: equidistant
  intrinsics: [461.0, 460.0, 380.0, 255.0]
"""
EUROC = """# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
camera_model: pinhole
intrinsics: [458.0, 457.0, 367.0, 248.0] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.074, 0.0002, 1.8e-05]
"""
# In the order of the model "perspective": f, aspect, cx, cy, skew, k1 to k5, p1, p2.
EXPECTED = np.array([458, 457 / 458, 367, 248, 0, -0.28, 0.074, 0, 0, 0, 2e-4, 1.8e-5])
WITH_K3 = EXPECTED + 0.01 * (np.arange(12) == 7)


def written(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_camera_of_opencv_kalibr_or_euroc_is_read(tmp_path: Path) -> None:
    np.testing.assert_allclose(read_intrinsics(written(tmp_path, "calib.yaml", OPENCV)), WITH_K3, rtol=1e-15)
    written(tmp_path, "camchain.yaml", KALIBR)
    np.testing.assert_allclose(read_intrinsics(tmp_path / "camchain.yaml:cam0"), EXPECTED, rtol=1e-15)
    np.testing.assert_allclose(read_intrinsics(written(tmp_path, "s.yml", EUROC)), EXPECTED, rtol=1e-15)


@pytest.mark.parametrize("suffix", ["yaml", "xml"])
def test_what_opencv_writes_is_read_and_its_lens_is_ours(tmp_path: Path, suffix: str) -> None:
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
    matrix = np.array([[458.0, 0, 367], [0, 457, 248], [0, 0, 1]])
    distortion = np.array([-0.28, 0.074, 2e-4, 1.8e-5, 0.01])
    file = cv2.FileStorage(str(tmp_path / f"c.{suffix}"), cv2.FILE_STORAGE_WRITE)
    file.write("camera_matrix", matrix)
    file.write("distortion_coefficients", distortion)
    file.release()
    rays = np.random.default_rng(0).uniform(-0.7, 0.7, (20, 2))
    points = np.column_stack([rays, np.ones(20)])
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, distortion)
    ours = to_pixels(rays, read_intrinsics(tmp_path / f"c.{suffix}"))
    np.testing.assert_allclose(ours, expected.reshape(-1, 2), rtol=0, atol=1e-9)


def test_coefficients_in_capitals_are_no_cameras(tmp_path: Path) -> None:
    text = "K: [458, 0, 367, 0, 457, 248, 0, 0, 1]\ndistance: 3\n"
    np.testing.assert_allclose(read_intrinsics(written(tmp_path, "c.yaml", text)), EXPECTED[:5], rtol=1e-15)
    with pytest.raises(DatasetError, match=r"c\.yaml:3: K1 is not read: distortion must be called"):
        read_intrinsics(written(tmp_path, "c.yaml", text + "K1: -0.28\nK2: 0.07\n"))


def test_a_message_that_ros_prints_is_a_camera(tmp_path: Path) -> None:
    text = "k: [458, 0, 367, 0, 457, 248, 0, 0, 1]\nd: [-0.28, 0.074, 0.0002, 1.8e-05, 0.01]\n---\n"
    np.testing.assert_allclose(read_intrinsics(written(tmp_path, "info.yaml", text)), WITH_K3, rtol=1e-15)
    with pytest.raises(DatasetError, match=r"info\.yaml:4: holds 2 documents: must be one"):
        read_intrinsics(written(tmp_path, "info.yaml", 2 * text))


def test_the_camera_of_rectified_images_is_that_of_the_projection_matrix(tmp_path: Path) -> None:
    projection = "\nprojection_matrix: [450, 0, 370, -40, 0, 450, 250, 0, 0, 0, 1, 0]\n"
    written(tmp_path, "c.yaml", OPENCV + projection)
    np.testing.assert_allclose(read_intrinsics(tmp_path / "c.yaml"), WITH_K3, rtol=1e-15)
    rectified = read_intrinsics(tmp_path / "c.yaml:projection_matrix")
    np.testing.assert_array_equal(rectified, [450, 1, 370, 250, 0])


@pytest.mark.parametrize(
    "name", ["Distortion_Coefficients", "distortion", "dist", "dist_coeff", "distCoeffs"]
)
def test_distortion_is_read_under_the_names_in_use(tmp_path: Path, name: str) -> None:
    text = OPENCV.replace("distortion_coefficients", name).replace("camera_matrix", "Camera_Matrix")
    np.testing.assert_allclose(read_intrinsics(written(tmp_path, "c.yaml", text)), WITH_K3, rtol=1e-15)


@pytest.mark.parametrize("name", ["distortion_parameters", "k1", "lens_coefficients"])
def test_distortion_under_another_name_is_not_left_out(tmp_path: Path, name: str) -> None:
    written(tmp_path, "c.yaml", OPENCV.replace("distortion_coefficients", name))
    with pytest.raises(DatasetError, match=rf"c\.yaml:9: {name} is not read: distortion must be called"):
        read_intrinsics(tmp_path / "c.yaml")


@pytest.mark.parametrize("indent", [None, 2, "\t"])
def test_json_is_read_as_yaml_is(tmp_path: Path, indent: int | str | None) -> None:
    content = {"camera_matrix": [[458, 0, 367.0], [0, 457, 248], [0, 0, 1]]}
    content["dist_coeff"] = [[-0.28, 0.074, 2e-4, 1.8e-05, 0.01]]
    written(tmp_path, "calibration.json", json.dumps(content, indent=indent))
    np.testing.assert_allclose(read_intrinsics(tmp_path / "calibration.json"), WITH_K3, rtol=1e-15)


def test_a_lens_without_distortion_is_a_camera_without(tmp_path: Path) -> None:
    text = EUROC.replace("[-0.28, 0.074, 0.0002, 1.8e-05]", "[0, 0, 0, 0]")
    np.testing.assert_array_equal(read_intrinsics(written(tmp_path, "c.yaml", text)), EXPECTED[:5])


def test_a_reconstruction_takes_the_same_files(tmp_path: Path) -> None:
    written(tmp_path, "camchain.yaml", KALIBR)
    # Pixels of photos count from the corner, Kalibr's from the centre of the first one.
    wanted = EXPECTED + 0.5 * np.isin(np.arange(12), [2, 3])
    np.testing.assert_allclose(parse_camera_argument(f"{tmp_path}/camchain.yaml:cam0").calibration, wanted)


def test_the_camera_of_euroc_lies_one_folder_above_its_images(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    written(tmp_path, "sensor.yaml", EUROC)
    np.testing.assert_allclose(read_intrinsics(find_camera(tmp_path / "data")), EXPECTED, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("c.yaml", OPENCV.replace("367.", "x"), "c.yaml:8: 'x' is not a finite number"),
        ("c.yaml", OPENCV.replace("367.", "36_7."), "c.yaml:8: '36_7.' is not a finite number"),
        ("c.yaml", OPENCV.replace("367., ", ""), "c.yaml:4: holds 8 numbers: must be 9"),
        ("c.yaml", OPENCV.replace("457.", "-457."), "c.yaml:4: the calibration matrix is"),
        ("c.yaml", OPENCV.replace("0.01 ]", "0, 0.1, 0, 0 ]"), "distortion of 8 coefficients: must be"),
        ("c.yaml", OPENCV.replace("matrix:", "matrix: ["), "is no YAML"),
        ("c.yaml", "K: &a [1]\nD: [*a]", "c.yaml:2: alias 'a': must be written out"),
        ("c.yaml", "K: " + "[" * 1_000_000, "c.yaml:1: nests more than 50 parts"),
        ("c.yaml", "- " * 500_000, "c.yaml:1: nests more than 50 parts"),
        ("c.yaml", "K: [1" + ", {a: 1" * 100_000, "c.yaml:1: nests more than 50 parts"),
        ("c.yaml", "K: [1]" + " " * (1 << 20), "bytes: must be 1048576 at most"),
        ("c.xml", "<K>" + "<data>" * 5000, "c.xml:1: nests 50 elements"),
        ("c.xml", '<?xml version="1.0" encoding="utf-7"?><K></K>', "is no XML"),
        ("c.yaml", "- 1\n- 2", "c.yaml:1: holds no camera: must be of OpenCV"),
        ("c.yaml", KALIBR, "c.yaml:1: holds cam0, cam1: say which, as in c.yaml:cam0"),
        ("c.yaml:cam2", KALIBR, "c.yaml:1: holds no camera 'cam2': it holds cam0, cam1"),
        ("c.yaml:cam1", KALIBR, "c.yaml:12: distortion model 'equidistant': must be one of radtan"),
        ("c.yaml", EUROC.replace("pinhole", "omni"), "c.yaml:7: camera model 'omni': must be pinhole"),
        ("c.yaml", EUROC.replace(", 248.0]", "]"), "c.yaml:8: holds 3 numbers: must be 4, fu, fv, cu, cv"),
        ("c.yaml", EUROC.replace("radial-tangential", "none"), "distortion model 'none'"),
        ("c.xml", "<opencv_storage><K>", "c.xml:1: is no XML"),
        ("c.xml", "<a><K>\n1 2 x</K></a>", "c.xml:1: 'x' is not a finite number"),
    ],
)  # fmt: skip
def test_what_is_no_such_camera_is_refused_in_one_line(
    tmp_path: Path, name: str, text: str, told: str
) -> None:
    written(tmp_path, name.partition(":")[0], text)
    with pytest.raises(DatasetError) as caught:
        read_intrinsics(tmp_path / name)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)
