"""Right images tell the metre, from the start to the end, and so do sensors beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import SensorStream
from sfmcpp.model.frames import Frame, RightView, View
from sfmcpp.slam import SlamResult, SlamSettings, TrackSequence, WorldMap, run_slam
from sfmcpp.slam.baseline_check import warn_of_baseline
from sfmcpp.slam.initialisation import Initialiser
from sfmcpp.slam.mapping import adjust
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.position_sensors import Gps
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.stereo import metres_per_unit, with_right_views
from sfmcpp.sources.drives import open_drive
from sfmcpp.study.evaluation import evaluate
from slam_helpers import INTRINSICS, STEP_S, path, project, small_map

BASELINE_M = 0.5
# Some 40 m ahead, in a gentle bend.
NUM_FRAMES = 80
POSES = path(
    np.column_stack([0.0008 * np.arange(NUM_FRAMES) ** 2, np.zeros(NUM_FRAMES), 0.5 * np.arange(NUM_FRAMES)]),
    np.outer(0.003 * np.arange(NUM_FRAMES), [0, 1, 0]),
)


def beside(pose: np.ndarray, centre_m: Sequence[float] = (BASELINE_M, 0.0, 0.0)) -> np.ndarray:
    """Pose of the right camera."""
    moved = pose.copy()
    moved[:, 3] += pose[:, :3] @ centre_m
    return moved


def sequence(*, wrong: float = 0.0, stereo: bool = True, seed: int = 0) -> TrackSequence:
    """What both cameras see of points on both sides of the way; a share of the right pixels is `wrong`."""
    rng = np.random.default_rng(seed)
    cloud = rng.uniform([-12, -3, 4], [16, 3, 70], (2500, 3))
    frames, tracks, left, right = [], [], [], []
    for k, pose in enumerate(POSES):
        depth = (cloud - pose[:, 3]) @ pose[:, 2]
        seen = np.flatnonzero((depth > 4) & (depth < 25))
        pixels = project(pose, cloud[seen])
        seen = seen[((pixels > 0) & (pixels < [640, 480])).all(axis=1)][::3]
        frames.append(np.full(len(seen), k))
        tracks.append(seen)
        left.append(project(pose, cloud[seen]))
        right.append(project(beside(pose), cloud[seen]))
    exact = (np.concatenate(left), np.concatenate(right))
    seen_left, seen_right = (pixels + rng.normal(0, 0.2, pixels.shape) for pixels in exact)
    gross = rng.random(len(seen_right)) < wrong
    seen_right[gross, 0] += 3.0
    both = (seen_right, BASELINE_M) if stereo else ()
    index = np.concatenate(frames), np.concatenate(tracks)
    return TrackSequence(STEP_S * np.arange(NUM_FRAMES), *index, seen_left, INTRINSICS, *both)


def scales(result: SlamResult) -> np.ndarray:
    """Length of the way over the true one, of the first and of the last quarter."""
    return ratios(np.stack([result.poses[k] for k in range(NUM_FRAMES)]), POSES, NUM_FRAMES // 4)


def ratios(poses: np.ndarray, truth: np.ndarray, count: int) -> np.ndarray:
    """Length of the way over the true one, of the first and of the last `count` steps."""
    steps, true = (np.linalg.norm(np.diff(p[:, :, 3], axis=0), axis=1) for p in (poses, truth))
    return np.array([steps[part].sum() / true[part].sum() for part in (slice(count), slice(-count, None))])


@pytest.mark.parametrize("wrong", [0.0, 0.25])
def test_a_map_with_right_images_is_in_metres_from_start_to_end(wrong: float) -> None:
    result = run_slam(sequence(wrong=wrong))
    assert result.metric
    assert np.abs(scales(result) - 1).max() < 0.02


def test_one_pair_of_images_is_enough_to_start() -> None:
    frames = sequence()
    world = Initialiser(INTRINSICS, SlamSettings()).try_frame(frames.frame(0))
    assert world is not None
    assert world.metric
    assert [keyframe.frame for keyframe in world.keyframes] == [0]
    known = frames.view(0).tracks[world.knows(frames.view(0).tracks)]
    assert len(known) > 30
    left_alone = sequence(stereo=False)
    assert Initialiser(INTRINSICS, SlamSettings()).try_frame(left_alone.frame(0)) is None


def test_a_pair_that_sees_next_to_nothing_starts_no_map() -> None:
    frame = sequence().frame(0)
    few = Frame(0, 0.0, frame.view.only(np.arange(len(frame.view.tracks)) < 20))
    assert Initialiser(INTRINSICS, SlamSettings()).try_frame(few) is None


def test_a_map_of_the_left_images_alone_is_in_a_unit_of_its_own() -> None:
    result = run_slam(sequence(stereo=False))
    assert not result.metric
    assert np.abs(scales(result) - 1).max() > 0.1


def test_the_metre_survives_the_final_adjustment() -> None:
    result = run_slam(sequence(), SlamSettings(final_adjustment="on"))
    assert result.final is not None
    assert result.final.kept
    assert result.final.sensors == {}
    assert np.abs(scales(result) - 1).max() < 0.02


@pytest.mark.parametrize(("factor", "told"), [(1.0, []), (0.9, ["odometer: its metres are 0.9"])])
def test_an_odometer_of_other_metres_than_the_right_images_is_named(factor: float, told: list[str]) -> None:
    steps = np.linalg.norm(np.diff(POSES[:, :, 3], axis=0, prepend=POSES[:1, :, 3]), axis=1)
    way = SensorStream(STEP_S * np.arange(NUM_FRAMES), factor * np.cumsum(steps), "distance", "odometer")
    found = run_slam(sequence(), sensors=[Odometer(way, "odometer")]).warnings
    named = [warning for warning in found if "of those of the right images: the baseline of 0.5 m" in warning]
    assert len(named) == len(told)
    assert all(warning.startswith(start) for warning, start in zip(named, told, strict=True))


@pytest.mark.parametrize("factor", [1.0, 1.1])
def test_positions_of_other_metres_than_the_right_images_are_named(factor: float) -> None:
    places = SensorStream(STEP_S * np.arange(NUM_FRAMES), factor * POSES[:, :, 3], "position", "gps")
    world = run_slam(sequence()).world
    named = warn_of_baseline(world, SensorSuite([Gps(places, None, "gps")]))
    assert [warning.split(" of those")[0] for warning in named] == ["gps: its metres are 1.1"] * (factor > 1)


# A right camera that is also higher and behind.
OBLIQUE_M = (0.5, -0.1, -0.2)


def stereo_map(unit_m: float = 1.0, baseline_m: float | Sequence[float] = BASELINE_M) -> WorldMap:
    """Three keyframes that see thirty points, in that unit."""
    centre_m = RightView(np.empty((0, 2)), baseline_m).centre_m
    world = small_map([list(range(30))] * 3)
    points = world.points.copy()
    stereo = WorldMap(INTRINSICS)
    for keyframe in world.keyframes:
        view = keyframe.view
        right = RightView(project(beside(keyframe.pose, centre_m), points[view.tracks]), baseline_m)
        frame = Frame(keyframe.frame, keyframe.t_s, View(view.tracks, view.pixels, right))
        stereo.add(frame, keyframe.pose)
    stereo.points[:] = points
    stereo.transform(Similarity(1 / unit_m, np.eye(3), np.zeros(3)))
    return stereo


@pytest.mark.parametrize("baseline_m", [BASELINE_M, OBLIQUE_M])
def test_right_images_tell_the_unit_and_some_wrong_ones_do_not_matter(
    baseline_m: float | Sequence[float],
) -> None:
    world = stereo_map(3.0, baseline_m)
    world.right_px[::4, 0] -= 15.0
    assert metres_per_unit(world) == pytest.approx(3.0, rel=1e-9)
    world.right_px[9:] = np.nan
    assert metres_per_unit(world) is None


def test_wrong_right_pixels_are_forgotten_and_left_ones_stay() -> None:
    world = stereo_map()
    points = world.points.copy()
    world.metric = True
    world.right_px[[3, 40]] += [0.0, 9.0]
    adjust(world, SlamSettings())
    assert np.isnan(world.right_px[[3, 40]]).all()
    assert np.isfinite(world.right_px).all(axis=1).sum() == 88
    assert (world.keypoint_points >= 0).all()
    np.testing.assert_allclose(world.points, points, rtol=0, atol=1e-3)


@pytest.mark.parametrize("centre_m", [(BASELINE_M, 0.0, 0.0), OBLIQUE_M])
def test_a_right_camera_stays_where_it_is_beside_its_left_one(centre_m: Sequence[float]) -> None:
    world = stereo_map(baseline_m=centre_m)
    world.metric = True
    both = with_right_views(world, world.around(3))
    left, right = both.problem.cameras[:3], both.problem.cameras[3:]
    for one, other in zip(left, right, strict=True):
        np.testing.assert_allclose(other, beside(one, centre_m), rtol=0, atol=1e-15)
    adjust(world, SlamSettings())
    assert np.isfinite(world.right_px).all()
    assert both.problem.num_observations == 2 * len(both.local.rows)


def test_parts_of_a_map_keep_their_right_images() -> None:
    world, part = stereo_map(), stereo_map()
    world.append(part, Similarity(1.0, np.eye(3), np.array([5.0, 0.0, 0.0])))
    assert world.right_px.shape == (180, 2)
    np.testing.assert_array_equal(world.right_px[90:], part.right_px)


def test_without_right_images_a_problem_is_what_it_was() -> None:
    world = small_map([list(range(30))] * 3)
    world.metric = True
    local = world.around(3)
    assert with_right_views(world, local).problem is local.problem


@pytest.mark.parametrize(
    ("right", "told"),
    [
        ((np.zeros((1, 2)), 0.5), r"right_px: shape \(1, 2\), must be \(2, 2\)"),
        ((np.zeros((2, 2)),), "baseline_m: missing"),
        ((np.zeros((2, 2)), -0.5), "baseline_m = -0.5"),
        (
            (np.zeros((2, 2)), [0.0, 0.0, 0.0]),
            "baseline_m = 0, 0, 0: the cameras of a pair must not be in one",
        ),
        ((np.zeros((2, 2)), [0.5, 0.0]), r"baseline_m: shape \(2,\), must be \(3\)"),
    ],
)
def test_right_pixels_that_cannot_be_are_refused(right: tuple[object, ...], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        TrackSequence([0.0], [0, 0], [0, 1], np.zeros((2, 2)), INTRINSICS, *right)


def test_an_input_without_right_images_has_no_stereo(tmp_path: Path) -> None:
    (tmp_path / "tracks.txt").write_text("0 0 1 1\n")
    with pytest.raises(DatasetError, match="stereo: only KITTI drives"):
        open_drive(tmp_path / "tracks.txt", stereo=True)


@pytest.mark.real
def test_a_drive_that_loses_its_scale_keeps_it_with_the_right_images(data_dir: Path) -> None:
    file = data_dir / "kitti_tracks/2011_09_26_drive_0036_sync_KLT.mat"
    ends = []
    for stereo in (False, True):
        drive = open_drive(file, stereo=stereo)
        result = run_slam(drive.frames)
        assert drive.truth is not None
        found = evaluate(result.trajectory(), drive.truth, with_scale=not result.metric)
        first, last = ratios(found.estimate.poses, found.truth.poses, 50)
        ends.append(last / first)
    assert ends[0] < 0.8
    assert ends[1] == pytest.approx(1.0, abs=0.05)
