"""Positions that leap, are too few or tell no motion: the map stays whole, and the run says so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.so3 import exp
from sfmcpp.model import Problem, SensorStream
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors import Mounting, pose_stream_values
from sfmcpp.slam import Gps, Ins, MotionSensor, Odometer, SlamResult, SlamSettings, run_slam
from sfmcpp.slam.drive_run import doubts_of_units, motion_sensors
from sfmcpp.sources.drives import Drive
from sfmcpp.sources.synthetic import corridor_scene
from slam_helpers import STEP_S, sequence_of

AT_CAMERA = Mounting(np.eye(3), np.zeros(3))
TURN = exp(np.array([0.0, 0.0, 0.7]))


def walk() -> Problem:
    return corridor_scene(40, 2500, length_m=20.0, pixel_sigma_px=0.3, seed=0)


def truth(scene: Problem) -> np.ndarray:
    """Poses in a world turned from that of the scene."""
    return np.concatenate([TURN @ scene.rotations, (scene.centres @ TURN.T)[:, :, None]], axis=2)


def sensor_at(kind: str, poses: np.ndarray, fixes: np.ndarray) -> Gps | Ins:
    t_s = STEP_S * np.arange(len(poses))
    if kind == "gps":
        return Gps(SensorStream(t_s, fixes, "position"), sigma_m=0.1)
    values = pose_stream_values(poses)
    values[:, :3] = fixes
    return Ins(SensorStream(t_s, values, "pose"), AT_CAMERA, sigma_m=0.1)


def largest_error(result: SlamResult, poses: np.ndarray) -> float:
    found = np.stack([result.poses[k] for k in sorted(result.poses)])
    return float(np.linalg.norm(found[:, :, 3] - poses[:, :, 3], axis=1).max())


@pytest.mark.parametrize("kind", ["gps", "ins"])
@pytest.mark.parametrize("lost", [slice(19, 20), slice(23, 28)])
def test_positions_that_nothing_can_have_got_to_move_no_frame(kind: str, lost: slice) -> None:
    poses = truth(walk())
    fixes = poses[:, :, 3] + 0.05 * np.random.default_rng(0).standard_normal((len(poses), 3))
    fixes[lost] -= 5e6
    result = run_slam(sequence_of(walk()), sensors=[sensor_at(kind, poses, fixes)])
    assert result.metric
    assert largest_error(result, poses) < 0.3
    count = lost.stop - lost.start
    assert any(f"{count} of 40 positions are where no vehicle can have got to" in w for w in result.warnings)


@pytest.mark.parametrize("kind", ["gps", "ins", "odometer"])
def test_a_run_with_few_keyframes_has_metres_at_its_end(kind: str) -> None:
    poses = truth(walk())
    steps = np.linalg.norm(np.diff(poses[:, :, 3], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    sensor: MotionSensor = (
        Odometer(SensorStream(STEP_S * np.arange(len(way)), way, "distance"))
        if kind == "odometer"
        else sensor_at(kind, poses, poses[:, :, 3])
    )
    result = run_slam(sequence_of(walk()), SlamSettings(registration_keyframes=1000), [sensor])
    assert result.metric
    assert not result.warnings
    found = np.stack([result.poses[k][:, 3] for k in sorted(result.poses)])
    assert np.linalg.norm(found[-1] - found[0]) == pytest.approx(way[-1], rel=0.01)


def test_positions_of_too_few_keyframes_are_told_as_such() -> None:
    poses = truth(walk())
    two = sensor_at("gps", poses, poses[:, :, 3])
    two = replace(two, stream=replace(two.stream, t_s=two.stream.t_s[:2], values=two.stream.values[:2]))
    result = run_slam(sequence_of(walk()), sensors=[two])
    assert not result.metric
    assert any("must be 4 or more to scale it to metres" in warning for warning in result.warnings)


def test_an_odometer_whose_sign_alternates_scales_no_map() -> None:
    t_s = np.arange(0.0, 4.0, 0.02)
    there_and_back = np.where(np.arange(len(t_s)) % 2, 5.0, -5.0)
    result = run_slam(sequence_of(walk()), sensors=[Odometer(SensorStream(t_s, there_and_back, "speed"))])
    assert not result.metric
    assert any(w.startswith("odometer: measures too little motion") for w in result.warnings)


@pytest.mark.parametrize("as_radians", [True, False])
def test_latitudes_in_radians_are_doubted(as_radians: bool) -> None:
    unit = np.pi / 180 if as_radians else 1.0
    origin = WorldOrigin(np.array([49.0 * unit, 8.4 * unit, 110.0]), geodetic=True)
    fixes = SensorStream(STEP_S * np.arange(3), np.arange(9.0).reshape(3, 3), "position")
    metric = Gps(fixes, origin=WorldOrigin(np.zeros(3), geodetic=False))
    doubts = list(doubts_of_units([metric, Gps(fixes, origin=origin)]))
    assert ["as radians one at 49°" in doubt for doubt in doubts] == [True] * as_radians


def test_geocentric_positions_are_doubted() -> None:
    fixes = SensorStream(STEP_S * np.arange(3), np.add([4182e3, 850e3, 4724e3], np.eye(3)), "position")
    local = SensorStream(fixes.t_s, fixes.values - fixes.values[0], "position")
    (doubt,) = doubts_of_units([Gps(fixes), Gps(local)])
    assert "from the centre of the Earth (geocentric, ECEF): z of the result points to the pole" in doubt


def test_latitudes_beside_poses_of_another_world_are_refused() -> None:
    t_s = np.arange(4.0)
    poses = np.tile(np.eye(3, 4), (4, 1, 1))
    latitudes = np.tile([48.2, 16.4, 200.0], (4, 1)) + 1e-5 * t_s[:, None]
    streams = {
        "pose": SensorStream(t_s, pose_stream_values(poses), "pose"),
        "geodetic": SensorStream(t_s, latitudes, "geodetic"),
    }
    drive = Drive(Path("drive"), sequence_of(walk()), streams=streams)
    with pytest.raises(InvalidArgument, match="sensor = 'gps': its latitudes have a world of their own"):
        motion_sensors(drive, ["ins", "gps"])
    for name in ("ins", "gps"):
        assert [sensor.name for sensor in motion_sensors(drive, [name])] == [name]
