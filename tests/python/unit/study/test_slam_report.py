"""The report and the table tell what the images cost, which sensor is wrong, and what a stream lacks."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.model import Trajectory
from sfmcpp.slam import (
    Frame,
    KeyframeRecord,
    SlamResult,
    SlamRun,
    SlamSettings,
    TrackSequence,
    View,
    WorldMap,
)
from sfmcpp.sources.drives import Drive
from sfmcpp.study import SlamReport


class Frames(TrackSequence):
    """Tracks that took as long as images."""

    def __init__(self, seconds: float | None) -> None:
        super().__init__(np.arange(4.0), [0, 1], [0, 3], np.zeros((2, 2)), [500, 1, 320, 240, 0])
        self.seconds = seconds


def record(frame: int, **sigmas: float) -> KeyframeRecord:
    weights = dict.fromkeys(sigmas, 2.0)
    return KeyframeRecord(frame, 0.1 * frame, 50, 5, {"resection": 1.0}, weights, sigmas)


def measured(seconds_tracking: float | None = None, warnings: tuple[str, ...] = ()) -> SlamReport:
    records = [record(1, odometer=0.5, imu=2.9), record(2, odometer=4.25, imu=0.1), record(3, odometer=8.0)]
    result = SlamResult(records=records, warnings=list(warnings), lost=[2], restarts=[3], message="")
    drive = Drive(Path("drive.csv"), Frames(seconds_tracking), seconds_read=0.1)
    return SlamReport(SlamRun(drive, SlamSettings(), ("odometer", "imu"), result, 4, 2.0, False))


def test_a_sensor_that_is_wrong_is_named_with_how_often_and_how_much() -> None:
    text = measured().table()
    assert "odometer disagrees with the images at 2 of 3 keyframes, by up to 8.0 σ" in text
    assert "imu disagrees" not in text


def test_what_is_wrong_with_a_stream_is_in_the_table_and_in_the_report() -> None:
    of = measured(warnings=("stream 'speed': leaps",))
    assert "warning         stream 'speed': leaps" in str(of)
    assert of.to_dict()["warnings"] == ["stream 'speed': leaps"]


def test_a_run_is_compared_with_the_time_of_the_drive() -> None:
    of = measured()  # a run of two seconds
    assert of.to_dict()["real_time_factor"] is None
    of.run.result.path.times.update({0: 5.0, 1: 6.0, 3: 10.0})
    report = of.to_dict()
    assert (report["seconds_driven"], report["real_time_factor"]) == (5.0, 2.5)
    assert "real time       2.5 times as fast as the drive, which took 5 s" in of.table()
    of.run.drive.frames.assumed_fps = 10.0  # there is no other clock
    assert of.to_dict()["real_time_factor"] is None
    assert "real time" not in of.table()


def test_the_time_of_the_images_is_told_where_there_are_images() -> None:
    assert "images" not in measured().table().replace("the images", "")
    told = "images          0.500 s for images and corners meanwhile, 125 ms per image"
    assert told in measured(0.5).table()


def test_a_rate_that_is_assumed_is_told_of_a_camera_alone() -> None:
    report = SlamReport(replace(measured().run, sensors=()))
    assert "assumed" not in report.table()
    assert report.to_dict()["input"]["assumed_fps"] is None
    report.run.drive.frames.assumed_fps = 10.0
    assert report.to_dict()["input"]["assumed_fps"] == 10.0
    told = "10 frames per second assumed: neither times.txt nor --fps is given"
    assert f"times           {told}\n" in report.table()


def test_the_report_is_plain_and_holds_no_curves() -> None:
    report = measured().to_dict()
    assert json.loads(json.dumps(report)) == report
    counts = {"path": "drive.csv", "frames": 4, "tracks": 4}
    assert report["input"] == {**counts, "corners": None, "assumed_fps": None, "right_images": None}
    assert report["lost_frames"] == [2]
    assert report["restart_frames"] == [3]
    assert report["keyframes"][1] == {
        "frame": 2,
        "t_s": 0.2,
        "inliers": 50,
        "new_points": 5,
        "milliseconds": {"resection": 1.0},
        "weights": {"odometer": 2.0, "imu": 2.0},
        "step_sigma": 0.0,
        "conflicts": {"odometer": 4.25, "imu": 0.1},
    }


def test_a_map_without_metres_says_so() -> None:
    of = measured()
    assert "arbitrary" not in of.table()  # there is no map
    of.run.result.path.world = WorldMap(np.array([500, 1, 320, 240, 0.0]))
    assert "scale           arbitrary: metres come from an odometer" in of.table()
    of.run.result.metric = True
    assert "arbitrary" not in of.table()


def test_how_well_images_hold_the_scale_is_told_of_maps_that_sensors_do_not_hold() -> None:
    def told(sigma: float, *, metric: bool = False) -> tuple[str, float | None]:
        of = measured()
        of.run.result.metric, of.run.result.restarts = metric, []
        world = of.run.result.path.world = WorldMap(np.array([500, 1, 320, 240, 0.0]))
        for frame in range(4):
            world.add(Frame(frame, 0.1 * frame, View(np.arange(0), np.zeros((0, 2)))), np.eye(3, 4))
        of.run.result.records[2].step_sigma = sigma
        return of.table(), of.to_dict()["scale_sigma"]

    text, sigma = told(0.125)
    assert "scale drift     12 % from start to end" in text
    assert sigma == 0.125
    assert "scale drift     a factor of 1.6 from start to end" in told(0.5)[0]
    text, sigma = told(0.5, metric=True)
    assert "scale drift" not in text
    assert sigma is None


def test_a_map_in_metres_is_measured_with_its_own_scale_too() -> None:
    """Twice the truth: without an error where the scale is fitted, and far from it where it is not."""
    of = measured()
    run = of.run
    poses = np.tile(np.eye(3, 4), (4, 1, 1)).astype(np.float64)
    poses[:, :, 3] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]]
    twice = poses.copy()
    twice[:, :, 3] *= 2
    run.result.path.times.update(enumerate(np.arange(4.0)))
    run.result.path.between.update(enumerate(twice))
    run.result.path.world, run.result.metric = WorldMap(np.array([500, 1, 320, 240, 0.0])), True
    report = SlamReport(replace(run, drive=replace(run.drive, truth=Trajectory(np.arange(4.0), poses))))
    assert report.comparison is not None
    assert report.in_metres is not None
    assert report.comparison.alignment.similarity.scale == pytest.approx(0.5)
    assert report.in_metres.mean_3d_error_m > 0.5
    assert report.comparison.mean_3d_error_m < 1e-9
    assert "scale 0.5" in report.table()
    assert "in metres" in report.table()
