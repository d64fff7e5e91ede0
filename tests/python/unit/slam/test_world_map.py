"""The map gives out the right part of itself, takes it back, and forgets what is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.geometry.similarity import Similarity
from sfmcpp.map import LocalProblem
from sfmcpp.slam.mapping import hold_gauge
from sfmcpp.slam.world_map import WorldMap
from slam_helpers import project, small_map


def tracks_of(local: LocalProblem) -> list[list[int]]:
    """Tracks that each camera of a part sees."""
    problem = local.problem
    return [
        sorted(local.points[problem.point_index[problem.camera_index == camera]].tolist())
        for camera in range(problem.num_cameras)
    ]


def errors_px(world: WorldMap) -> list[float]:
    """Largest reprojection error of each keyframe over its known points."""
    views = [keyframe.view.only(world.known[keyframe.view.tracks]) for keyframe in world.keyframes]
    return [
        float(np.abs(project(keyframe.pose, world.points[view.tracks]) - view.pixels).max())
        for keyframe, view in zip(world.keyframes, views, strict=True)
    ]


def test_the_part_around_the_last_keyframes_is_fixed_where_older_ones_see_their_points() -> None:
    # Keyframe 1 shares no point with the last two; nor does 2, but a sensor may tie it to keyframe 3.
    world = small_map([[0, 1], [0], [3], [1, 2], [1, 2, 3]], unknown=(3,))
    local = world.around(2)
    assert local.images.tolist() == [0, 2, 3, 4]
    assert local.problem.fixed_cameras.tolist() == [True, True, False, False]
    assert tracks_of(local) == [[1], [], [1, 2], [1, 2]]
    np.testing.assert_array_equal(local.problem.points, world.points[local.points])
    for camera, point, pixel in zip(
        local.problem.camera_index, local.problem.point_index, local.problem.pixels, strict=True
    ):
        expected = project(local.problem.cameras[camera], local.problem.points[[point]])[0]
        np.testing.assert_allclose(pixel, expected, atol=1e-9)


def test_around_more_keyframes_than_there_are_nothing_is_fixed() -> None:
    local = small_map([[0, 1], [0, 1], [1]]).around(10)
    assert local.images.tolist() == [0, 1, 2]
    assert not local.problem.fixed_cameras.any()


def test_a_keyframe_that_sees_nothing_known_does_not_move() -> None:
    local = small_map([[0, 1], [0, 1], [2], [0, 1]], unknown=(2,)).around(3)
    assert local.images.tolist() == [0, 1, 2, 3]
    assert local.problem.fixed_cameras.tolist() == [True, False, True, False]


def test_only_tracks_without_a_point_that_two_recent_keyframes_see_are_triangulated() -> None:
    world = small_map([[0, 1, 2], [1, 3], [1, 2, 3], [0, 2, 3, 4]], unknown=(0, 1, 3, 4))
    local = world.triangulation(3)
    assert local.images.tolist() == [1, 2, 3]
    assert tracks_of(local) == [[1, 3], [1, 3], [3]]


def test_what_has_moved_is_taken_over_and_nothing_else() -> None:
    world = small_map([[0, 1], [1, 2], [1, 2]])
    before = world.points.copy()
    poses = world.poses.copy()
    local = world.around(1)
    local.problem.cameras[-1, 0, 3] += 1.0
    local.problem.points += 2.0
    world.take(local)
    np.testing.assert_array_equal(world.points[:3], before[:3] + np.array([[0.0], [2.0], [2.0]]))
    np.testing.assert_array_equal(world.poses.copy()[:2], poses[:2])
    assert world.keyframes[2].pose[0, 3] == poses[2, 0, 3] + 1.0


def test_a_dropped_observation_is_forgotten_and_a_point_with_too_few_views_too() -> None:
    world = small_map([[0, 1], [0, 1], [0, 1]])
    local = world.around(3)
    camera, track = local.problem.camera_index, local.points[local.problem.point_index]
    wrong = ((camera == 0) & (track == 0)) | ((camera != 1) & (track == 1))
    world.drop(local, wrong, min_views=2)
    assert [keyframe.view.tracks.tolist() for keyframe in world.keyframes] == [[], [0, 1], [0]]
    assert world.known.tolist() == [True, False]
    assert max(errors_px(small_map([[0, 1]]))) < 1e-9
    np.testing.assert_allclose(
        world.keyframes[2].view.pixels, project(world.keyframes[2].pose, world.points[[0]]), atol=1e-9
    )


def test_two_of_three_views_may_be_asked_for() -> None:
    world = small_map([[0, 1], [0, 1], [0]])
    world.drop(world.around(3), np.zeros(5, dtype=bool), min_views=3)
    assert world.known.tolist() == [True, False]


def test_a_similarity_moves_the_map_and_leaves_what_cameras_see() -> None:
    world = small_map([[0, 1, 2], [1, 2, 3]])
    distance = np.linalg.norm(world.points[0] - world.keyframes[1].pose[:, 3])
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    world.transform(Similarity(2.5, turn, np.array([1.0, -4.0, 2.0])))
    assert max(errors_px(world)) < 1e-9
    moved = np.linalg.norm(world.points[0] - world.keyframes[1].pose[:, 3])
    np.testing.assert_allclose(moved, 2.5 * distance)


def test_the_two_oldest_cameras_that_see_points_hold_the_gauge() -> None:
    # Keyframe 1 sees nothing that is known: it does not move, but holds nothing.
    local = small_map([[0, 1], [2], [0, 1], [0, 1]], unknown=(2,)).around(4)
    hold_gauge(local, 2)
    assert local.problem.fixed_cameras.tolist() == [True, True, True, False]


@pytest.mark.parametrize(
    ("moving", "count", "fixed"), [(4, 2, 2), (4, 1, 1), (3, 2, 2), (3, 1, 1), (2, 2, 2), (1, 2, 3)]
)
def test_cameras_fixed_already_count_for_the_gauge(moving: int, count: int, fixed: int) -> None:
    local = small_map([[0, 1]] * 4).around(moving)
    hold_gauge(local, count)
    assert local.problem.fixed_cameras.tolist() == [True] * fixed + [False] * (4 - fixed)


def test_the_whole_map_is_all_keyframes_and_the_points_seen_twice() -> None:
    world = small_map([[0, 1, 2], [1, 2, 4], [2, 3, 4]], unknown=(4,))
    problem = world.whole_problem(min_views=2).problem
    assert (problem.num_cameras, problem.num_points, problem.num_observations) == (3, 2, 5)
    np.testing.assert_array_equal(problem.points, world.points[[1, 2]])
    np.testing.assert_array_equal(problem.cameras, world.poses.copy())
    assert problem.metadata.image_names == ["frame_000000", "frame_000010", "frame_000020"]
    for camera, point, pixel in zip(problem.camera_index, problem.point_index, problem.pixels, strict=True):
        expected = project(problem.cameras[camera], problem.points[[point]])[0]
        np.testing.assert_allclose(pixel, expected, atol=1e-9)
