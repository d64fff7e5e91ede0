"""An odometer that slips slowly, on a drive of a hundred frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.model import SensorStream
from sfmcpp.model.frames import Frame, View
from sfmcpp.sensors import Mounting
from sfmcpp.slam import (
    Gyroscope,
    MotionSensor,
    Odometer,
    SlamResult,
    SlamSettings,
    WorldMap,
    odometer_slip,
    run_slam,
)
from sfmcpp.sources.drives import tracks_of_kitti
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from slam_helpers import INTRINSICS, error_m

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def drive(data_dir: Path) -> KittiDrive:
    return read_kitti_mat(data_dir / "kitti_tracks/2011_09_26_drive_0001_sync_KLT.mat")


def slipping(stream: SensorStream, factor: float) -> SensorStream:
    """Speeds that grow to a factor and back, from 2.2 to 4.4 s."""
    share = np.clip((stream.t_s - stream.t_s[0] - 2.2) / 2.2, 0.0, 1.0)
    strength = np.sin(np.pi * share) ** 2
    return replace(stream, values=stream.values * (1 + (factor - 1) * strength[:, None]))


def run(drive: KittiDrive, factor: float, *, gyro: bool, settings: SlamSettings | None = None) -> SlamResult:
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    sensors: list[MotionSensor] = [Odometer(slipping(drive.velocity, factor), mounting=mounting)]
    return run_slam(
        tracks_of_kitti(drive), settings, [*sensors, *([Gyroscope(drive.angular_rate, mounting)] * gyro)]
    )


@pytest.mark.parametrize("gyro", [False, True])
def test_a_slow_slip_is_told_and_taken_away(drive: KittiDrive, gyro: bool) -> None:
    once = run(drive, 0.75, gyro=gyro, settings=SlamSettings(hindsight=False))
    again = run(drive, 0.75, gyro=gyro)
    begin_s = drive.t_s[0]
    (told,) = [w for w in again.warnings if "slips" in w]
    start_s, end_s, factor = (float(told.split()[k]) for k in (4, 6, 16))
    assert start_s - begin_s == pytest.approx(2.2, abs=0.8)
    assert end_s - begin_s == pytest.approx(4.4, abs=0.8)
    assert factor == pytest.approx(0.75, abs=0.1)
    assert again.warnings == [*once.warnings, "the run was begun again without what was wrong"]
    assert error_m(again, drive) < 0.75 * error_m(once, drive)


@pytest.mark.parametrize("gyro", [False, True])
def test_a_correct_odometer_is_not_named(drive: KittiDrive, gyro: bool) -> None:
    assert run(drive, 1.0, gyro=gyro).warnings == []


def test_where_weights_are_those_of_the_thesis_no_slip_is_looked_for(drive: KittiDrive) -> None:
    result = run(drive, 0.75, gyro=True, settings=SlamSettings(weight_bounds="none"))
    assert not any("slips" in told for told in result.warnings)


@pytest.mark.parametrize(("count", "gain"), [(100, 8.0), (160, 8.0), (1600, 8.0 + np.log(10.0))])
def test_among_more_keyframes_a_slip_must_be_likelier(count: int, gain: float) -> None:
    world = WorldMap(INTRINSICS)
    for k in range(count):
        world.add(Frame(k, 0.1 * k, View(np.zeros(0, np.int32), np.zeros((0, 2)))), np.eye(3, 4))
    assert odometer_slip._least_gain(world) == pytest.approx(gain)
