"""The loop as a whole: exact on exact data, and correct where there is nothing to go by."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import fit_pose_similarity
from sfmcpp.model import Problem
from sfmcpp.slam import Path, SlamResult, SlamSettings, TrackSequence, run_slam
from sfmcpp.sources.synthetic import add_outliers, corridor_scene, street_loop_scene
from slam_helpers import STEP_S, drive, path, sequence_of


def corridor(sigma_px: float = 0.0) -> Problem:
    return corridor_scene(40, 2500, length_m=20.0, pixel_sigma_px=sigma_px, seed=0)


def relative_errors(result: SlamResult, truth: np.ndarray) -> tuple[float, float]:
    """Largest error of the centres over the length of the path, and of the rotations [rad], once aligned."""
    frames = sorted(result.poses)
    found = np.stack([result.poses[frame] for frame in frames])
    aligned = fit_pose_similarity(found, truth[frames]).apply_to_poses(found)
    length = np.linalg.norm(np.diff(truth[:, :, 3], axis=0), axis=1).sum()
    distances = np.linalg.norm(aligned[:, :, 3] - truth[frames, :, 3], axis=1)
    turned = np.linalg.norm(aligned[:, :, :3] - truth[frames, :, :3], axis=(1, 2)) / np.sqrt(2)
    return float(distances.max() / length), float(turned.max())


@pytest.mark.parametrize("scene", [corridor(), street_loop_scene(120, 4000, pixel_sigma_px=0.0, seed=0)])
def test_exact_tracks_give_the_exact_trajectory_up_to_a_similarity(scene: Problem) -> None:
    result = run_slam(sequence_of(scene))
    assert sorted(result.poses) == list(range(scene.num_cameras))
    assert (result.lost, result.bridged, result.message) == ([], [], "")
    distance, angle = relative_errors(result, scene.cameras)
    assert distance < 1e-5
    assert angle < 1e-5


def test_points_of_the_map_are_those_of_the_scene() -> None:
    scene = corridor()
    result = run_slam(sequence_of(scene))
    assert result.world is not None
    frames = sorted(result.poses)
    similarity = fit_pose_similarity(np.stack([result.poses[k] for k in frames]), scene.cameras[frames])
    known = np.flatnonzero(result.world.known)
    assert len(known) > 0.8 * scene.num_points
    np.testing.assert_allclose(similarity.apply(result.world.points[known]), scene.points[known], atol=1e-3)


def test_noise_and_outliers_cost_a_little_accuracy_and_no_frame() -> None:
    noisy, _ = add_outliers(corridor(0.5), 0.05, seed=1)
    result = run_slam(sequence_of(noisy))
    assert len(result.poses) == noisy.num_cameras
    assert result.lost == []
    distance, angle = relative_errors(result, noisy.cameras)
    assert distance < 0.01
    assert angle < 0.01


def test_the_same_seed_gives_the_same_bits() -> None:
    noisy, _ = add_outliers(corridor(0.5), 0.05, seed=1)
    one, other = (run_slam(sequence_of(noisy), SlamSettings(seed=3)) for _ in range(2))
    assert one.world is not None
    assert other.world is not None
    np.testing.assert_array_equal(one.world.points, other.world.points)
    for frame, pose in one.poses.items():
        np.testing.assert_array_equal(pose, other.poses[frame])


def test_frames_that_see_nothing_are_predicted_and_told_and_the_rest_is_found() -> None:
    scene = corridor()
    blind = [20, 21]
    seen = ~np.isin(scene.camera_index, blind)
    for name in ("camera_index", "point_index", "pixels"):
        setattr(scene, name, getattr(scene, name)[seen])
    result = run_slam(sequence_of(scene))
    assert result.lost == blind
    assert len(result.poses) == scene.num_cameras
    # The walk is even, so that even the predicted poses are right.
    assert relative_errors(result, scene.cameras)[0] < 1e-5


def test_a_standing_camera_gives_a_message_and_no_map() -> None:
    standing = path(np.zeros((30, 3)), np.zeros((30, 3)))
    result = run_slam(drive(standing, sigma_px=0.5))
    assert result.world is None
    assert result.poses == {}
    assert "the image moves" in result.message
    with pytest.raises(InvalidArgument, match="no frame has a pose: the image moves"):
        result.trajectory()


def with_still_tracks(scene: Problem, count: int) -> TrackSequence:
    """A drive with tracks that stand still near the lower border of all images, as those of a bonnet."""
    rng = np.random.default_rng(0)
    still = rng.uniform([100, 440], [500, 470], (count, 2))
    frames, tracks = np.divmod(np.arange(scene.num_cameras * count), count)
    return TrackSequence(
        STEP_S * np.arange(scene.num_cameras),
        np.concatenate([scene.camera_index, frames]),
        np.concatenate([scene.point_index, scene.num_points + tracks]),
        np.concatenate([scene.pixels, still[tracks] + rng.normal(0, 0.05, (len(tracks), 2))]),
        scene.intrinsics[0],
    )


def test_tracks_that_stand_still_while_the_camera_moves_are_a_warning() -> None:
    told = "tracks stand still in the image while the camera moves"
    assert not any(told in warning for warning in run_slam(sequence_of(corridor(0.5))).warnings)
    result = run_slam(with_still_tracks(corridor(0.5), 12))
    (warning,) = (text for text in result.warnings if told in text)
    u, v = (tuple(map(int, re.findall(rf"{axis} = (\d+) to (\d+)", warning)[0])) for axis in "uv")
    assert 100 <= u[0] < u[1] <= 500
    assert 440 <= v[0] < v[1] <= 470


def test_a_start_that_waits_for_tracks_that_stand_still_tells_of_them() -> None:
    scene = corridor(0.5)
    seen = np.count_nonzero(scene.camera_index == scene.num_cameras - 1)
    message = run_slam(with_still_tracks(scene, seen)).message
    assert f"{seen} of its {2 * seen} tracks stand still while the others change" in message
    standing = run_slam(drive(path(np.zeros((30, 3)), np.zeros((30, 3))), sigma_px=0.1))
    assert "stand still" not in standing.message


@pytest.mark.parametrize("sigma_px", [0.0, 0.5])
def test_a_camera_that_only_turns_gives_a_message_and_no_map(sigma_px: float) -> None:
    angles = np.linspace(0, 0.3, 30)[:, None] * [0.1, 1.0, 0.0]
    result = run_slam(drive(path(np.zeros((30, 3)), angles), sigma_px=sigma_px))
    assert result.world is None
    assert result.poses == {}
    assert "rotation" in result.message


def test_a_camera_that_first_stands_starts_late() -> None:
    centres = np.zeros((50, 3))
    centres[20:, 0] = 0.1 * np.arange(30)
    truth = path(centres, np.zeros((50, 3)))
    result = run_slam(drive(truth, sigma_px=0.2))
    assert result.world is not None
    assert max(result.poses) == 49
    moving = {frame: pose for frame, pose in result.poses.items() if frame >= 20}
    assert len(moving) == 30
    assert relative_errors(SlamResult(path=Path(moving)), truth)[0] < 0.02


def test_one_frame_gives_a_message_and_no_map() -> None:
    result = run_slam(drive(path(np.zeros((1, 3)), np.zeros((1, 3)))))
    assert result.world is None
    assert result.message


def test_the_callback_sees_every_frame_and_the_growing_result() -> None:
    seen: list[tuple[int, int]] = []
    sequence: TrackSequence = sequence_of(corridor())
    result = run_slam(sequence, callback=lambda frame, state: seen.append((frame, len(state.poses))))
    assert [frame for frame, _ in seen] == list(range(len(sequence)))
    counts = [count for _, count in seen]
    assert counts == sorted(counts)
    assert counts[-1] == len(result.poses)


@pytest.mark.parametrize("answer", [False, np.False_, True, np.True_, None, 0, 1])
def test_an_answer_means_what_it_means_in_a_solve_only_false_stops(answer: object) -> None:
    seen: list[int] = []

    def listen(frame: int, _: SlamResult) -> object:
        seen.append(frame)
        return answer

    sequence = sequence_of(corridor())
    run_slam(sequence, callback=listen)
    stops = answer is False or answer is np.False_
    assert len(seen) == (1 if stops else len(sequence))


def test_tracks_too_short_for_the_usual_parallax_start_a_map_all_the_same() -> None:
    centres = np.arange(40)[:, None] * np.array([0.02, 0.0, 0.09])
    truth = path(centres, np.zeros((40, 3)))
    long = drive(truth, sigma_px=0.1, points=280)
    # Each point gets a new track every ten frames, too few for 20 px.
    lives = 10
    views = [long.view(frame) for frame in range(len(long))]
    tracks = [v.tracks + 280 * ((frame + v.tracks % lives) // lives) for frame, v in enumerate(views)]
    frames = np.repeat(np.arange(len(views)), [len(v.tracks) for v in views])
    pixels = np.concatenate([v.pixels for v in views])
    result = run_slam(TrackSequence(long.t_s, frames, np.concatenate(tracks), pixels, long.intrinsics))
    assert sorted(result.poses) == list(range(40))
    assert relative_errors(result, truth)[0] < 0.05


@pytest.mark.parametrize(
    ("fewer", "more"),
    [
        ({"keyframe_overlap": 0.5}, {"keyframe_overlap": 0.9}),
        ({"keyframe_min_tracks": 200, "keyframe_parallax_px": 1e6}, {"keyframe_min_tracks": 200}),
    ],
)
def test_settings_of_keyframes_decide_how_many_there_are(
    fewer: dict[str, float], more: dict[str, float]
) -> None:
    sequence = sequence_of(street_loop_scene(40, 1500, seed=1))
    worlds = [run_slam(sequence, SlamSettings(**given)).world for given in (fewer, more)]  # type: ignore[arg-type]
    counts = [len(world.keyframes) for world in worlds if world is not None]
    assert 3 < counts[0] < counts[1]
