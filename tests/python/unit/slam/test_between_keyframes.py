"""Frames between keyframes: what sensors say of them, and where an adjustment moves them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.geometry import Similarity
from sfmcpp.model import SensorStream
from sfmcpp.slam import Measurement, Odometer, Path, SlamResult, SlamSettings, WorldMap, run_slam
from sfmcpp.slam.between_keyframes import fit_between_keyframes
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WeightedMeasurement
from slam_helpers import INTRINSICS, STEP_S, drive, path, small_map
from winding import winding


def path_between(shares: list[float]) -> Path:
    """Two keyframes, of frames 0 and 10, and frames at those shares of the time between, or after."""
    world = small_map([[0, 1, 2], [0, 1, 2]])
    times = {0: 0.0, 10: STEP_S} | {int(10 * share): share * STEP_S for share in shares}
    poses = {}
    for share in shares:
        pose = np.eye(3, 4)
        pose[:, 3] = [0.5 * share, 0.1, -0.2]
        poses[int(10 * share)] = pose
    return Path(poses, times, world)


def test_a_map_that_moves_as_one_takes_its_frames_along() -> None:
    path = path_between([0.3, 0.7, 1.5])
    assert path.world is not None
    whole = Similarity(1.0, Rotation.from_rotvec([0.1, -0.4, 0.2]).as_matrix(), np.array([3.0, 1.0, -2.0]))
    expected = {frame: whole.apply_to_poses(pose) for frame, pose in path.between.items()}
    before = path.world.poses.copy()
    path.world.transform(whole)
    path.follow(before)
    for frame, pose in expected.items():
        np.testing.assert_allclose(path.between[frame], pose, atol=1e-12)


def test_a_keyframe_that_moves_alone_takes_along_by_time() -> None:
    path = path_between([0.25])
    assert path.world is not None
    before = path.world.poses.copy()
    start = path.between[2].copy()
    path.world.poses[1, :, 3] += [0.0, 0.8, 0.0]
    path.follow(before)
    np.testing.assert_allclose(
        path.between[2] - start, np.outer([0, 0.8 * 0.25, 0], [0, 0, 0, 1]), atol=1e-12
    )


def test_nothing_moves_before_the_first_keyframe_that_has_moved() -> None:
    path = path_between([0.5, 1.5])
    assert path.world is not None
    before = path.world.poses.copy()
    path.follow(before)
    np.testing.assert_array_equal(path.between[5][:, 3], [0.25, 0.1, -0.2])


def test_a_frame_that_settles_keeps_what_the_images_say_of_its_rotation() -> None:
    path = path_between([0.5])
    seen = Rotation.from_rotvec([0.0, 0.02, 0.0]).as_matrix()
    path.seen_from[5] = seen
    turned = np.column_stack([Rotation.from_rotvec([0.0, 0.3, 0.1]).as_matrix(), np.ones(3)])
    path.settle(5, turned)
    np.testing.assert_array_equal(path.between[5], turned)
    np.testing.assert_allclose(path.between[5][:, :3] @ path.seen_from[5], seen, atol=1e-12)


def test_sensors_have_their_say_between_keyframes() -> None:
    """Steps are as even as an odometer's, not as uneven as those of the images."""
    drive = winding()
    off: list[float] = []
    for sensors in ([], [Odometer(drive.odometer, sigma_m=0.002, relative_sigma=0.0)]):
        result = run_slam(drive.sequence, SlamSettings(final_adjustment="off"), sensors)
        poses = result.poses
        steps = [
            np.linalg.norm(poses[k + 1][:, 3] - poses[k][:, 3])
            / np.linalg.norm(drive.truth[k + 1, :, 3] - drive.truth[k, :, 3])
            for k in result.path.between
            if k + 1 in result.path.between
        ]
        off.append(float(np.std(np.log(steps))))
    assert off[1] < 0.6 * off[0]


def test_frames_between_two_keyframes_are_fitted_together() -> None:
    """Far points tell a step of a tenth of a second badly, and two keyframes and an odometer well."""
    ways = 0.3 * np.arange(11.0)[:, None] * [0, 0, 1]
    truth = path(ways, np.zeros((11, 3)))
    sequence = drive(truth, sigma_px=3.0, points=12)
    frames, world = list(sequence), WorldMap(INTRINSICS)
    off = np.random.default_rng(1).normal(0, 0.3, (11, 3))
    between = {k: np.column_stack([np.eye(3), ways[k] + off[k]]) for k in range(1, 10)}
    for k in (0, 10):
        world.add(frames[k], truth[k])
    said = Measurement("odometer", "scale", 3.0, 0.02)
    world.keyframes[-1].constraints.append(WeightedMeasurement(said, 50.0))
    world.points[:12] = np.random.default_rng(0).uniform([-4, -3, 6], [4, 3, 14], (12, 3))
    world.metric = True
    result = SlamResult(Path(between, dict(enumerate(sequence.t_s)), world), metric=True)
    stream = SensorStream(sequence.t_s, np.full(11, 3.0), "speed")
    before = dict(between)
    for sensors, settings, limit in (
        ([], SlamSettings(), None),
        ([Odometer(stream)], SlamSettings(weight_bounds="none"), None),
        ([Odometer(stream)], SlamSettings(), 0.03),
    ):
        fit_between_keyframes(result, frames, SensorSuite(sensors), settings)
        if limit is None:
            assert all(between[k] is before[k] for k in before)
        else:
            steps = np.diff([truth[0][2, 3], *(between[k][2, 3] for k in range(1, 10)), truth[10][2, 3]])
            np.testing.assert_allclose(steps, 0.3, atol=limit)
