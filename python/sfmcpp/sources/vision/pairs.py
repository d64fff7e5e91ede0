"""Choice of the pairs of photos to match."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.checks import looked_up, require_count, require_seed
from sfmcpp.model.photos import Features, Photo, natural_order, words_and_numbers
from sfmcpp.sensors import east_north_up
from sfmcpp.sources.vision.retrieval import Heed, IndexPair, alike_pairs, nothing

_Words = list[tuple[int, str]]

# What a pair takes at most [s], on two cores: a search for its geometry, and matches by the product of the
# numbers of features. Up to so much in all, every pair is tried: 60 photos of 8,192 features.
_SECONDS_OF_GEOMETRY, _SECONDS_OF_MATCH = 0.02, 4e-10
_SECONDS_WORTH_ALL_PAIRS = 90.0
# In a sequence, images from one to the next for which older ones are looked up that show the same place.
_LOOPS_EVERY = 10
# Positions that belong together: within so many times the usual distance to the nearest, or so many metres,
# which are what GPS in a phone may be off by.
_NEAR_STEPS, _NEAR_M = 10.0, 50.0
# Names make a sequence if so much of them are those before with a greater number, by no more than so many
# times the usual step. Numbers drawn at random would do so for two thirds.
_COUNTING_UP, _EVEN_STEP = 0.8, 1.5


@dataclass(frozen=True)
class _Choice:
    """Input of the ways to choose pairs."""

    photos: Sequence[Photo]
    features: Sequence[Features]
    overlap: int
    neighbours: int
    seed: int
    threads: int
    heed: Heed

    def alike(
        self, queries: Sequence[int] | None = None, known: set[IndexPair] | None = None
    ) -> set[IndexPair]:
        return set(
            alike_pairs(
                self.features,
                self.neighbours,
                queries=queries,
                known=known or set(),
                seed=self.seed,
                threads=self.threads,
                heed=self.heed,
            )
        )


def choose_pairs(
    photos: Sequence[Photo],
    features: Sequence[Features],
    matcher: str = "auto",
    *,
    seed: int = 0,
    overlap: int = 10,
    neighbours: int = 30,
    threads: int = 0,
    heed: Heed = nothing,
) -> list[IndexPair]:
    """Choose the pairs of photos that are worth matching.

    Parameters
    ----------
    photos : sequence of Photo
        The set.
    features : sequence of Features
        Of each photo.
    matcher : str
        - ``"exhaustive"``: all.
        - ``"sequential"``: each with the next `overlap` in time, or by name (2 before 10) where a photo has
          no time, with the 1st, 2nd, 4th, 8th … after it, and every tenth with those that look like it.
        - ``"spatial"``: each with the nearest by GPS, those without a position with those that look like
          them.
        - ``"retrieval"``: each with those that look most like it.
        - ``"auto"``: all where that takes little more than a minute; else those that look alike, the nearest
          by GPS, and the next in time or by name if these make a sequence.
    seed : int
        Same seed, same pairs.
    overlap : int
        Next ones in a sequence.
    neighbours : int
        Those nearest, or most alike, for each photo at most.
    threads : int
        How many to use; 0: all. The result is the same.
    heed : callable
        Called between parts of the work, within seconds; what it raises ends it.

    Returns
    -------
    list of (int, int)
        Numbers of photos, sorted, the lower first.

    Raises
    ------
    InvalidArgument
        For an unknown matcher, features of more or fewer images, and ``"spatial"`` with less than two
        positions.
    """
    way = looked_up("matcher", matcher, _WAYS)
    require_seed(seed)
    require_count("overlap", overlap)
    require_count("neighbours", neighbours)
    if len(features) != len(photos):
        raise InvalidArgument(f"features: of {len(features)} images, must be of {len(photos)} as photos")
    return sorted(way(_Choice(photos, features, overlap, neighbours, seed, threads, heed)))


def _exhaustive(choice: _Choice) -> set[IndexPair]:
    return set(combinations(range(len(choice.photos)), 2))


def _sequential(choice: _Choice) -> set[IndexPair]:
    order = _photo_order(choice.photos)
    steps = {*range(1, choice.overlap + 1), *(2**k for k in range(choice.overlap))}
    pairs = _pairs_at_steps(order, steps)
    return pairs | choice.alike(order[::_LOOPS_EVERY], pairs)


def _spatial(choice: _Choice) -> set[IndexPair]:
    lost = [k for k, photo in enumerate(choice.photos) if photo.position is None]
    if len(choice.photos) - len(lost) < 2:
        raise InvalidArgument(
            f"matcher = 'spatial': {len(lost)} of {len(choice.photos)} photos lack a position, "
            "at least two must have one"
        )
    return _nearby_pairs(choice) | (choice.alike(lost) if lost else set())


def _retrieval(choice: _Choice) -> set[IndexPair]:
    return choice.alike()


def _auto(choice: _Choice) -> set[IndexPair]:
    if _seconds_for_all(choice.features) <= _SECONDS_WORTH_ALL_PAIRS:
        return _exhaustive(choice)
    pairs = choice.alike() | _nearby_pairs(choice)
    if _is_sequence(choice.photos):
        pairs |= _pairs_at_steps(_photo_order(choice.photos), range(1, choice.overlap + 1))
    return pairs


_WAYS: dict[str, Callable[[_Choice], set[IndexPair]]] = {
    "auto": _auto,
    "exhaustive": _exhaustive,
    "sequential": _sequential,
    "spatial": _spatial,
    "retrieval": _retrieval,
}
MATCHERS = tuple(_WAYS)


def _seconds_for_all(features: Sequence[Features]) -> float:
    counts = np.array([len(of_image) for of_image in features], dtype=np.float64)
    products = (counts.sum() ** 2 - (counts**2).sum()) / 2
    pairs = len(counts) * (len(counts) - 1) / 2
    return float(pairs * _SECONDS_OF_GEOMETRY + products * _SECONDS_OF_MATCH)


def _pairs_at_steps(order: Sequence[int], steps: set[int] | range) -> set[IndexPair]:
    """Pairs of images so many places apart in `order`."""
    return {(min(i, j), max(i, j)) for step in steps for i, j in zip(order, order[step:], strict=False)}


def _photo_order(photos: Sequence[Photo]) -> list[int]:
    """Numbers of the photos by time where all have one, and by name."""
    timed = all(photo.taken_s is not None for photo in photos)
    return sorted(
        range(len(photos)),
        key=lambda k: (photos[k].taken_s or 0.0 if timed else 0.0, natural_order(photos[k].name)),
    )


def _is_sequence(photos: Sequence[Photo]) -> bool:
    """Whether all photos have a time, or names count up evenly."""
    if all(photo.taken_s is not None for photo in photos):
        return True
    names = [words_and_numbers(photos[k].name.rpartition(".")[0]) for k in _photo_order(photos)]
    steps = np.array([_counting_step(first, second) for first, second in pairwise(names)])
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    even = (steps > 0) & (steps <= _EVEN_STEP * usual)
    return bool(even.sum() >= _COUNTING_UP * len(steps))


def _counting_step(first: _Words, second: _Words) -> int:
    """By how much the last number of a name counts up if all else is equal; else 0."""
    last = max((k for k, (_, text) in enumerate(second) if not text), default=-1)
    if last < 0 or len(first) != len(second):
        return 0
    step = second[last][0] - first[last][0]
    return max(step, 0) if [*first[:last], second[last], *first[last + 1 :]] == second else 0


def _nearby_pairs(choice: _Choice) -> set[IndexPair]:
    """Pairs of photos near each other by their positions, as far as they have any; heights do not count."""
    from scipy.spatial import cKDTree

    placed = [k for k, photo in enumerate(choice.photos) if photo.position is not None]
    if len(placed) < 2:
        return set()
    geodetic = np.array([choice.photos[k].position for k in placed], dtype=np.float64)
    geodetic[:, 2] = 0  # not a number where a file tells none
    local = east_north_up(geodetic, geodetic[0])[:, :2]
    found: Any = cKDTree(local).query(local, min(choice.neighbours + 1, len(placed)))
    distances, others = found
    steps = np.min(distances, axis=1, where=distances > 0, initial=np.inf)
    usual = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    first, rank = np.nonzero(distances <= max(_NEAR_M, _NEAR_STEPS * usual))
    ends = np.sort(np.array(placed)[np.column_stack([first, others[first, rank]])], axis=1)
    return {(int(i), int(j)) for i, j in ends if i != j}
