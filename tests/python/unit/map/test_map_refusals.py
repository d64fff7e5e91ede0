"""What a map refuses, and that nothing is changed then."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import InvalidArgument
from sfmcpp.geometry import Similarity
from sfmcpp.map import Map
from sfmcpp.model.metadata import WorldOrigin


def two_images() -> Map:
    world = Map("bal")
    world.add_cameras([[1.0, 0, 0]])
    world.add_points(np.zeros((2, 3)))
    world.add_images(["a", "b"], [0, 0], [2, 2], np.zeros((4, 2)), points=[0, -1, -1, 1])
    return world


def seen_twice_where_one() -> Map:
    """A map of which an image sees both points."""
    other = two_images()
    other.observe([1], [1])
    return other


def two_images_from(latitude_deg: float) -> Map:
    world = two_images()
    world.origin = WorldOrigin(np.array([latitude_deg, 8.0, 400.0]), geodetic=True)
    return world


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.observe([1], [2]), "points: must be from 0 to 1"),
        (lambda m: m.observe([1], [0]), "an image sees a point once at most"),
        (lambda m: m.observe([0], [1]), "a keypoint sees one point at most"),
        (lambda m: m.observe([1, 1], [1, 1]), "a keypoint sees one point at most"),
        (lambda m: m.add_images(["c"], [1], [0], np.zeros((0, 2))), "must be from 0 to 0"),
        (
            lambda m: m.add_images(["c"], [0.5], [0], np.zeros((0, 2))),
            r"cameras: float64 .* must be .* whole numbers",
        ),
        (lambda m: m.add_images(["c", "d"], [0, 0], [3, -1], np.zeros((2, 2))), "counts: must be from 0 to"),
        (lambda m: m.add_images(["c"], [0], [2], np.zeros((2, 2)), points=[1, 1]), "sees a point once"),
        (lambda m: m.add_images(["c"], [0], [2], np.zeros((3, 2))), r"keypoints: shape \(3, 2\), must be"),
        (lambda m: m.add_cameras(np.zeros((1, 5))), r"intrinsics: shape \(1, 5\), must be \(1, 3\)"),
        (lambda m: m.add_points(np.zeros((1, 4))), r"positions: shape \(1, 4\), must be \(1, 3\)"),
        (lambda m: m.join(Map("perspective")), "other: camera model 'perspective', must be 'bal'"),
        (lambda m: m.join(m), "other: is the map itself"),
        (lambda m: m.join(two_images(), cameras=[1]), "cameras: must be from 0 to 0"),
        (lambda m: m.join(two_images(), cameras=[0, 0]), "cameras: 2, must be 1, as many as the other"),
        (lambda m: m.join(two_images(), points=[-1, 0]), "points: must be from 0 to 1"),
        (lambda m: m.join(two_images(), points=[0, 2]), "points: must be from 0 to 1"),
        (lambda m: m.join(two_images(), points=[0]), "points: 1, must be 2, as many as the other"),
        (lambda m: m.join(seen_twice_where_one(), points=[0, 0]), "an image sees a point once at most"),
        (lambda _: Map("projective"), "camera_model = 'projective': must be 'calibrated'"),
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(change: object, message: str) -> None:
    world = two_images()
    with pytest.raises(InvalidArgument, match=message):
        change(world)  # type: ignore[operator]
    assert (world.num_images, len(world.keypoints), world.keypoint_points.tolist()) == (2, 4, [0, -1, -1, 1])
    assert (world.points.tolist(), len(world.intrinsics)) == ([[0.0] * 3] * 2, 1)


def test_maps_of_two_origins_are_joined_by_a_similarity_alone() -> None:
    world, other = two_images_from(47.0), two_images_from(48.0)
    with pytest.raises(InvalidArgument, match=r"other.origin: \{.* 48.0, .* or similarity be given"):
        world.join(other)
    assert world.num_images == 2
    world.join(other, Similarity.identity())
    world.join(two_images())
    assert world.num_images == 6
    assert world.origin.place[0] == 47.0


def test_an_empty_map_takes_over_the_origin_of_what_joins_it() -> None:
    world, other = Map("bal"), two_images_from(47.0)
    world.join(other)
    assert world.origin is other.origin
