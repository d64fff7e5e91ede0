"""GPS and INS in the loop: the map comes into their world, and back to them when it has drifted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.geometry import so3
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Problem, SensorStream
from sfmcpp.model.frames import Frame, View
from sfmcpp.sensors import Mounting, pose_stream_values
from sfmcpp.slam import Gps, Ins, MotionSensor, Odometer, SlamResult, SlamSettings, TrackSequence, run_slam
from sfmcpp.slam.registration import Correction, correction, registration
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.sources.drives import tracks_of_kitti
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.sources.synthetic import corridor_scene, street_loop_scene
from slam_helpers import INTRINSICS, STEP_S, sequence_of

# Not the origin, not north: what the map starts with must not be right by chance.
WORLD = Similarity(1.0, so3.exp(np.array([0.0, 0.0, 0.8])), np.array([300.0, -120.0, 40.0]))
MOUNTING = Mounting(Mounting.forward_looking().camera_from_body, np.array([0.4, -0.1, 0.3]))


def straight() -> Problem:
    return corridor_scene(40, 2500, length_m=20.0, pixel_sigma_px=0.3, seed=0)


def bent() -> Problem:
    return street_loop_scene(120, 4000, pixel_sigma_px=0.3, seed=0)


def gps_of(cameras: np.ndarray, sigma_m: float) -> Gps:
    """Fixes of the antenna at every image, in `WORLD`."""
    body = MOUNTING.body_poses(WORLD.apply_to_poses(cameras))
    fixes = body[:, :, 3] + sigma_m * np.random.default_rng(1).normal(size=(len(body), 3))
    return Gps(SensorStream(STEP_S * np.arange(len(body)), fixes, "position"), MOUNTING, sigma_m=sigma_m)


def ins_of(cameras: np.ndarray, sigma_m: float, sigma_rad: float) -> Ins:
    """Poses of the body at every image, in `WORLD`."""
    rng = np.random.default_rng(2)
    values = pose_stream_values(MOUNTING.body_poses(WORLD.apply_to_poses(cameras)))
    values += np.repeat([sigma_m, sigma_rad], 3) * rng.normal(size=values.shape)
    return Ins(SensorStream(STEP_S * np.arange(len(values)), values, "pose"), MOUNTING, sigma_m=sigma_m)


def errors(result: SlamResult, cameras: np.ndarray) -> tuple[float, float]:
    """Mean distance [m] and mean angle [rad] to the truth in `WORLD`, nothing aligned."""
    return errors_to(result, WORLD.apply_to_poses(cameras))


def errors_to(result: SlamResult, truth: np.ndarray) -> tuple[float, float]:
    frames = sorted(result.poses)
    found = np.stack([result.poses[k] for k in frames])
    turns = so3.log(np.swapaxes(truth[frames][:, :, :3], 1, 2) @ found[:, :, :3])
    distances = np.linalg.norm(found[:, :, 3] - truth[frames][:, :, 3], axis=1)
    return float(distances.mean()), float(np.linalg.norm(turns, axis=1).mean())


@pytest.mark.parametrize("scene", [straight(), bent()], ids=["straight", "bent"])
def test_positions_bring_the_map_into_their_world(scene: Problem) -> None:
    sigma_m = 0.05
    result = run_slam(sequence_of(scene), sensors=[gps_of(scene.cameras, sigma_m)])
    assert result.metric
    distance, angle = errors(result, scene.cameras)
    assert distance < 3 * sigma_m
    assert angle < 0.02


@pytest.mark.parametrize("scene", [straight(), bent()], ids=["straight", "bent"])
def test_poses_bring_the_map_into_their_world(scene: Problem) -> None:
    result = run_slam(sequence_of(scene), sensors=[ins_of(scene.cameras, 0.05, 0.01)])
    assert result.metric
    distance, angle = errors(result, scene.cameras)
    assert distance < 0.15
    assert angle < 0.02


def test_the_map_waits_for_positions_far_enough_apart_for_a_scale() -> None:
    scene = straight()
    result = run_slam(sequence_of(scene), sensors=[gps_of(scene.cameras, 5.0)])
    assert not result.metric
    assert len(result.poses) == scene.num_cameras


@pytest.mark.parametrize("away_m", [1e4, 2e7])
def test_a_world_that_is_moved_moves_the_map_and_nothing_else(away_m: float) -> None:
    scene, by = bent(), away_m * np.array([0.5, 0.8, 0.3])
    seen, here = first_frames(scene, 40), gps_of(scene.cameras, 0.1)
    there = replace(here, stream=replace(here.stream, values=here.stream.values + by))
    found, moved = (run_slam(seen, sensors=[gps]) for gps in (here, there))
    assert found.metric
    assert found.poses.keys() == moved.poses.keys()
    for k, pose in found.poses.items():
        np.testing.assert_allclose(moved.poses[k][:, 3] - by, pose[:, 3], rtol=0, atol=1e-6)
        np.testing.assert_allclose(moved.poses[k][:, :3], pose[:, :3], atol=1e-7)


def first_frames(scene: Problem, count: int) -> TrackSequence:
    seen = scene.camera_index < count
    arrays = (array[seen] for array in (scene.camera_index, scene.point_index, scene.pixels))
    return TrackSequence(STEP_S * np.arange(count), *arrays, scene.intrinsics[0])


def test_positions_that_jump_away_and_back_are_named_and_get_no_weight() -> None:
    scene, sigma_m = bent(), 0.3
    correct = gps_of(scene.cameras, sigma_m)
    away = np.zeros_like(correct.stream.values)
    away[50:74] = [9.0, -12.0, 0.0]
    stream = SensorStream(correct.stream.t_s, correct.stream.values + away, "position")
    result = run_slam(sequence_of(scene), sensors=[Gps(stream, MOUNTING, sigma_m=sigma_m)])
    assert any("24 of 120 positions jump away from the others" in warning for warning in result.warnings)
    assert errors(result, scene.cameras)[0] < 2 * sigma_m


def test_positions_that_are_missing_leave_the_map_in_its_own_world() -> None:
    scene = straight()
    late = gps_of(scene.cameras, 0.05)
    result = run_slam(sequence_of(scene), sensors=[Gps(late.stream.shifted(1e4), MOUNTING)])
    assert not result.metric
    assert len(result.poses) == scene.num_cameras


def test_keyframes_before_the_first_position_do_not_bring_the_map_into_its_world() -> None:
    """On a straight line through the first two positions they would be where no camera was."""
    gps = gps_of(bent().cameras, 0.05)
    world = run_slam(sequence_of(bent())).world
    assert world is not None
    settings = SlamSettings()
    for late, brought in ((3, False), (settings.registration_keyframes + 2, True)):
        since_s = world.keyframes[-late].t_s
        some = gps.stream.only(gps.stream.t_s >= since_s)
        suite = SensorSuite([replace(gps, stream=replace(some, max_gap_s=60.0))])
        assert (registration(world, suite, settings) is not None) == brought


DRIFT = Similarity(1.15, so3.exp(np.array([0.0, 0.05, 0.0])), np.array([0.3, 0.0, -0.5]))


@pytest.mark.parametrize("kind", ["gps", "ins"])
def test_keyframes_that_have_drifted_are_moved_back_and_their_points_with_them(kind: str) -> None:
    cameras = bent().cameras
    exact = gps_of(cameras, 1e-4) if kind == "gps" else ins_of(cameras, 1e-4, 1e-5)
    world, before, found = drifted_and_corrected(bent(), exact)
    for keyframe, pose in zip(world.keyframes, before, strict=True):
        np.testing.assert_allclose(keyframe.pose, pose, atol=0.02)
    assert found.first == len(before) - SlamSettings().registration_keyframes


@pytest.mark.parametrize("kind", ["gps", "ins"])
def test_keyframes_within_the_noise_of_positions_have_not_drifted_from_them(kind: str) -> None:
    cameras, settings = bent().cameras, SlamSettings()
    exact = gps_of(cameras, 1e-4) if kind == "gps" else ins_of(cameras, 1e-4, 1e-5)
    world = run_slam(sequence_of(bent()), settings, [exact]).world
    assert world is not None
    first = len(world.keyframes) - settings.registration_keyframes
    world.move_recent(first, Similarity(1.0, np.eye(3), np.array([0.5, 0.0, -0.5])))
    assert correction(world, SensorSuite([replace(exact, sigma_m=1.0)]), settings) is None
    assert correction(world, SensorSuite([replace(exact, sigma_m=0.1)]), settings) is not None


@pytest.mark.parametrize(("every", "brought"), [(20, False), (5, True)])
def test_keyframes_between_the_same_fixes_count_as_one(every: int, brought: bool) -> None:
    """They lie on the line through these, whatever their noise is, which turned the map to and fro."""
    scene, settings = straight(), SlamSettings()
    world = run_slam(sequence_of(scene)).world
    assert world is not None
    gps = gps_of(scene.cameras, 0.05)
    fixes = gps.stream.only(np.arange(len(gps.stream)) % every == 0)
    suite = SensorSuite([replace(gps, stream=replace(fixes, max_gap_s=60.0))])
    told = sum(keyframe.t_s <= fixes.t_s[-1] for keyframe in world.keyframes)
    assert told >= settings.registration_keyframes
    assert (registration(world, suite, settings) is not None) == brought


def test_an_odometer_gives_drifted_keyframes_their_scale_back_where_that_is_asked_for() -> None:
    scene = straight()
    wheel = Odometer(path_length(scene.cameras))
    world, before, _ = drifted_and_corrected(scene, wheel, correct_scale=True)
    first = len(before) - SlamSettings().registration_keyframes
    steps = np.linalg.norm(np.diff(world.poses[first:, :, 3], axis=0), axis=1)
    true = np.linalg.norm(np.diff(np.stack(before)[first:, :, 3], axis=0), axis=1)
    np.testing.assert_allclose(steps, true, rtol=0.02)


def drifted_and_corrected(
    scene: Problem, sensor: MotionSensor, *, correct_scale: bool = False
) -> tuple[WorldMap, list[np.ndarray], Correction]:
    """Run, move the last keyframes by `DRIFT`, and correct that; the poses before, too."""
    settings, suite = SlamSettings(correct_scale=correct_scale), SensorSuite([sensor])
    world = run_slam(sequence_of(scene), settings, [sensor]).world
    assert world is not None
    assert correction(world, suite, settings) is None
    before = [k.pose.copy() for k in world.keyframes]
    world.move_recent(len(before) - settings.registration_keyframes, DRIFT)
    found = correction(world, suite, settings)
    assert found is not None
    world.move_recent(found.first, found.similarity)
    return world, before, found


def test_distances_do_not_tear_a_map_unasked() -> None:
    """Moved for its scale, a part loses the points that tie it to the rest."""
    scene = straight()
    wheel = Odometer(path_length(scene.cameras))
    world, _, _ = drifted_and_corrected(scene, wheel, correct_scale=True)
    world.move_recent(len(world.keyframes) - SlamSettings().registration_keyframes, DRIFT)
    suite = SensorSuite([wheel])
    assert correction(world, suite, SlamSettings(correct_scale=True)) is not None
    assert correction(world, suite, SlamSettings()) is None


@pytest.mark.parametrize(("shrunk", "scale"), [(0, 2.0), (2, None), (8, 20.0)])
def test_keyframes_between_which_the_map_has_changed_its_scale_do_not_tell_it(
    shrunk: int, scale: float | None
) -> None:
    """Steps of one metre each: in the map 0.5, of which the last ones have shrunk to 0.05."""
    steps = np.array([0.5] * (8 - shrunk) + [0.05] * shrunk)
    world = WorldMap(INTRINSICS)
    for k, at in enumerate(np.append(0.0, np.cumsum(steps))):
        frame = Frame(k, float(k), View(np.zeros(0, np.int64), np.zeros((0, 2))))
        world.add(frame, np.column_stack([np.eye(3), [0.0, 0.0, at]]))
    wheel = Odometer(SensorStream(np.arange(9.0), np.arange(9.0), "distance"))
    found = registration(world, SensorSuite([wheel]), SlamSettings())
    assert (None if found is None else pytest.approx(found.scale)) == scale


def path_length(cameras: np.ndarray) -> SensorStream:
    """An odometer that counts the distance exactly."""
    steps = np.linalg.norm(np.diff(cameras[:, :, 3], axis=0), axis=1)
    return SensorStream(STEP_S * np.arange(len(cameras)), np.append(0.0, np.cumsum(steps)), "distance")


@pytest.fixture(scope="module")
def real_drive(data_dir: Path) -> KittiDrive:
    return read_kitti_mat(data_dir / "kitti_tracks/2011_09_26_drive_0095_sync_KLT.mat")


@pytest.mark.real
@pytest.mark.parametrize(("kind", "most_m", "most_deg"), [("gps", 2.0, 5.0), ("ins", 1.0, 2.0)])
def test_on_a_real_drive_positions_of_a_metre_keep_it_in_place(
    real_drive: KittiDrive, kind: str, most_m: float, most_deg: float
) -> None:
    # Positions on its straight way tell no roll of the two parts of its map: the end rolled them by 80°.
    d = real_drive
    result = run_slam(tracks_of_kitti(d), sensors=[simulated(d, kind)])
    assert sorted(result.poses) == list(range(len(d.t_s)))
    metres, radians = errors_to(result, d.truth.poses)
    assert metres < most_m
    assert np.degrees(radians) < most_deg


@pytest.mark.real
def test_a_correct_gps_is_kept_where_the_map_breaks(data_dir: Path) -> None:
    # Images and positions are 49 m apart once. Without these the map would not come back.
    d = read_kitti_mat(data_dir / "kitti_tracks/2011_09_26_drive_0036_sync_KLT.mat")
    centres = d.truth.poses[:, :, 3]
    measured = centres + np.random.default_rng(0).normal(0, 1.0, centres.shape)
    twice_a_second = SensorStream(d.truth.t_s[::5], measured[::5], "position")
    result = run_slam(tracks_of_kitti(d), sensors=[Gps(twice_a_second)])
    assert "disagrees with the images" in result.warnings[0]
    assert errors_to(result, d.truth.poses)[0] < 2.0


def simulated(drive: KittiDrive, kind: str) -> MotionSensor:
    """A GPS of one metre, or an INS of 0.3 m and 0.2°, from the truth."""
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    rng = np.random.default_rng(0)
    values = pose_stream_values(mounting.body_poses(drive.truth.poses))
    if kind == "gps":
        return Gps(
            SensorStream(drive.t_s, values[:, :3] + rng.normal(0, 1.0, (len(values), 3)), "position"),
            mounting,
        )
    noise = np.repeat([0.3, 0.003], 3) * rng.normal(size=values.shape)
    return Ins(SensorStream(drive.t_s, values + noise, "pose"), mounting)
