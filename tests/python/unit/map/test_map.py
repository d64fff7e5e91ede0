"""The map against one made of lists: whatever is done to both, they hold and give out the same."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sfmcpp import InvalidArgument, circle_scene
from sfmcpp.geometry import Similarity
from sfmcpp.map import LocalProblem, Map

PROPERTY = settings(max_examples=40, deadline=None, derandomize=True)
SEEDS = st.integers(0, 2**32 - 1)
NUM_CAMERAS = 3


class ListMap:
    """Tracks as lists of keypoints, points of keypoints as a list: the slow truth."""

    def __init__(self) -> None:
        self.image: list[int] = []
        self.point: list[int] = []
        self.tracks: list[list[int]] = []

    def add_image(self, image: int, points: list[int]) -> None:
        for point in points:
            row = len(self.point)
            self.image.append(image)
            self.point.append(-1)
            if point >= 0:
                self.observe(row, point)

    def observe(self, row: int, point: int) -> None:
        self.point[row] = point
        self.tracks[point].append(row)

    def forget(self, row: int) -> None:
        if self.point[row] >= 0:
            self.tracks[self.point[row]].remove(row)
        self.point[row] = -1


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return np.column_stack([Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)])


def random_points(rng: np.random.Generator, count: int, keypoints: int) -> np.ndarray:
    """For each keypoint of one image a point, none of them twice, or -1."""
    seen = rng.permutation(max(count, keypoints))[:keypoints]
    return np.where((seen < count) & (rng.random(keypoints) < 0.7), seen, -1)


def random_maps(seed: int, images: int = 8, points: int = 15) -> tuple[Map, ListMap]:
    """A map with several cameras, images without a pose, points without a position; and its truth."""
    rng = np.random.default_rng(seed)
    world, truth = Map(), ListMap()
    world.add_cameras(rng.uniform(0.5, 2, (NUM_CAMERAS, 12)))
    for image in range(images):
        world.add_points(rng.normal(size=(points // images + 1, 3)))
        truth.tracks += [[] for _ in range(points // images + 1)]
        keypoints = int(rng.integers(0, 12))
        seen = random_points(rng, len(world.points), keypoints)
        pose = random_pose(rng)[None] if rng.random() < 0.8 else None
        pixels = rng.uniform(0, 100, (keypoints, 2))
        world.add_images([f"{image}.jpg"], [rng.integers(3)], [keypoints], pixels, points=seen, poses=pose)
        truth.add_image(image, seen.tolist())
    world.points[rng.random(len(world.points)) < 0.2] = np.nan
    return world, truth


def assert_same_tracks(world: Map, truth: ListMap) -> None:
    assert world.keypoint_points.tolist() == truth.point
    assert world.keypoint_images.tolist() == truth.image
    for point, track in enumerate(truth.tracks):
        assert world.observations_of([point]).tolist() == track
    everything = world.observations_of(np.arange(len(world.points)))
    assert everything.tolist() == [row for track in truth.tracks for row in track]


def observations(local: LocalProblem) -> set[tuple[int, int, float, float]]:
    """Image, point and pixel of each observation of a part, by their numbers in the map."""
    problem = local.problem
    images, points = local.images[problem.camera_index], local.points[problem.point_index]
    return set(zip(images.tolist(), points.tolist(), *problem.pixels.T.tolist(), strict=True))


def expected_observations(world: Map, truth: ListMap, images: set[int], points: set[int]) -> set[object]:
    return {
        (image, point, *world.keypoints[row].tolist())
        for row, (image, point) in enumerate(zip(truth.image, truth.point, strict=True))
        if image in images and point in points
    }


def assert_refers_to_the_map(world: Map, local: LocalProblem) -> None:
    """Poses, positions, intrinsics, pixels of a part are those of the rows it names."""
    problem = local.problem
    np.testing.assert_array_equal(problem.cameras, world.poses[local.images])
    np.testing.assert_array_equal(problem.points, world.points[local.points])
    np.testing.assert_array_equal(problem.pixels, world.keypoints[local.rows])
    np.testing.assert_array_equal(
        problem.intrinsics[problem.intrinsics_index], world.intrinsics[world.image_cameras[local.images]]
    )
    np.testing.assert_array_equal(world.keypoint_points[local.rows], local.points[problem.point_index])
    np.testing.assert_array_equal(world.keypoint_images[local.rows], local.images[problem.camera_index])


@PROPERTY
@given(SEEDS)
def test_tracks_stay_those_of_a_map_of_lists(seed: int) -> None:
    world, truth = random_maps(seed)
    rng = np.random.default_rng(seed + 1)
    for _ in range(12):
        match rng.integers(4):
            case 0:
                rows = rng.permutation(len(truth.point))[: rng.integers(0, 12)]
                world.forget(rows)
                for row in rows.tolist():
                    truth.forget(row)
            case 1:
                chosen = rng.permutation(len(truth.tracks))[:2]
                world.remove_points(chosen)
                assert np.isnan(world.points[chosen]).all()
                for point in chosen.tolist():
                    for row in list(truth.tracks[point]):
                        truth.forget(row)
            case 2:
                kept, gone = rng.permutation(len(truth.tracks))[:2].tolist()
                world.merge(kept, gone)
                both = {truth.image[row] for row in truth.tracks[kept]}
                for row in list(truth.tracks[gone]):
                    truth.forget(row)
                    if truth.image[row] not in both:
                        truth.observe(row, kept)
            case 3:
                free = [row for row, point in enumerate(truth.point) if point < 0]
                rows, told = [], []
                for row in rng.permutation(free).tolist()[:6]:
                    point = int(rng.integers(len(truth.tracks)))
                    if truth.image[row] not in {truth.image[other] for other in truth.tracks[point]}:
                        truth.observe(row, point)
                        rows.append(row)
                        told.append(point)
                world.observe(np.array(rows, int), np.array(told, int))
        assert_same_tracks(world, truth)


@PROPERTY
@given(SEEDS)
def test_a_local_problem_has_the_images_their_points_and_all_who_see_them(seed: int) -> None:
    world, truth = random_maps(seed)
    rng = np.random.default_rng(seed)
    registered = np.flatnonzero(world.registered)
    free = set(rng.permutation(registered)[:3].tolist())
    also = set(rng.permutation(registered)[:2].tolist())
    local = world.local_problem(sorted(free), sorted(also))
    known = set(np.flatnonzero(world.known).tolist())
    points = {p for i, p in zip(truth.image, truth.point, strict=True) if i in free and p in known}
    expected = expected_observations(world, truth, set(registered.tolist()), points)
    assert observations(local) == expected
    assert local.points.tolist() == sorted(points)
    seeing = {image for image, *_ in expected}
    assert local.images.tolist() == sorted(seeing | free | also)
    fixed = local.problem.fixed_cameras
    assert set(local.images[~fixed].tolist()) == free & seeing
    assert not local.problem.fixed_points.any()
    assert_refers_to_the_map(world, local)
    # The order that sums are made in: image after image, and within one as its keypoints are.
    assert (np.diff(local.rows) > 0).all()


@PROPERTY
@given(SEEDS, st.integers(0, 3))
def test_the_whole_problem_has_all_points_seen_often_enough(seed: int, min_views: int) -> None:
    world, truth = random_maps(seed)
    local = world.whole_problem(min_views)
    registered = set(np.flatnonzero(world.registered).tolist())
    views = [sum(truth.image[row] in registered for row in track) for track in truth.tracks]
    points = {p for p in np.flatnonzero(world.known).tolist() if views[p] >= min_views}
    assert observations(local) == expected_observations(world, truth, registered, points)
    assert local.points.tolist() == sorted(points)
    assert local.images.tolist() == sorted(registered)
    assert not local.problem.fixed_cameras.any()
    assert local.problem.metadata.image_names == [f"{image}.jpg" for image in sorted(registered)]
    assert_refers_to_the_map(world, local)


@PROPERTY
@given(SEEDS)
def test_points_to_triangulate_are_those_without_a_position_that_the_images_share(seed: int) -> None:
    world, truth = random_maps(seed)
    images = np.flatnonzero(world.registered)[-4:]
    rng = np.random.default_rng(seed)
    local = world.untriangulated(rng.permutation(np.concatenate([images, images[:1]])))
    chosen = set(images.tolist())
    views = [sum(truth.image[row] in chosen for row in track) for track in truth.tracks]
    points = {p for p in np.flatnonzero(~world.known).tolist() if views[p] >= 2}
    assert observations(local) == expected_observations(world, truth, chosen, points)
    assert_refers_to_the_map(world, local)


@PROPERTY
@given(SEEDS)
def test_what_an_adjustment_moved_is_taken_and_nothing_else(seed: int) -> None:
    world, _ = random_maps(seed)
    local = world.local_problem(np.flatnonzero(world.registered)[:2])
    before = [a.copy() for a in (world.poses, world.points, world.intrinsics)]
    local.problem.cameras += 1
    local.problem.points += 2
    local.problem.intrinsics += 3
    world.take(local)
    chosen = (local.images, local.points, local.cameras)
    for step, old, now, rows in zip(
        (1, 2, 3), before, (world.poses, world.points, world.intrinsics), chosen, strict=True
    ):
        old[rows] += step
        np.testing.assert_array_equal(now, old)


@PROPERTY
@given(SEEDS, st.integers(1, 3))
def test_dropped_observations_are_forgotten_and_lonely_points_lose_their_place(
    seed: int, min_views: int
) -> None:
    world, truth = random_maps(seed)
    rng = np.random.default_rng(seed)
    local = world.local_problem(np.flatnonzero(world.registered)[:3])
    before = world.points.copy()
    outliers = rng.random(local.problem.num_observations) < 0.4
    world.drop(local, outliers, min_views)
    for row in local.rows[outliers].tolist():
        truth.forget(row)
    assert_same_tracks(world, truth)
    registered = world.registered
    views = [sum(registered[truth.image[row]] for row in track) for track in truth.tracks]
    lonely = [p for p in local.points.tolist() if views[p] < min_views]
    before[lonely] = np.nan
    np.testing.assert_array_equal(world.points, before)


def random_similarity(rng: np.random.Generator) -> Similarity:
    turn = Rotation.random(random_state=rng).as_matrix()
    return Similarity(float(rng.uniform(0.2, 5)), turn, rng.normal(size=3))


def seen_from(world: Map) -> np.ndarray:
    """Direction of the point of each observation in its camera; not a number where there is none."""
    rows = np.flatnonzero(world.keypoint_points >= 0)
    poses = world.poses[world.keypoint_images[rows]]
    offsets = world.points[world.keypoint_points[rows]] - poses[:, :, 3]
    inside = np.einsum("nij,ni->nj", poses[:, :, :3], offsets)
    return inside / np.linalg.norm(inside, axis=1, keepdims=True)


@PROPERTY
@given(SEEDS)
def test_a_similarity_changes_no_image_and_goes_back(seed: int) -> None:
    world, truth = random_maps(seed)
    similarity = random_similarity(np.random.default_rng(seed))
    views, points, poses = seen_from(world), world.points.copy(), world.poses.copy()
    world.transform(similarity)
    np.testing.assert_allclose(seen_from(world), views, atol=1e-9)
    np.testing.assert_allclose(world.points, similarity.apply(points))
    for moved, pose in zip(world.poses, poses, strict=True):
        # One by one a pose goes to the same bits.
        np.testing.assert_array_equal(moved, similarity.apply_to_poses(pose))
    world.transform(similarity.inverse())
    np.testing.assert_allclose(world.poses, poses, atol=1e-9)
    assert_same_tracks(world, truth)


@PROPERTY
@given(SEEDS)
def test_a_joined_map_is_both_side_by_side(seed: int) -> None:
    world, truth = random_maps(seed)
    other, other_truth = random_maps(seed + 1)
    similarity = random_similarity(np.random.default_rng(seed))
    keypoints, cameras = len(world.keypoints), len(world.intrinsics)
    theirs = seen_from(other)
    images, points = world.join(other, similarity)
    for image, names in zip(images.tolist(), other.image_names, strict=True):
        assert world.image_names[image] == names
    truth.image += [int(images[i]) for i in other_truth.image]
    truth.point += [int(points[p]) if p >= 0 else -1 for p in other_truth.point]
    truth.tracks += [[keypoints + row for row in track] for track in other_truth.tracks]
    assert_same_tracks(world, truth)
    np.testing.assert_array_equal(world.keypoints[keypoints:], other.keypoints)
    np.testing.assert_array_equal(world.image_cameras[images], cameras + other.image_cameras)
    np.testing.assert_array_equal(world.intrinsics[cameras:], other.intrinsics)
    np.testing.assert_allclose(world.points[points], similarity.apply(other.points))
    np.testing.assert_allclose(seen_from(world)[-len(theirs) :] if len(theirs) else theirs, theirs, atol=1e-9)
    assert len(set(world.image_ids.tolist())) == world.num_images
    assert len(set(world.point_ids.tolist())) == len(world.points)


def test_maps_of_the_same_camera_and_points_are_joined_into_one() -> None:
    a, b = Map("calibrated"), Map("calibrated")
    for world, x in ((a, 1.0), (b, 2.0)):
        world.add_cameras([[500.0, 1, 320, 240, 0]])
        world.add_points([[x, 0, 0], [np.nan] * 3])
        pixels = [[x, 1], [x, 2]]
        world.add_images(["i"], [0], [2], pixels, points=[0, 1], poses=np.eye(3, 4)[None])
    b.points[1] = 7.0
    a.join(b, cameras=[0], points=[1, 0])
    assert a.intrinsics.shape == (1, 5)
    np.testing.assert_array_equal(a.points, [[7, 7, 7], [2, 0, 0]])
    assert [a.keypoint_points[a.observations_of([p])].tolist() for p in (0, 1)] == [[0, 0], [1, 1]]
    assert a.keypoint_images[a.observations_of([0])].tolist() == [0, 1]


def test_errors_of_points_are_means_over_the_images_they_are_in_front_of() -> None:
    world = Map("calibrated")
    world.add_cameras([[100.0, 1, 0, 0, 0]])
    world.add_points([[0, 0, 5.0], [0, 0, -5.0], [np.nan] * 3])
    poses = np.tile(np.eye(3, 4), (3, 1, 1))
    poses[2, 2, 3] = 8.0  # The first point is behind it.
    pixels = np.repeat([[3.0, 4.0], [1.0, 0.0], [9.0, 9.0]], 3, axis=0)
    world.add_images(list("abc"), [0] * 3, [3] * 3, pixels, points=[0, 1, 2] * 3, poses=poses)
    world.update_errors()
    np.testing.assert_allclose(world.point_errors, [3.0, -1.0, -1.0])


def test_points_have_the_mean_colour_of_who_sees_them_with_a_pose() -> None:
    world = Map("perspective")
    world.add_cameras([[500.0, 1, 320, 240, *[0] * 8]])
    world.add_points(np.zeros((3, 3)), colors=[[9, 9, 9]] * 3)
    poses = np.tile(np.eye(3, 4), (3, 1, 1))
    poses[2] = np.nan
    colors = [[10, 20, 30], [0, 0, 0], [20, 20, 31], [200, 0, 0], [255, 255, 255]]
    names, pixels = ["a", "b", "c"], np.zeros((5, 2))
    world.add_images(names, [0, 0, 0], [2, 1, 2], pixels, points=[0, -1, 0, 0, 1], poses=poses, colors=colors)
    world.update_colors()
    np.testing.assert_array_equal(world.point_colors, [[15, 20, 30], [9, 9, 9], [9, 9, 9]])
    blind = Map("perspective")
    blind.add_cameras(world.intrinsics)
    blind.add_points(np.zeros((1, 3)), colors=[[1, 2, 3]])
    blind.add_images(["a"], [0], [1], np.zeros((1, 2)), points=[0], poses=poses[:1])
    blind.update_colors()
    np.testing.assert_array_equal(blind.point_colors, [[1, 2, 3]])


def test_as_many_names_as_cameras_are_asked_for() -> None:
    with pytest.raises(InvalidArgument, match="names: 1, must be 2"):
        Map("bal").add_cameras(np.ones((2, 3)), names=["SIMPLE_RADIAL"])


def test_ids_go_on_from_the_largest_given() -> None:
    world = Map("bal")
    assert world.add_cameras(np.ones((2, 3)), ids=[7, 3]).tolist() == [0, 1]
    world.add_cameras(np.ones((2, 3)))
    assert world.camera_ids.tolist() == [7, 3, 8, 9]
    world.add_points(np.zeros((1, 3)))
    assert world.point_ids.tolist() == [1]


def test_what_grows_keeps_what_it_had() -> None:
    world = Map("bal")
    world.add_cameras([[1.0, 2, 3]])
    for k in range(100):
        world.add_points(np.full((k, 3), float(k)), colors=np.full((k, 3), k, np.uint8))
    np.testing.assert_array_equal(world.points[:, 0], np.repeat(np.arange(100), np.arange(100)))
    np.testing.assert_array_equal(world.point_colors[:, 2], world.points[:, 2])
    assert world.point_errors.tolist() == [-1.0] * 4950


@pytest.mark.parametrize("model", ["perspective", "calibrated", "bal"])
def test_what_is_free_of_a_new_camera_is_what_is_free_of_a_problem(model: str) -> None:
    world, problem = Map(model), circle_scene(3, 20, camera_model=model)
    world.add_cameras(problem.intrinsics)
    np.testing.assert_array_equal(world.fixed_intrinsics, problem.fixed_intrinsics)


def test_points_to_triangulate_are_not_looked_for_in_the_whole_map(monkeypatch: pytest.MonkeyPatch) -> None:
    world, _ = random_maps(0)

    def looked(_: Map) -> None:
        raise AssertionError("looks at all points")

    monkeypatch.setattr(Map, "known", property(looked))
    assert len(world.untriangulated(np.flatnonzero(world.registered)[-2:]).images) == 2
