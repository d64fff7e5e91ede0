"""Less of a problem, or more: independent of what it is made of, and with the metadata that belong to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Metadata, Problem, Rigs
from sfmcpp.model.arrays import largest_of_each
from sfmcpp.sfm import georeference

WAYS: dict[str, Callable[[Problem], Problem]] = {
    "copy": Problem.copy,
    "with_observations": lambda p: p.with_observations(p.camera_index < 3),
    "all observations": lambda p: p.with_observations(np.ones(p.num_observations, bool)),
    "with_points": lambda p: p.with_points(np.arange(10)),
    "with_cameras": lambda p: p.with_cameras([0, 1, 3]),
    "with_shared_intrinsics": Problem.with_shared_intrinsics,
    "with_added_points": lambda p: p.with_added_points([[0, 0, 1]], [0, 1], [0, 0], [[1, 2], [3, 4]]),
}


def scene() -> Problem:
    problem = sfmcpp.circle_scene(4, 30, camera_model="perspective", seed=0)
    problem.metadata = Metadata(
        image_names=["a", "b", "c", "d"],
        image_sizes=np.full((4, 2), 2000),
        point_colors=np.ones((30, 3), np.uint8),
        extra={
            "colmap_image_ids": np.array([7, 5, 6, 4]),
            "colmap_camera_ids": np.array([3, 1, 2, 9]),
            "colmap_camera_models": ["PINHOLE", "RADIAL", "OPENCV", "OPENCV"],
            "colmap_point_ids": np.arange(30) + 100,
            "bundler_registered": np.array([True, False, True, True, True]),
            "origin_geodetic": np.array([46.0, 9.0, 100.0]),
        },
    )
    return problem


def arrays_of(value: Any) -> Iterator[np.ndarray[Any, Any]]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, Problem | Rigs | Metadata):
        for member in fields(value):
            yield from arrays_of(getattr(value, member.name))
    elif isinstance(value, dict):
        for item in value.values():
            yield from arrays_of(item)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rigid", [False, True])
def test_no_array_is_shared(way: str, rigid: bool) -> None:
    """A solve changes cameras, intrinsics, points and sensors in place."""
    problem = scene()
    if rigid:
        sensors = np.tile(np.eye(3, 4), (4, 1, 1))
        problem.rigs = Rigs(sensors, np.arange(4), np.arange(4))
    made = WAYS[way](problem)
    assert not any(np.shares_memory(a, b) for a in arrays_of(problem) for b in arrays_of(made))
    assert made.metadata.extra is not problem.metadata.extra
    np.testing.assert_array_equal(made.metadata.extra["origin_geodetic"], [46.0, 9.0, 100.0])


def test_a_copy_that_is_moved_into_the_world_leaves_the_origin_to_itself() -> None:
    problem = sfmcpp.circle_scene(12, 60, pixel_sigma_px=0.5, seed=0)
    noise_m = np.random.default_rng(0).normal(0, 0.3, (12, 3))
    georeference(problem.copy(), np.add(problem.centres + noise_m, [691_500, 5_334_500, 520]))
    assert problem.metadata.extra == {}


def test_cameras_that_are_left_out_take_their_own_with_them() -> None:
    problem = scene()
    problem.intrinsics[:, 0] = [10, 11, 12, 13]
    problem.fixed_cameras[3] = True
    fewer = problem.with_cameras([3, 1])
    np.testing.assert_array_equal(fewer.cameras, problem.cameras[[3, 1]])
    np.testing.assert_array_equal(fewer.intrinsics[fewer.intrinsics_index, 0], [13, 11])
    np.testing.assert_array_equal(fewer.fixed_cameras, [True, False])
    assert fewer.num_points == 30
    assert len(fewer.intrinsics) == 2
    for number, camera in enumerate([3, 1]):
        mine, its = fewer.camera_index == number, problem.camera_index == camera
        np.testing.assert_array_equal(fewer.pixels[mine], problem.pixels[its])
        np.testing.assert_array_equal(fewer.point_index[mine], problem.point_index[its])
    assert fewer.metadata.image_names == ["d", "b"]
    extra = fewer.metadata.extra
    np.testing.assert_array_equal(extra["colmap_image_ids"], [4, 5])
    np.testing.assert_array_equal(extra["colmap_camera_ids"][fewer.intrinsics_index], [9, 1])
    assert [extra["colmap_camera_models"][row] for row in fewer.intrinsics_index] == ["OPENCV", "RADIAL"]


def test_a_camera_that_is_left_out_is_no_registered_one_of_its_file() -> None:
    fewer = scene().with_cameras([0, 2, 3])
    np.testing.assert_array_equal(
        fewer.metadata.extra["bundler_registered"], [True, False, False, True, True]
    )


def test_rigs_lose_frames_and_sensors_that_no_camera_uses() -> None:
    """Two frames of two sensors: without the second sensor of both, and without the first frame."""
    problem, sensors = scene(), np.tile(np.eye(3, 4), (2, 1, 1))
    sensors[1, 0, 3] = 0.5
    rigs = Rigs(sensors, [0, 0, 1, 1], [0, 1, 0, 1], [False, True])
    problem.rigs = rigs
    problem.metadata.extra |= {
        "colmap_frame_ids": np.array([8, 9]),
        "colmap_rig_ids": np.array([2, 2]),
        "colmap_sensor_rows": np.array([0, 1]),
    }
    first = problem.with_cameras([0, 2])
    assert first.rigs is not None
    assert first.rigs.num_frames == 2
    assert first.rigs.num_sensors == 1
    later = problem.with_cameras([2, 3])
    assert later.rigs is not None
    assert later.rigs.num_frames == 1
    np.testing.assert_array_equal(later.rigs.sensors, sensors)
    np.testing.assert_array_equal(later.rigs.free_sensors, [False, True])
    np.testing.assert_array_equal(later.metadata.extra["colmap_frame_ids"], [9])


def test_cameras_of_one_group_share_the_intrinsics_of_the_first() -> None:
    problem = scene()
    problem.intrinsics[:, 0] = [10, 11, 12, 13]
    problem.fixed_intrinsics[2] = True
    shared = problem.with_shared_intrinsics([5, 5, 1, 5])
    np.testing.assert_array_equal(shared.intrinsics_index, [1, 1, 0, 1])
    np.testing.assert_array_equal(shared.intrinsics[:, 0], [12, 10])
    assert shared.fixed_intrinsics[0].all()
    assert not shared.fixed_intrinsics[1].all()
    np.testing.assert_array_equal(shared.metadata.extra["colmap_camera_ids"], [2, 3])
    assert shared.metadata.image_names == ["a", "b", "c", "d"]
    again = shared.with_shared_intrinsics(np.arange(4))
    assert len(set(again.metadata.extra["colmap_camera_ids"])) == 4
    np.testing.assert_array_equal(again.intrinsics[:, 0], [10, 10, 12, 10])


def test_new_points_come_last_with_all_that_points_have() -> None:
    problem = scene()
    more = problem.with_added_points(np.eye(3), [0, 1, 1], [0, 0, 2], np.ones((3, 2)))
    np.testing.assert_array_equal(more.points[30:], np.eye(3))
    np.testing.assert_array_equal(more.point_index[-3:], [30, 30, 32])
    assert more.metadata.point_colors is not None
    assert more.metadata.point_colors.shape == (33, 3)
    np.testing.assert_array_equal(more.metadata.extra["colmap_point_ids"][30:], [130, 131, 132])
    assert more.sigma_px is None
    assert problem.num_points == 30


def test_new_observations_have_a_standard_deviation_beside_any_other() -> None:
    marks: Any = ([[0, 0, 1]], [0, 1], [0, 0], [[1, 2], [3, 4]])
    problem = scene()
    np.testing.assert_array_equal(
        problem.with_added_points(*marks, sigma_px=0.5).sigma_px, [1.0] * problem.num_observations + [0.5] * 2
    )
    problem.sigma_px = np.full(problem.num_observations, 2.0)
    np.testing.assert_array_equal(problem.with_added_points(*marks).sigma_px[-3:], [2.0, 1.0, 1.0])
    problem.sigma_px, problem.covariance_px2 = (
        None,
        np.tile(np.diag([4.0, 9.0]), (problem.num_observations, 1, 1)),
    )
    covariances = problem.with_added_points(*marks, sigma_px=[0.5, 2.0]).covariance_px2
    assert covariances is not None
    np.testing.assert_array_equal(covariances[-2:], [np.eye(2) / 4, 4 * np.eye(2)])


def uneven() -> Problem:
    problem = scene()
    problem.metadata.image_sizes = np.array([[2000, 1125]] * 3 + [[1000, 563]])
    return problem


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: scene().with_cameras([4]), "chosen: must be from 0 to 3"),
        (lambda: scene().with_cameras([1, 1]), "chosen: a camera is named twice"),
        (lambda: scene().with_cameras(np.ones(3, bool)), r"mask of shape \(3,\), must be \(4,\)"),
        (lambda: scene().with_shared_intrinsics([0, 1]), "groups: 2 numbers, must be one for each of 4"),
        (lambda: scene().with_shared_intrinsics([0.5] * 4), "groups: float64"),
        (
            lambda: uneven().with_shared_intrinsics(),
            "groups: cameras 0 and 3 have images of 2000×1125 and 1000×563 px",
        ),
        (lambda: scene().with_added_points([[0, 0]], [], [], []), r"points: shape \(1, 2\), must be"),
        (
            lambda: scene().with_added_points([[0, 0, 1]], [4], [0], [[1, 2]]),
            "camera_index: must be from 0 to 3",
        ),
        (
            lambda: scene().with_added_points([[0, 0, 1]], [0], [30], [[1, 2]]),
            "point_index: must be from 0 to 0",
        ),
        (
            lambda: scene().with_added_points([[0, 0, 1]], [0, 1], [0], [[1, 2]]),
            r"point_index: shape \(1,\), must be \(2,\)",
        ),
        (
            lambda: scene().with_added_points([[0, 0, 1]], [0], [0], [[1, 2]], sigma_px=[1, 2]),
            r"sigma_px: shape \(2,\), must be \(1\)",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_name(call: Callable[[], object], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        call()


@pytest.mark.parametrize("way", WAYS)
def test_fields_of_another_shape_are_refused_by_name(way: str) -> None:
    problem = scene()
    problem.pixels = problem.pixels[:-1]
    with pytest.raises(InvalidArgument, match=r"pixels: shape \(119, 2\), must be \(120, 2\)"):
        WAYS[way](problem)


@pytest.mark.parametrize("number", [-1, 30])
def test_an_observation_of_no_point_is_no_observation_of_the_last(number: int) -> None:
    problem = scene()
    problem.point_index[5] = number
    with pytest.raises(InvalidArgument, match="point_index: must be from 0 to 29"):
        problem.with_points(np.arange(29, 30))


def test_an_observation_of_no_camera_is_no_observation_of_the_last() -> None:
    problem = scene()
    problem.camera_index[5] = -1
    with pytest.raises(InvalidArgument, match="camera_index: must be from 0 to 3"):
        problem.with_cameras([3])


def test_no_camera_may_be_left() -> None:
    problem = sfmcpp.circle_scene(4, 30, camera_model="perspective", seed=0)
    assert problem.with_cameras([]).num_cameras == 0
    assert scene().with_cameras([]).num_cameras == 0


def test_cameras_are_chosen_by_the_names_of_their_images() -> None:
    problem = scene()
    problem.metadata.image_names = [f"{k}.jpg" for k in range(problem.num_cameras)]
    fewer = problem.with_cameras(["3.jpg", "1.jpg"])
    assert fewer.metadata.image_names == ["3.jpg", "1.jpg"]
    np.testing.assert_array_equal(fewer.cameras, problem.cameras[[3, 1]])
    with pytest.raises(InvalidArgument, match=r"chosen: no image is called '7\.png'"):
        problem.with_cameras(["1.jpg", "7.png"])


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("image_names", ["a", "b"], "metadata image_names: 2 entries, must be 4"),
        ("image_sizes", np.ones((2, 2), np.int64), "metadata image_sizes: 2 entries, must be 4"),
        ("point_colors", np.ones((2, 3), np.uint8), "metadata point_colors: 2 entries, must be 30"),
    ],
)
def test_metadata_that_do_not_fit_are_refused_by_name(name: str, value: Any, told: str) -> None:
    problem = scene()
    setattr(problem.metadata, name, value)
    with pytest.raises(InvalidArgument, match=told):
        problem.with_points([3, 7]) if name == "point_colors" else problem.with_cameras([0, 3])


def test_a_name_of_several_images_is_that_of_none() -> None:
    problem = scene()
    problem.metadata.image_names = ["a.jpg", "b.jpg", "a.jpg", "c.jpg"]
    assert problem.with_cameras(["c.jpg", "b.jpg"]).metadata.image_names == ["c.jpg", "b.jpg"]
    with pytest.raises(InvalidArgument, match=r"chosen: 2 images are called 'a\.jpg'"):
        problem.with_cameras(["a.jpg"])


@pytest.mark.parametrize("shape", [(), (2,)])
def test_the_largest_of_each_group_is_that_of_its_rows(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    group, values = rng.integers(0, 4, 50), rng.normal(size=(50, *shape))
    group[group == 1] = 3
    expected = [values[group == g].max(axis=0, initial=0.5) for g in range(4)]
    np.testing.assert_array_equal(largest_of_each(group, values, 4, least=0.5), expected)
    assert largest_of_each(group[:0], values[:0], 0).shape == (0, *shape)
