"""The whole loop with little or nothing to start from: a message or a late start, never a wrong map."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import SensorStream
from sfmcpp.slam import Gyroscope, Odometer, Slam, SlamResult, TrackSequence, run_slam
from slam_helpers import INTRINSICS, STEP_S, drive, path, project
from winding import AT_CAMERA, length

MOVING = 40
STANDING_FIRST = 20


def turned(count: int, angle_rad: float) -> np.ndarray:
    """Rotation vectors (count, 3) of a camera that pans evenly."""
    return np.linspace(0.0, 1.0, count)[:, None] * [0.0, angle_rad, 0.0]


def largest_error(result: SlamResult, truth: np.ndarray) -> float:
    """Largest error of a centre over the length of the path, once aligned by all poses."""
    frames = sorted(result.poses)
    found = np.stack([result.poses[frame] for frame in frames])
    aligned = fit_pose_similarity(found, truth[frames]).apply_to_poses(found)
    return float(np.linalg.norm(aligned[:, :, 3] - truth[frames, :, 3], axis=1).max() / length(truth))


def require_no_map(result: SlamResult, told: str) -> None:
    assert result.world is None
    assert result.poses == {}
    assert told in result.message


def test_no_frame_gives_a_message_and_no_map() -> None:
    slam = Slam(INTRINSICS)
    slam.finish()
    require_no_map(slam.result, "there is no frame")


@pytest.mark.parametrize(("frames", "told"), [(1, "frame 0 is the only frame"), (2, "the image moves")])
def test_one_frame_or_two_give_a_message_and_no_map(frames: int, told: str) -> None:
    require_no_map(run_slam(drive(path(np.zeros((frames, 3)), np.zeros((frames, 3))), 0.5)), told)


def test_frames_that_share_nothing_give_a_message_and_no_map() -> None:
    pixels = np.random.default_rng(0).uniform(0, 480, (200, 2))
    frames, tracks = np.repeat(np.arange(4), 50), np.arange(200)
    sequence = TrackSequence(STEP_S * np.arange(4), frames, tracks, pixels, INTRINSICS)
    require_no_map(run_slam(sequence), "share only 0 tracks")


def test_tracks_of_noise_give_no_map() -> None:
    """Each track jumps about the image at random: there is no geometry in it."""
    pixels = np.random.default_rng(1).uniform(0, 480, (30 * 100, 2))
    frames, tracks = (index.ravel() for index in np.indices((30, 100)))
    sequence = TrackSequence(STEP_S * np.arange(30), frames, tracks, pixels, INTRINSICS)
    result = run_slam(sequence)
    assert result.world is None
    assert result.message.startswith("frames 0 and ")


@pytest.mark.parametrize("sigma_px", [0.0, 1.0])
def test_a_standing_camera_has_no_map_even_with_sensors(sigma_px: float) -> None:
    ticks = np.arange(0.0, 3.0, 0.05)
    creeping = SensorStream(ticks, np.full(len(ticks), 0.01), "speed")
    drifting = SensorStream(ticks, np.full((len(ticks), 3), 0.01), "angular_rate")
    standing = drive(path(np.zeros((30, 3)), np.zeros((30, 3))), sigma_px)
    result = run_slam(standing, sensors=[Odometer(creeping), Gyroscope(drifting, AT_CAMERA)])
    require_no_map(result, "the image moves")


@pytest.mark.parametrize("axis", [(0.1, 1.0, 0.0), (0.0, 0.0, 3.0)])
@pytest.mark.parametrize("sigma_px", [0.3, 1.0])
def test_a_camera_that_turns_and_shakes_a_little_has_no_map(
    axis: tuple[float, float, float], sigma_px: float
) -> None:
    """Three millimetres of shaking among points ten metres off are a parallax below the noise."""
    shaking = np.random.default_rng(0).normal(0, 0.003, (MOVING, 3))
    angles = np.linspace(0, 0.4, MOVING)[:, None] * axis
    require_no_map(run_slam(drive(path(shaking, angles), sigma_px)), "rotation only")


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_camera_that_first_turns_on_the_spot_starts_late_and_right(
    direction: tuple[float, float, float], seed: int
) -> None:
    moved = 0.1 * np.concatenate([np.zeros(STANDING_FIRST), np.arange(MOVING)])
    angles = np.concatenate([turned(STANDING_FIRST, -0.3), np.tile(turned(2, -0.3)[1], (MOVING, 1))])
    truth = path(moved[:, None] * direction, angles)
    starts: list[int] = []
    sequence = drive(truth, 0.3, seed=seed)
    result = run_slam(sequence, callback=lambda k, r: starts.append(k) if r.world is not None else None)
    assert starts[0] > STANDING_FIRST
    assert starts[-1] in result.poses
    assert largest_error(result, truth) < 0.01


@pytest.mark.parametrize("seed", [0, 1])
def test_a_camera_that_pans_away_from_all_it_saw_starts_where_it_moves(seed: int) -> None:
    """Half a turn on the spot: no track of the start is left once the camera moves."""
    angles = np.concatenate([turned(60, np.pi), np.tile(turned(2, np.pi)[1], (MOVING, 1))])
    centres = np.concatenate([np.zeros((60, 3)), 0.2 * np.arange(MOVING)[:, None] * [0.0, 0.0, -1.0]])
    truth = path(centres, angles)
    sequence = seen_all_round(truth, seed)
    result = run_slam(sequence)
    assert result.world is not None
    assert 55 < min(result.poses) < 65
    assert sorted(result.poses) == list(range(min(result.poses), 60 + MOVING))
    assert largest_error(result, truth) < 0.02
    # What was seen before the camera moved has no depth, and so no points of the map.
    before = run_slam(TrackSequence(sequence.t_s[:60], *first_frames(sequence, 60), INTRINSICS))
    require_no_map(before, "")


@pytest.mark.parametrize("looks_round", [False, True])
def test_a_camera_that_stops_stays_where_it_is_and_goes_on(looks_round: bool) -> None:
    moved = 0.1 * np.concatenate([np.arange(30), np.full(30, 29), np.arange(29, 49)])
    angles = np.zeros((80, 3))
    if looks_round:
        angles[30:60, 1] = 0.2 * np.sin(np.linspace(0, 2 * np.pi, 30))
    truth = path(moved[:, None] * [1.0, 0.0, 0.0], angles)
    result = run_slam(drive(truth, 0.3))
    assert sorted(result.poses) == list(range(80))
    assert (result.lost, result.bridged) == ([], [])
    assert largest_error(result, truth) < 0.005


def seen_all_round(truth: np.ndarray, seed: int) -> TrackSequence:
    """What a camera sees, within its image, of points all round its start."""
    rng = np.random.default_rng(seed)
    around = rng.uniform([-25, -4, -25], [25, 3, 25], (1500, 3))
    points = around[np.linalg.norm(around[:, ::2], axis=1) > 6.0]
    seen = [in_image(pose, points) for pose in truth]
    pixels = [project(pose, points[tracks]) for pose, tracks in zip(truth, seen, strict=True)]
    frames = np.concatenate([np.full(len(tracks), k) for k, tracks in enumerate(seen)])
    noisy = np.concatenate(pixels) + rng.normal(0, 0.3, (len(frames), 2))
    return TrackSequence(STEP_S * np.arange(len(truth)), frames, np.concatenate(seen), noisy, INTRINSICS)


def in_image(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which of the points (n, 3) a pose sees."""
    ahead = np.flatnonzero(((points - pose[:, 3]) @ pose[:, :3])[:, 2] > 1.0)
    inside = np.abs(project(pose, points[ahead]) - INTRINSICS[2:4]) < INTRINSICS[2:4]
    return ahead[inside.all(axis=1)]


def first_frames(sequence: TrackSequence, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames, tracks and pixels of the first frames of a sequence."""
    views = [sequence.view(frame) for frame in range(count)]
    frames = np.concatenate([np.full(len(view.tracks), k) for k, view in enumerate(views)])
    return frames, np.concatenate([v.tracks for v in views]), np.concatenate([v.pixels for v in views])
