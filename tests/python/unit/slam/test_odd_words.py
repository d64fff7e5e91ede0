"""What is misspelt or of another kind is told in the words of the user's call."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp import slam
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.slam import TrackSequence
from sfmcpp.slam.drive_run import motion_sensors
from sfmcpp.sources.drives import Drive
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


def drive_with_speeds() -> Drive:
    made = vehicle_drive(60.0, speed_m_s=4.0, frame_hz=5.0, seed=0)
    tracks = TrackSequence(made.t_s, made.frame_index, made.track_index, made.pixels, made.intrinsics)
    assert made.odometer is not None
    return Drive(Path("drive"), tracks, streams={"speed": made.odometer, "angular_rate": made.angular_rate})


@pytest.mark.parametrize(("sigma", "share"), [(0.05, 0.03), ((0.05, 0.01), 0.01), ((0.05, 0.0), 0.0)])
def test_an_odometer_declares_a_share_of_the_distance_beside_metres(
    sigma: float | tuple[float, float], share: float
) -> None:
    (odometer,) = motion_sensors(drive_with_speeds(), ["odometer"], {"odometer": sigma})
    measured = odometer.measure(1.0, 2.0, np.eye(3))
    assert measured is not None
    distance_m = float(measured.value)
    assert distance_m > 3.0
    assert measured.sigma == pytest.approx(np.hypot(0.05, share * distance_m))


@pytest.mark.parametrize(
    ("name", "sigma", "rule"),
    [
        ("imu", (0.001, 0.01), r"sigmas\['imu'\] = \(0.001, 0.01\): must be a number, or of the odometer"),
        (
            "odometer",
            (0.02, 0.01, 0.0),
            r"sigmas\['odometer'\] = \(.*\): must be a number, or of the odometer",
        ),
        ("odometer", (0.02, -0.01), r"sigmas\['odometer'\] = -0.01: must be between 0 and 1"),
        ("odometer", (0.0, 0.01), r"sigmas\['odometer'\] = 0.0: must be finite and positive"),
    ],
)
def test_shares_that_can_be_none_are_refused(name: str, sigma: tuple[float, float], rule: str) -> None:
    with pytest.raises(InvalidArgument, match=rule):
        motion_sensors(drive_with_speeds(), [name], {name: sigma})


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
