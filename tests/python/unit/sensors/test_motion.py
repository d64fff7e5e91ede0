"""Odometer, gyroscope, INS and prediction against motions integrated independently in fine steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from random_scenes import angle_between, random_poses
from sensor_helpers import gyro, orientation_from
from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import (
    SensorStream,
    interpolate_poses,
    orientations,
    pose_at,
    pose_stream_values,
    predict_pose,
    rotation_increment,
    sampling_variance,
    travelled_distance,
)


def test_rates_integrate_to_the_rotation_between_any_two_times() -> None:
    for start_s, end_s in [(0.0, 4.0), (0.113, 2.7777), (1.0, 1.004)]:
        found = rotation_increment(gyro(), start_s, end_s)
        assert found is not None
        assert angle_between(found, orientation_from(start_s, end_s).as_matrix()) < 2e-5


def test_the_error_of_integration_falls_with_the_square_of_the_step() -> None:
    truth = orientation_from(0.0, 4.0).as_matrix()
    coarse, fine = (
        angle_between(np.asarray(rotation_increment(gyro(rate), 0.0, 4.0)), truth) for rate in (10.0, 20.0)
    )
    assert coarse / fine == pytest.approx(4.0, rel=0.1)


def test_what_rates_do_between_samples_shows_in_the_samples() -> None:
    """Of a body that shakes so quickly next to no angle is left; the trapezoids hold what was sampled."""
    t_s, sigma = np.arange(0, 1000, 0.1), 0.02
    smooth = np.outer(0.1 * np.sin(0.5 * t_s), [1.0, 0.0, 0.0])
    rates = smooth + sigma * np.random.default_rng(0).standard_normal((len(t_s), 3))
    stream = SensorStream(t_s, rates, "angular_rate")
    off = []
    for start in range(0, len(stream) - 10, 10):
        begin, end = t_s[[start, start + 10]]
        found = Rotation.from_matrix(rotation_increment(stream, begin, end)).as_rotvec()
        off.append(found - np.array([0.2 * (np.cos(0.5 * begin) - np.cos(0.5 * end)), 0.0, 0.0]))
    told = sampling_variance(stream)[-1] / len(off)
    assert np.mean(np.square(off)) == pytest.approx(told, rel=0.1)


def test_smooth_rates_and_orientations_gather_no_such_variance() -> None:
    """Of smooth rates it falls with the fifth power of the step."""
    coarse, fine = (sampling_variance(gyro(rate))[-1] for rate in (20.0, 40.0))
    assert coarse / fine == pytest.approx(32, rel=0.1)
    orientation = SensorStream(np.arange(4.0), np.zeros((4, 3)), "orientation")
    assert not sampling_variance(orientation).any()
    assert not sampling_variance(SensorStream(np.arange(2.0), np.eye(2, 3), "angular_rate")).any()


def test_increments_compose() -> None:
    stream = gyro()
    whole = rotation_increment(stream, 0.2, 3.1)
    parts = [rotation_increment(stream, a, b) for a, b in [(0.2, 1.0), (1.0, 2.5), (2.5, 3.1)]]
    np.testing.assert_allclose(np.linalg.multi_dot(parts), whole, atol=1e-13)
    np.testing.assert_allclose(orientations(stream, [0.2, 1.0, 2.5, 3.1])[-1], whole, atol=1e-13)


def test_orientations_end_where_the_stream_does() -> None:
    found = orientations(gyro(max_gap_s=0.1), [0.0, 3.0, 5.0, 6.0])
    assert np.isfinite(found[:2]).all()
    assert np.isnan(found[2:]).all()


def test_given_orientations_need_no_integration() -> None:
    t_s = np.linspace(0, 4, 41)
    absolute = Rotation.from_rotvec([0.3, -2.0, 0.5]) * Rotation.concatenate(
        [orientation_from(0.0, t, 0.05) for t in t_s]
    )
    stream = SensorStream(t_s, absolute.as_rotvec(), "orientation")
    found = rotation_increment(stream, 0.5, 3.5)
    assert angle_between(np.asarray(found), (absolute[5].inv() * absolute[35]).as_matrix()) < 1e-13


def test_speed_and_distance_measure_the_same_path() -> None:
    t_s = np.linspace(0, 4, 401)
    speed = SensorStream(t_s, 5 + 3 * np.sin(t_s), "speed")
    distance = SensorStream(t_s, 5 * t_s - 3 * np.cos(t_s) + 7, "distance")
    start_s, end_s = 0.333, 3.0077
    truth = 5 * (end_s - start_s) - 3 * (np.cos(end_s) - np.cos(start_s))
    assert travelled_distance(speed, start_s, end_s) == pytest.approx(truth, abs=1e-4)
    assert travelled_distance(distance, start_s, end_s) == pytest.approx(truth, abs=1e-4)


def test_reversing_takes_the_distance_back() -> None:
    t_s = np.linspace(0, 4, 41)
    assert travelled_distance(SensorStream(t_s, 2.0 - t_s, "speed"), 0.0, 4.0) == pytest.approx(0, abs=1e-12)


def test_velocities_in_space_measure_the_length_of_the_path() -> None:
    t_s, fine = np.linspace(0, 4, 201), np.linspace(0.4, 2.9, 2501)

    def velocity_at(t_s: np.ndarray) -> np.ndarray:
        return np.stack([6 + np.sin(t_s), 0.5 * np.cos(2 * t_s), 0.2 * t_s], axis=1)

    length = np.linalg.norm(velocity_at(0.5 * (fine[1:] + fine[:-1])), axis=1) @ np.diff(fine)
    found = travelled_distance(SensorStream(t_s, velocity_at(t_s), "velocity"), 0.4, 2.9)
    assert found == pytest.approx(float(length), abs=1e-3)


def test_sensors_of_the_wrong_kind_are_refused() -> None:
    with pytest.raises(InvalidArgument, match="'gyro' is of kind 'angular_rate': must be speed or distance"):
        travelled_distance(gyro(), 0.0, 1.0)
    with pytest.raises(InvalidArgument, match="must be angular_rate or orientation or pose"):
        rotation_increment(SensorStream(np.arange(3.0), np.ones(3), "speed"), 0.0, 1.0)


def test_prediction_is_exact_for_constant_velocities() -> None:
    rate, velocity = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -3.0])
    pose = random_poses(np.random.default_rng(2), 1)[0]
    ahead = predict_pose(pose, rate, velocity, 0.7)
    expected = Rotation.from_matrix(pose[:, :3]) * Rotation.from_rotvec(rate * 0.7)
    assert angle_between(ahead[:, :3], expected.as_matrix()) < 1e-14
    np.testing.assert_allclose(ahead[:, 3], pose[:, 3] + 0.7 * velocity)
    np.testing.assert_allclose(predict_pose(ahead, rate, velocity, -0.7), pose, atol=1e-14)


def test_poses_between_stamps_are_scipys() -> None:
    rng = np.random.default_rng(6)
    t_s, poses = np.cumsum(rng.uniform(0.1, 1, 8)), random_poses(rng, 8)
    times = np.concatenate([rng.uniform(t_s[0], t_s[-1], 30), t_s])
    found = interpolate_poses(t_s, poses, times)
    rotations = Slerp(t_s, Rotation.from_matrix(poses[:, :, :3]))(times)
    np.testing.assert_allclose(found[:, :, :3], rotations.as_matrix(), atol=1e-13)
    for axis in range(3):
        np.testing.assert_allclose(found[:, axis, 3], np.interp(times, t_s, poses[:, axis, 3]), atol=1e-12)


def ins(poses: np.ndarray, t_s: np.ndarray) -> SensorStream:
    return SensorStream(t_s, pose_stream_values(poses), "pose", max_gap_s=1.0)


def test_after_its_last_pose_an_ins_goes_on_as_between_the_last_two() -> None:
    """Thesis eqs 5.22 and 5.23, written out."""
    rng = np.random.default_rng(11)
    poses = random_poses(rng, 5)
    t_s, step, ahead = np.arange(5) * 0.2, 0.2, 0.13
    last, before = poses[-1], poses[-2]
    rate = Rotation.from_matrix(before[:, :3].T @ last[:, :3]).as_rotvec() / step
    velocity = (last[:, 3] - before[:, 3]) / step
    found = np.asarray(pose_at(ins(poses, t_s), t_s[-1] + ahead))
    np.testing.assert_allclose(found, predict_pose(last, rate, velocity, ahead), atol=1e-11)
