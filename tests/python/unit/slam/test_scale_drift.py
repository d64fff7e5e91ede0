"""The uncertainty of a map's scale by the images alone: of a step, from start to end, and the warning."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.model.frames import View
from sfmcpp.slam import (
    Frame,
    KeyframeRecord,
    SlamResult,
    SlamSettings,
    TrackSequence,
    WorldMap,
    run_slam,
    scale_sigmas,
)
from sfmcpp.slam.path import Path
from sfmcpp.slam.scale_drift import step_sigma, warn_of_scale
from sfmcpp.weighting import PoseView, refine_pose
from slam_helpers import INTRINSICS, path, project

SETTINGS = SlamSettings()
PREVIOUS = np.eye(3, 4)
POSE = np.column_stack([Rotation.from_rotvec([0.01, 0.05, 0.0]).as_matrix(), [0.1, 0.0, 1.0]])
LENGTH = float(np.linalg.norm(POSE[:, 3]))


def cloud(points: int) -> np.ndarray:
    return np.random.default_rng(5).uniform([-4, -2, 8], [4, 2, 20], (points, 3))


def map_of(points: np.ndarray) -> WorldMap:
    """A map of one keyframe with exact points."""
    tracks = np.arange(len(points), dtype=np.int32)
    world = WorldMap(INTRINSICS)
    world.add(Frame(0, 0.0, View(tracks, project(PREVIOUS, points))), PREVIOUS)
    world.points[:] = points
    return world


def result_of(*steps: tuple[int, float], restarts: tuple[int, ...] = ()) -> SlamResult:
    """A run whose first keyframe is frame 0, and the others those of the steps and restarts."""
    world = map_of(cloud(10))
    view = world.keyframes[0].view
    for frame in sorted([*dict(steps), *restarts]):
        world.add(Frame(frame, float(frame), view), POSE)
    records = [KeyframeRecord(frame, float(frame), 10, step_sigma=sigma) for frame, sigma in steps]
    return SlamResult(Path(world=world), records, restarts=list(restarts))


@pytest.mark.parametrize("count", [12, 60])
def test_the_uncertainty_of_a_step_is_how_its_length_scatters(count: int) -> None:
    """Against the scatter of the lengths of poses fitted to other noise of the images."""
    points, sigma_px = cloud(count), 0.7
    world, rng = map_of(points), np.random.default_rng(2)
    tracks, exact = np.arange(count, dtype=np.int32), project(POSE, points)
    lengths, expected = [], []
    for _ in range(300):
        pixels = exact + rng.normal(0, sigma_px, exact.shape)
        pose = refine_pose(PoseView(points, pixels, INTRINSICS), [], POSE).pose
        lengths.append(np.linalg.norm(pose[:, 3]))
        expected.append(step_sigma(world, View(tracks, pixels), pose, SETTINGS))
    scatter = np.std(lengths) / LENGTH
    assert np.sqrt(np.mean(np.square(expected))) == pytest.approx(scatter, rel=0.15)
    assert scatter > 0.003


def test_few_points_leave_a_step_open_and_more_noise_does_not_exceed_that() -> None:
    few, many = cloud(7), cloud(30)
    tracks = np.arange(30, dtype=np.int32)
    left_open = step_sigma(map_of(few), View(tracks[:7], project(POSE, few)), POSE, SETTINGS)
    rng = np.random.default_rng(0)
    noisy = project(POSE, many) + rng.normal(0, 1.0, (30, 2))
    near = POSE.copy()
    near[:, 3] *= 0.15  # a short step, in the noise
    moved = project(near, many) + rng.normal(0, 1.0, (30, 2))
    sigma = step_sigma(map_of(many), View(tracks, noisy), POSE, SETTINGS)
    assert 0 < sigma < step_sigma(map_of(many), View(tracks, moved), near, SETTINGS) <= left_open


def test_a_standing_camera_carries_the_scale_nowhere() -> None:
    points = cloud(40)
    standing = POSE.copy()
    standing[:, 3] = [0.002, 0.001, 0.03]  # a quarter of a degree, seen from the points
    view = View(np.arange(40, dtype=np.int32), project(standing, points))
    assert step_sigma(map_of(points), view, standing, SETTINGS) == 0.0


def test_variances_of_steps_add_up_to_each_keyframe_and_a_new_part_is_open() -> None:
    sigmas = scale_sigmas(result_of((5, 0.03), (9, 0.04), (12, 0.12)))
    assert sigmas is not None
    np.testing.assert_allclose(sigmas, [0.0, 0.03, 0.05, 0.13])
    restarted = scale_sigmas(result_of((5, 0.03), restarts=(8,)))
    assert restarted is not None
    assert restarted[-1] > 0.25


def test_a_scale_that_sensors_hold_has_no_uncertainty_by_the_images() -> None:
    result = result_of((5, 0.9), (9, 0.9))
    assert warn_of_scale(result)
    result.metric = True
    assert scale_sigmas(result) is None
    assert warn_of_scale(result) == []
    assert scale_sigmas(SlamResult()) is None
    assert warn_of_scale(SlamResult()) == []


def test_a_warning_names_the_frames_that_leave_the_scale_open() -> None:
    sound = [(frame, 0.02) for frame in range(1, 40, 2)]
    assert warn_of_scale(result_of(*sound)) == []
    weak = [(51, 0.3), (53, 0.3), (70, 0.3)]
    (warning,) = warn_of_scale(result_of(*sound, *weak))
    assert "at frames 51 to 53, 70;" in warning
    assert "by a factor of 1.7" in warning  # exp √(3 · 0.3² + 20 · 0.02²)


def short_tracks(points: int) -> TrackSequence:
    """A way aside of 30 frames; each point is seen for ten of them."""
    rng = np.random.default_rng(1)
    first = rng.integers(-9, 30, points)
    places = rng.uniform([-4, -3, 10], [4, 3, 18], (points, 3)) + np.outer(first + 5, [0.6, 0, 0])
    frames, tracks, pixels = [], [], []
    for frame, pose in enumerate(path(np.outer(np.arange(30), [0.6, 0, 0]), np.zeros((30, 3)))):
        seen = np.flatnonzero((frame >= first) & (frame < first + 10))
        frames += [frame] * len(seen)
        tracks += seen.tolist()
        pixels.append(project(pose, places[seen]) + rng.normal(0, 0.5, (len(seen), 2)))
    return TrackSequence(0.1 * np.arange(30), frames, tracks, np.concatenate(pixels), INTRINSICS)


def test_a_drive_with_few_tracks_holds_its_scale_worse() -> None:
    ends = []
    for points in (1500, 120):
        sigmas = scale_sigmas(run_slam(short_tracks(points), SETTINGS))
        assert sigmas is not None
        assert (np.diff(sigmas) >= 0).all()
        ends.append(sigmas[-1])
    assert 0 < 2 * ends[0] < ends[1]


def test_the_warning_of_a_long_run_names_a_few_stretches() -> None:
    (told,) = warn_of_scale(result_of(*((100 * k, 0.3) for k in range(1, 60))))
    assert "at frames 100, 200, 300, 400, 500, 600, 700, 800 and in 40 more stretches; an odometer" in told
