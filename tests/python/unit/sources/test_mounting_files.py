"""How the camera sits on the sensors' body, by name or from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.drives import open_drive
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.sources.mounting_files import clock_offset_of, mounting_of
from sfmcpp.sources.synthetic import vehicle_drive

ROWS = "0 0 1 0.5\n-1 0 0 0.1\n0 -1 0 -0.2\n"


def test_names_stand_for_the_usual_axes() -> None:
    assert mounting_of(None) is None
    camera, forward = mounting_of("camera"), mounting_of("forward")
    assert camera is not None
    assert forward is not None
    np.testing.assert_array_equal(camera.camera_from_body, np.eye(3))
    # The camera looks along the body's x; the body's z is against the image's y.
    np.testing.assert_array_equal(forward.camera_from_body @ [1, 0, 0], [0, 0, 1])
    np.testing.assert_array_equal(forward.camera_from_body @ [0, 0, 1], [0, -1, 0])


@pytest.mark.parametrize("text", [ROWS, ROWS + "0 0 0 1\n", "# body_from_camera\n" + ROWS.replace(" ", ", ")])
def test_a_file_holds_the_pose_of_the_camera_in_the_body(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mounting.txt"
    file.write_text(text)
    mounting = mounting_of(str(file))
    assert mounting is not None
    np.testing.assert_array_equal(mounting.camera_from_body @ [1, 0, 0], [0, 0, 1])
    np.testing.assert_array_equal(mounting.lever_arm_m, [0.5, 0.1, -0.2])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 2 3\n", "holds 3 numbers: must be 12 or 16"),
        (ROWS + "0 0 1 1\n", "its last row is"),
        (ROWS.replace("-1", "-2"), "body_from_camera holds no rotation"),
        ("a b\n", "not a number|number"),
        (
            ROWS.replace("0.1", "1500"),
            "body_from_camera is no mounting: .* at most 1000 m; is it in millimetres",
        ),
    ],
)
def test_what_is_no_pose_is_refused_with_the_file_named(tmp_path: Path, text: str, told: str) -> None:
    file = tmp_path / "mounting.txt"
    file.write_text(text)
    with pytest.raises(DatasetError, match=told) as error:
        mounting_of(str(file))
    assert str(file) in str(error.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(DatasetError, match=r"nowhere\.txt"):
        mounting_of("nowhere.txt")


# The camera of ROWS as Kalibr writes it: camera_from_imu, and t_imu = t_cam + shift.
CHAIN = """cam0:
  T_cam_imu:
  - [0.0, -1.0, 0.0, 0.1]
  - [0.0, 0.0, -1.0, -0.2]
  - [1.0, 0.0, 0.0, -0.5]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [400.0, 400.0, 320.0, 240.0]
  timeshift_cam_imu: 0.02
"""


def chain_of(folder: Path, text: str = CHAIN) -> Path:
    pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")
    (folder / "camchain-imucam.yaml").write_text(text)
    return folder / "camchain-imucam.yaml"


@pytest.mark.parametrize("name", ["", ":cam0"])
def test_kalibr_has_the_inverse_pose(tmp_path: Path, name: str) -> None:
    rows = tmp_path / "mounting.txt"
    rows.write_text(ROWS)
    by_rows, by_kalibr = mounting_of(rows), mounting_of(f"{chain_of(tmp_path)}{name}")
    assert by_rows is not None
    assert by_kalibr is not None
    np.testing.assert_allclose(by_kalibr.camera_from_body, by_rows.camera_from_body, atol=1e-15)
    np.testing.assert_allclose(by_kalibr.lever_arm_m, by_rows.lever_arm_m, atol=1e-15)


def test_one_of_several_cameras_of_kalibr_is_named(tmp_path: Path) -> None:
    file = chain_of(tmp_path, CHAIN + CHAIN.replace("cam0", "cam1").replace("0.02", "0.03"))
    with pytest.raises(DatasetError, match="holds cam0, cam1: say which"):
        mounting_of(file)
    assert clock_offset_of(f"{file}:cam1") == -0.03


def drive_with_sensors(folder: Path) -> dict[str, Path]:
    truth = vehicle_drive(60.0, speed_m_s=4.0, frame_hz=5.0, seed=0)
    arrays = (truth.t_s, truth.frame_index, truth.track_index, truth.pixels, truth.intrinsics)
    write_tracks(CameraTracks(*arrays), folder / "drive.csv")
    (folder / "wheel.csv").write_text("t [s],speed [m/s]\n0,4\n1,4\n2,4\n")
    return {"path": folder / "drive.csv", "sensor_file": folder / "wheel.csv"}


def test_stamps_of_the_imu_are_brought_to_the_clock_of_the_camera(tmp_path: Path) -> None:
    file, opening = chain_of(tmp_path), drive_with_sensors(tmp_path)
    drive = open_drive(**opening, mounting=file)
    np.testing.assert_allclose(drive.streams["speed"].t_s, [-0.02, 0.98, 1.98])
    assert drive.clock_offset_s == -0.02
    own = open_drive(**opening, mounting=file, clock_offset_s=0.0)
    np.testing.assert_array_equal(own.streams["speed"].t_s, [0, 1, 2])


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("T_cam_imu", "T_cn_cnm1", "holds no mounting: must have T_BS of EuRoC's sensor.yaml or T_cam_imu"),
        ("-0.5]", "]", "T_cam_imu holds 15 numbers|is not a finite number"),
        ("[1.0, 0.0", "[2.0, 0.0", "T_cam_imu holds no rotation"),
        (": 0.02", ": [0.02, 1]", "timeshift_cam_imu holds 2 numbers: must be 1"),
        (": 0.02", ": soon", "'soon' is not a finite number"),
    ],
)
def test_what_kalibr_would_not_write_is_refused(tmp_path: Path, old: str, new: str, told: str) -> None:
    file = chain_of(tmp_path, CHAIN.replace(old, new))
    with pytest.raises(DatasetError, match=told) as error:
        open_drive(**drive_with_sensors(tmp_path), mounting=file)
    assert str(file) in str(error.value)
