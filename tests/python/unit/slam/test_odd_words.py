"""What is misspelt or of another kind is told in the words of the user's call."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp import slam
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io.sensor_columns import columns_of
from sfmcpp.sources.io.track_files import CameraTracks, write_tracks
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.synthetic import vehicle_drive


def test_the_name_of_a_sensor_alone_is_told_as_sensors() -> None:
    with pytest.raises(InvalidArgument, match=r"sensors = 'odometer': must be .* such as \['odometer'\]"):
        slam.run("drive.csv", "odometer")


def test_a_keyword_that_there_is_not_is_told_by_the_function_that_was_called() -> None:
    with pytest.raises(TypeError, match=r"^run\(\) got .* 'mountng'; did you mean 'mounting'\?"):
        slam.run("drive.csv", mountng="camera")
    with pytest.raises(TypeError, match=r"^run\(\) got .* 'qqq': must be one of sensors, .*, camera, fps"):
        slam.run("drive.csv", qqq="camera")


def test_a_measurement_that_lacks_is_told_by_its_columns(tmp_path: Path) -> None:
    drive = vehicle_drive(60.0, speed_m_s=4.0, frame_hz=5.0, seed=0)
    arrays = (drive.t_s, drive.frame_index, drive.track_index, drive.pixels, drive.intrinsics)
    write_tracks(CameraTracks(*arrays), tmp_path / "drive.csv")
    (tmp_path / "odo.csv").write_text("t [s],speed [m/s]\n0,4\n60,4\n")
    with pytest.raises(DatasetError, match=r"holds no angular_rate \(columns wx wy wz\) or orientation"):
        slam.run(tmp_path / "drive.csv", ["imu"], sensor_file=tmp_path / "odo.csv")


@pytest.mark.parametrize(
    ("kind", "columns"),
    [
        ("speed", "speed"),
        ("orientation", "qw qx qy qz or rx ry rz"),
        ("pose", "x y z qw qx qy qz or x y z rx ry rz"),
        ("geodetic", "lat lon height"),
    ],
)
def test_every_kind_is_known_by_its_columns(kind: str, columns: str) -> None:
    assert columns_of(kind) == columns


def test_a_csv_that_is_no_trajectory_is_told_what_it_was_taken_for(tmp_path: Path) -> None:
    file = tmp_path / "odo.csv"
    file.write_text("t [s],speed [m/s]\n0,4\n")
    with pytest.raises(DatasetError, match=r"odo\.csv:1: .*its format is taken for EuRoC's, t \[ns\]"):
        read_trajectory(file)
