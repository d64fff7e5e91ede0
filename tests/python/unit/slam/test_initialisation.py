"""The first three keyframes of a map, and how a new part of it finds its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.ba import Summary
from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.model.frames import View
from sfmcpp.slam import (
    Frame,
    MotionSensor,
    Odometer,
    Path,
    SlamResult,
    SlamSettings,
    TrackSequence,
    WorldMap,
    initialisation,
)
from sfmcpp.slam.bridging import Follower, rejoin
from sfmcpp.slam.initialisation import Initialiser
from sfmcpp.slam.sensor_suite import SensorSuite
from slam_helpers import INTRINSICS, STEP_S, drive, path, project, small_map

SETTINGS = SlamSettings()


def sideways(count: int, step: float) -> np.ndarray:
    """Poses (count, 3, 4) of a camera that goes to the right and a little ahead, and turns slowly."""
    ways = np.arange(count)[:, None] * np.array([[step, 0.0, step / 4]])
    return path(ways, np.arange(count)[:, None] * [[0.0, 0.002, 0.001]])


def offered(
    sequence: TrackSequence, settings: SlamSettings = SETTINGS
) -> tuple[Initialiser, WorldMap | None]:
    """Offer frames until there is a map."""
    initialiser = Initialiser(sequence.intrinsics, settings)
    for frame in sequence:
        world = initialiser.try_frame(frame)
        if world is not None:
            return initialiser, world
    return initialiser, None


def moved_px(initialiser: Initialiser) -> float:
    """Median motion of the image from the first frame offered to the last."""
    first, last = initialiser.frames[0].view.pixels, initialiser.frames[-1].view.pixels
    return float(np.median(np.linalg.norm(last - first, axis=1)))


def waits(initialiser: Initialiser, sequence: TrackSequence) -> list[tuple[float, bool]]:
    """For each frame but the first two: how far the image has moved, and whether more is waited for."""
    found = []
    for frame in sequence:
        if initialiser.try_frame(frame) is not None:
            break
        if frame.number > 1:
            found.append((moved_px(initialiser), initialiser.reason.startswith("the image moves")))
    return found


def test_the_first_three_keyframes_and_their_points_are_the_truth_up_to_a_similarity() -> None:
    poses = sideways(12, 0.25)
    initialiser, world = offered(drive(poses, sigma_px=0.0))
    assert world is not None
    frames = [keyframe.frame for keyframe in world.keyframes]
    assert frames == [0, (frames[2]) // 2, frames[2]]
    assert [frame.number for frame in initialiser.frames] == list(range(frames[2] + 1))
    np.testing.assert_array_equal(world.poses[0], np.eye(3, 4))
    similarity = fit_pose_similarity(world.poses, poses[frames])
    np.testing.assert_allclose(similarity.apply_to_poses(world.poses), poses[frames], atol=1e-4)
    assert world.known.sum() > 250
    cloud = np.random.default_rng(0).uniform([-4, -3, 6], [4, 3, 14], (300, 3))
    found = similarity.apply(world.points[world.known])
    np.testing.assert_allclose(found, cloud[np.flatnonzero(world.known)], atol=1e-2)


@pytest.mark.parametrize("parallax_px", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("points", [300, 3 * SETTINGS.min_inliers - 1])
def test_it_waits_for_the_parallax_it_is_told_and_for_half_of_it_once_tracks_run_out(
    parallax_px: float, points: int
) -> None:
    sequence = drive(sideways(30, 0.08), sigma_px=0.2, points=points)
    found = waits(Initialiser(INTRINSICS, SlamSettings(start_parallax_px=parallax_px)), sequence)
    wanted_px = parallax_px if points == 300 else parallax_px / 2
    assert {waited for _, waited in found} == {True, False} or wanted_px < 10
    assert all(waited == (moved < wanted_px) for moved, waited in found)


def above_flat_ground(poses: np.ndarray, height: float = 25.0) -> TrackSequence:
    """What a camera sees that looks straight at a plane, and no more than fits in its image."""
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform([-30, -25], [80, 25], (2500, 2)), np.full(2500, height)])
    pixels = np.stack([project(pose, ground) for pose in poses]) + rng.normal(0, 0.3, (len(poses), 2500, 2))
    frames, tracks = np.nonzero(((pixels > 0) & (pixels < [640, 480])).all(axis=2))
    t_s = STEP_S * np.arange(len(poses))
    return TrackSequence(t_s, frames, tracks, pixels[frames, tracks], INTRINSICS)


def test_a_way_along_flat_ground_is_no_rotation() -> None:
    ways = np.arange(20)[:, None] * np.array([[0.45, 0.1, 0.0]])
    poses = path(ways, np.zeros((20, 3)))
    _, world = offered(above_flat_ground(poses))
    assert world is not None
    turns = Rotation.from_matrix(world.poses[:, :, :3]).as_rotvec()
    assert np.degrees(np.abs(turns)).max() < 0.2
    way = world.poses[2, :, 3] / np.linalg.norm(world.poses[2, :, 3])
    np.testing.assert_allclose(way, ways[1] / np.linalg.norm(ways[1]), atol=0.01)


def test_above_flat_ground_a_rotation_is_no_way() -> None:
    turning = path(np.zeros((40, 3)), np.arange(40)[:, None] * [[0.004, 0.018, 0.0]])
    initialiser, world = offered(above_flat_ground(turning))
    assert world is None
    assert "rotation only" in initialiser.reason


def test_frames_that_share_too_little_begin_again_with_the_last() -> None:
    poses = sideways(4, 0.08)
    first, second = drive(poses), drive(poses, seed=1)
    initialiser = Initialiser(INTRINSICS, SETTINGS)
    for frame in (first.frame(0), first.frame(1)):
        assert initialiser.try_frame(frame) is None
    other = second.frame(2)
    strange = Frame(2, other.t_s, View(other.view.tracks + 1000, other.view.pixels))
    assert initialiser.try_frame(strange) is None
    assert initialiser.reason == "frames 0 and 2 share only 0 tracks"
    assert initialiser.frames == [strange]


def test_a_map_of_too_few_of_the_shared_tracks_is_none() -> None:
    """Half of the tracks go their own way: what is left is less than the 60 % asked for."""
    sequence = drive(sideways(12, 0.25), sigma_px=0.1)
    rng = np.random.default_rng(5)
    loose = rng.permutation(300)[:150]
    frames = []
    for frame in sequence:
        pixels = frame.view.pixels.copy()
        pixels[loose] += rng.normal(0, 25, (150, 2))
        frames.append(Frame(frame.number, frame.t_s, View(frame.view.tracks, pixels)))
    initialiser = Initialiser(INTRINSICS, SETTINGS)
    assert all(initialiser.try_frame(frame) is None for frame in frames)
    assert "points from" in initialiser.reason
    easy = Initialiser(INTRINSICS, SlamSettings(start_point_ratio=0.2))
    assert any(easy.try_frame(frame) is not None for frame in frames)


TURN = Rotation.from_rotvec([0.1, 0.8, -0.2]).as_matrix()
SPEED = 5.0  # Of the map before the loss: 0.5 in a tenth of a second.
LOST_S = 1.0


def test_ctrl_c_while_a_start_is_adjusted_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    solve = initialisation.solve

    def interrupted(*args: Any, **options: Any) -> Summary:
        return replace(solve(*args, **options), termination="interrupted")

    monkeypatch.setattr(initialisation, "solve", interrupted)
    with pytest.raises(KeyboardInterrupt):
        offered(drive(sideways(30, 0.05)))


def run_before(sensors: Sequence[MotionSensor]) -> tuple[SlamResult, SensorSuite, Follower]:
    """A run whose map has three keyframes and has been lost; its camera is followed to frame 100."""
    world = small_map([[0, 1, 2]] * 3)
    for k, keyframe in enumerate(world.keyframes):
        keyframe.frame = k
    poses = {100: np.column_stack([TURN, [4.0, 5.0, 6.0]])}
    times = {0: 0.0, 1: STEP_S, 2: 2 * STEP_S, 100: LOST_S}
    result = SlamResult(path=Path(poses, times, world), lost=[100], metric=True)
    suite = SensorSuite(sensors)
    return result, suite, Follower(INTRINSICS, SETTINGS, suite)


def new_part() -> WorldMap:
    """Three keyframes from frame 100 on, in a world of their own whose first camera is its origin."""
    part = WorldMap(INTRINSICS)
    cloud = np.random.default_rng(2).uniform([-2, -2, 6], [2, 2, 10], (4, 3))
    for k in range(3):
        pose = np.column_stack([Rotation.from_rotvec([0, 0.1 * k, 0]).as_matrix(), [0.1 * k, 0, 0.2 * k]])
        tracks = np.arange(2, 6, dtype=np.int32)
        part.add(Frame(100 + k, LOST_S + k * STEP_S, View(tracks, project(pose, cloud))), pose)
    part.points[2:6] = cloud
    return part


def odometer(metres_per_second: float) -> Odometer:
    t_s = np.linspace(0, 2, 21)
    return Odometer(SensorStream(t_s, metres_per_second * t_s, "distance"))


@pytest.mark.parametrize(
    ("sensors", "speed"), [([], SPEED), ([odometer(3.0)], 3.0)], ids=["speed so far", "odometer"]
)
def test_a_part_starts_where_it_was_followed_to_and_is_as_long_as_the_way(
    sensors: list[MotionSensor], speed: float
) -> None:
    result, suite, follower = run_before(sensors)
    part = new_part()
    own = np.linalg.norm(np.diff(part.poses[:, :, 3], axis=0), axis=1).sum()
    anchor = result.poses[100]
    place = Similarity(2 * STEP_S * speed / own, anchor[:, :3], anchor[:, 3])
    rejoin(result, part, suite, follower)
    world = result.world
    assert world is not None
    assert [keyframe.frame for keyframe in world.keyframes] == [0, 1, 2, 100, 101, 102]
    np.testing.assert_allclose(world.poses[3:], place.apply_to_poses(part.poses), atol=1e-12)
    np.testing.assert_allclose(world.poses[3], anchor, atol=1e-12)
    np.testing.assert_allclose(world.points[2:6], place.apply(part.points[2:6]), atol=1e-12)
    for keyframe in world.keyframes[3:]:
        seen = project(keyframe.pose, world.points[keyframe.view.tracks])
        np.testing.assert_allclose(seen, keyframe.view.pixels, atol=1e-9)
    # From now on frame 100 is where the map says.
    world.poses[3, 0, 3] += 1.0
    assert result.poses[100][0, 3] == world.poses[3, 0, 3]


def test_the_adjustment_of_a_new_part_does_not_look_behind_its_first_keyframe() -> None:
    result, suite, follower = run_before([])
    rejoin(result, new_part(), suite, follower)
    world = result.world
    assert world is not None
    assert world.part_start == 3
    local = world.around(SETTINGS.window)
    assert (local.images[~local.problem.fixed_cameras] >= 3).all()
    assert world.triangulation(8).images.tolist() == [3, 4, 5]


def test_sensors_constrain_a_new_part_from_the_gap_before_it_on_with_their_usual_weight() -> None:
    result, suite, follower = run_before([odometer(3.0)])
    part = new_part()
    rejoin(result, part, suite, follower)
    world = result.world
    assert world is not None
    told = [keyframe.constraints for keyframe in world.keyframes[3:]]
    assert [len(constraints) for constraints in told] == [1, 1, 1]
    gap_s = world.keyframes[3].t_s - world.keyframes[2].t_s
    for (constraint,), seconds in zip(told, (gap_s, STEP_S, STEP_S), strict=True):
        assert constraint.weight == 1.0
        assert constraint.measurement.value == pytest.approx(3.0 * seconds)
