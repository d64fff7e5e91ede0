"""The clock of an odometer without a gyroscope, on a drive that brakes all the way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, SlamResult, run_slam
from sfmcpp.sources.drives import tracks_of_kitti
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from slam_helpers import error_m

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def drive(data_dir: Path) -> KittiDrive:
    return read_kitti_mat(data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat")


def run(drive: KittiDrive, late_s: float, kind: str = "velocity", *, gyro: bool = False) -> SlamResult:
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    stream = drive.velocity
    if kind == "speed":
        stream = replace(stream, values=np.linalg.norm(stream.values, axis=1, keepdims=True), kind=kind)
    sensors: list[MotionSensor] = [Odometer(stream.shifted(late_s), mounting=mounting)]
    if gyro:
        sensors.append(Gyroscope(drive.angular_rate, mounting))
    return run_slam(tracks_of_kitti(drive), sensors=sensors)


@pytest.mark.parametrize("late_s", [-0.5, 0.5])
def test_stamps_that_are_off_are_told_and_moved(drive: KittiDrive, late_s: float) -> None:
    result = run(drive, late_s)
    told, begun_again = result.warnings
    assert told.startswith(f"odometer: by its directions its clock is 0.50 ± 0.15 s {'ab'[late_s < 0]}")
    assert "begun again" in begun_again
    # It was six times as much.
    assert error_m(result, drive) < 1.2 * error_m(run(drive, 0.0), drive)


def test_correct_stamps_are_not_moved_and_speeds_or_a_gyroscope_are_left_alone(drive: KittiDrive) -> None:
    assert run(drive, 0.0).warnings == []
    assert not any("by its directions its clock" in w for w in run(drive, 0.5, "speed").warnings)
    assert not any("by its directions its clock" in w for w in run(drive, 0.0, gyro=True).warnings)
