"""Matches against brute force in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.vision import match

Bytes = NDArray[np.uint8]


def random_descriptors(seed: int, count: int, elements: int = 128) -> Bytes:
    return np.random.default_rng(seed).integers(0, 256, (count, elements), dtype=np.uint8)


def seen_again(seed: int, descriptors: Bytes, noise: float) -> Bytes:
    """`descriptors` in another order, with noise."""
    rng = np.random.default_rng(seed)
    moved = descriptors[rng.permutation(len(descriptors))] + rng.normal(0, noise, descriptors.shape)
    return np.rint(moved).clip(0, 255).astype(np.uint8)


def clear_neighbours(distance: NDArray[np.float64], ratio: float) -> dict[int, int]:
    two = np.argsort(distance, axis=1, kind="stable")[:, :2]
    rows = np.arange(len(distance))
    clear = distance[rows, two[:, 0]] < ratio * distance[rows, two[:, 1]]
    return {int(i): int(two[i, 0]) for i in rows[clear]}


def brute_force(a: Bytes, b: Bytes, ratio: float, mutual: bool) -> list[tuple[int, int]]:
    distance = np.linalg.norm(a[:, None].astype(float) - b[None].astype(float), axis=2)
    forward, backward = clear_neighbours(distance, ratio), clear_neighbours(distance.T, ratio)
    return [(i, j) for i, j in sorted(forward.items()) if not mutual or backward.get(j) == i]


@pytest.mark.parametrize("mutual", [True, False])
@pytest.mark.parametrize("ratio", [0.7, 0.95])
def test_matches_are_those_of_brute_force(ratio: float, mutual: bool) -> None:
    a = random_descriptors(1, 301)
    b = seen_again(2, np.vstack([a[:170], random_descriptors(3, 77)]), 60.0)
    found = match(a, b, ratio=ratio, mutual=mutual)
    assert found.dtype == np.int32
    assert found.tolist() == [list(pair) for pair in brute_force(a, b, ratio, mutual)]
    assert len(found) > 50


def test_exchanging_the_images_exchanges_the_columns() -> None:
    a = random_descriptors(4, 200)
    b = seen_again(5, a, 70.0)
    forward, backward = match(a, b), match(b, a)
    assert len(forward) > 20
    assert sorted(map(tuple, forward)) == sorted((i, j) for j, i in backward)


def test_a_descriptor_that_occurs_twice_has_no_clear_match() -> None:
    a = random_descriptors(6, 50)
    b = np.vstack([a, a[:10]])
    assert match(a, b)[:, 0].tolist() == list(range(10, 50))
    assert match(a, b, ratio=1.0).tolist() == [[k, k] for k in range(50)]


def test_where_there_is_no_second_neighbour_the_first_is_taken() -> None:
    one = random_descriptors(7, 1)
    assert match(one, one).tolist() == [[0, 0]]


def test_the_number_of_threads_changes_nothing() -> None:
    a = random_descriptors(8, 1000, 20) // 16
    b = random_descriptors(9, 900, 20) // 16
    found = match(a, b, ratio=1.0, threads=1)
    for threads in (2, 5, 0):
        np.testing.assert_array_equal(match(a, b, ratio=1.0, threads=threads), found)


@pytest.mark.parametrize("shapes", [((0, 128), (5, 128)), ((5, 128), (0, 128)), ((3, 0), (4, 0))])
def test_without_descriptors_nothing_matches(shapes: tuple[tuple[int, int], tuple[int, int]]) -> None:
    first, second = (np.zeros(shape, np.uint8) for shape in shapes)
    assert match(first, second).shape == (0, 2)


@pytest.mark.parametrize(
    ("second", "named"),
    [
        (np.zeros((3, 64), np.uint8), "has 64 columns, must have 128"),
        (np.zeros((3, 128)), "is float64"),
        (np.zeros(128, np.uint8), r"of shape \(128,\)"),
    ],
)
def test_arrays_that_do_not_go_together_are_named(second: Bytes, named: str) -> None:
    with pytest.raises(InvalidArgument, match=f"descriptors_2: .*{named}"):
        match(random_descriptors(0, 4), second)
    with pytest.raises(InvalidArgument, match=r"ratio = 1.5"):
        match(random_descriptors(0, 4), random_descriptors(1, 4), ratio=1.5)


@pytest.mark.parametrize("width", [128, 2048])
@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.4, 0.8])
def test_a_nearest_neighbour_without_a_second_passes_any_ratio(ratio: float, width: int) -> None:
    dark, bright = np.zeros((1, width), np.uint8), np.full((1, width), 255, np.uint8)
    for mutual in (True, False):
        assert match(dark, bright, ratio=ratio, mutual=mutual).tolist() == [[0, 0]]
