"""Which pairs of photos are tried."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from looks import features_of, ring_distance, walk_round
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sources.vision import MATCHERS, choose_pairs

NOTHING = features_of(np.zeros((0, 128), np.uint8))


def named(count: int, pattern: str = "frame_{}.png") -> list[Photo]:
    """Photos whose order by name is that by number, "10" after "9"."""
    return [Photo(pattern.format(k)) for k in range(count)]


def many_features(count: int, each: int = 8192) -> list[Features]:
    return [features_of(np.zeros((each, 0), np.uint8))] * count


def along_a_street(count: int, metres: float) -> list[Photo]:
    """Photos taken every so many metres northwards; heights jump as those of phones do."""
    degrees = metres / 111_200
    return [
        Photo(f"{k * 7919 % 1009}.jpg", position=(48.0 + k * degrees, 11.0, 500.0 * (k % 2)))
        for k in range(count)
    ]


def test_exhaustive_are_all_pairs() -> None:
    assert choose_pairs(named(7), [NOTHING] * 7, "exhaustive") == list(combinations(range(7), 2))


def test_sequential_are_the_next_and_powers_of_two() -> None:
    pairs = choose_pairs(named(40), [NOTHING] * 40, "sequential", overlap=5)
    assert pairs == sorted((i, i + step) for step in (1, 2, 3, 4, 5, 8, 16) for i in range(40 - step))


def test_times_come_before_names_where_all_photos_have_one() -> None:
    clock = [3.0, 1.0, 2.0, 0.0]
    photos = [Photo(f"{k}.png", taken_s=time) for k, time in enumerate(clock)]
    assert choose_pairs(photos, [NOTHING] * 4, "sequential", overlap=1) == [(0, 2), (1, 2), (1, 3)]
    photos[2] = Photo("2.png")
    assert choose_pairs(photos, [NOTHING] * 4, "sequential", overlap=1) == [(0, 1), (1, 2), (2, 3)]


def test_names_count_as_people_do_whatever_their_order_in_the_list() -> None:
    photos = [Photo(f"a/{k}.jpg") for k in (1, 10, 2)]
    assert choose_pairs(photos, [NOTHING] * 3, "sequential", overlap=1) == [(0, 2), (1, 2)]


def test_a_sequence_that_comes_back_is_closed_by_what_looks_alike() -> None:
    ring = walk_round(40, seen=200, step=50)
    pairs = choose_pairs(named(40), ring, "sequential", overlap=2)
    ends = [(i, j) for i, j in pairs if j - i > 30]
    assert ends
    assert all(ring_distance(i, j, 40) <= 3 for i, j in ends)


def test_spatial_are_the_nearest_within_reach_whatever_their_heights() -> None:
    photos = along_a_street(30, 20.0)
    pairs = choose_pairs(photos, [NOTHING] * 30, "spatial", neighbours=4)
    assert {(k, k + 1) for k in range(29)} | {(k, k + 2) for k in range(28)} <= set(pairs)
    assert max(j - i for i, j in pairs) <= 4
    far = [Photo("far.jpg", position=(49.0, 11.0, 0.0)), Photo("farther.jpg", position=(49.001, 11.0, 0.0))]
    extended = choose_pairs([*photos, *far], [NOTHING] * 32, "spatial", neighbours=4)
    assert [pair for pair in extended if pair[1] >= 30] == [(30, 31)]


def test_spatial_pairs_photos_at_one_place_and_across_the_date_line() -> None:
    photos = [Photo("a", position=(0.0, 179.9999, 0.0)), Photo("b", position=(0.0, -179.9999, 0.0))]
    assert choose_pairs(photos, [NOTHING] * 2, "spatial") == [(0, 1)]
    same = [Photo(str(k), position=(10.0, 10.0, 0.0)) for k in range(4)]
    assert choose_pairs(same, [NOTHING] * 4, "spatial") == list(combinations(range(4), 2))


def test_heights_that_are_not_told_do_no_harm() -> None:
    photos = [Photo(str(k), position=(10.0, 10.0 + 1e-5 * k, float("nan"))) for k in range(3)]
    assert choose_pairs(photos, [NOTHING] * 3, "spatial") == [(0, 1), (0, 2), (1, 2)]


def test_spatial_without_positions_says_how_many_lack_one() -> None:
    photos = [*named(4), Photo("placed.jpg", position=(1.0, 2.0, 3.0))]
    with pytest.raises(InvalidArgument, match=r"spatial.*4 of 5 photos lack a position"):
        choose_pairs(photos, [NOTHING] * 5, "spatial")


def test_a_photo_without_a_position_is_paired_with_what_looks_like_it() -> None:
    ring = walk_round(30, seen=200, step=50)
    photos = along_a_street(30, 20.0)
    photos[12] = Photo("lost.jpg")
    pairs = set(choose_pairs(photos, ring, "spatial", neighbours=4))
    assert {(11, 12), (12, 13)} <= pairs


def test_auto_tries_all_pairs_of_sixty_photos_and_not_of_a_hundred() -> None:
    assert len(choose_pairs(named(60, "{}"), many_features(60))) == 60 * 59 / 2
    assert len(choose_pairs(named(100), many_features(100), overlap=3)) == 99 + 98 + 97


def test_auto_follows_a_sequence_but_no_numbers_drawn_at_random() -> None:
    numbers = np.sort(np.random.default_rng(2).integers(0, 10_000, 120))
    drawn = [Photo(f"IMG_{number:04d}.jpg") for number in numbers]
    assert choose_pairs(drawn, many_features(120)) == []
    every_thirtieth = [Photo(f"clip/{30 * k}.jpg") for k in range(120)]
    assert len(choose_pairs(every_thirtieth, many_features(120), overlap=1)) == 119


def test_auto_takes_what_looks_alike_and_what_is_near() -> None:
    ring = walk_round(100, seen=200, step=50)  # 20 times the same: too many features to try all pairs
    features = [features_of(np.vstack([image.descriptors] * 20)) for image in ring]
    looks = set(choose_pairs(named(100), features, "retrieval", neighbours=4))
    photos = along_a_street(100, 20.0)
    near = set(choose_pairs(photos, features, "spatial", neighbours=4))
    assert set(choose_pairs(photos, features, "auto", neighbours=4)) == looks | near


def test_thousands_of_photos_get_pairs_in_proportion() -> None:
    for matcher in ("sequential", "spatial"):
        pairs = choose_pairs(along_a_street(3000, 5.0), [NOTHING] * 3000, matcher)
        assert len(pairs) <= 3000 * 30


@pytest.mark.parametrize("matcher", sorted({*MATCHERS} - {"spatial"}))
def test_no_photos_or_one_have_no_pairs(matcher: str) -> None:
    assert choose_pairs([], [], matcher) == []
    assert choose_pairs(named(1), [NOTHING], matcher) == []


def test_arguments_that_make_no_sense_are_named() -> None:
    with pytest.raises(InvalidArgument, match="matcher = 'guess': must be one of auto, exhaustive"):
        choose_pairs([], [], "guess")
    with pytest.raises(InvalidArgument, match="features: of 1 images, must be of 2"):
        choose_pairs(named(2), [NOTHING])
