"""Match graph of a folder of photos: features, pairs, matches and two-view geometry.

What takes long is kept by its content, if a cache is given: features by the photo, the choice of pairs by all
photos, matches by two, geometry by matches and intrinsics. So a run that was interrupted goes on where it
was, and one more photo costs its own pairs only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import TwoViewGeometry
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import require_count, require_positive, require_seed, require_share
from sfmcpp.model.photos import Features, Photo
from sfmcpp.model.threads import (
    Progress,
    no_progress,
    report_progress,
    results_in_order,
    thread_count,
    timed,
)
from sfmcpp.sfm.cache import Arrays, Cache, cache_key
from sfmcpp.sfm.match_graph import ImagePair, Matches, MatchGraph, Pair, geometry_of_matches, unique_matches
from sfmcpp.sources.vision import (
    FeatureSettings,
    PhotoFolder,
    choose_pairs,
    detect,
    detector_version,
    match,
    one_opencv_thread,
)

# Raised when the same input gives another result than before.
_FEATURES_VERSION, _PAIRS_VERSION, _MATCHES_VERSION, _GEOMETRY_VERSION = 2, 1, 2, 2
# Each searches a photo in 350 MB.
_MOST_DETECTORS = 16

Row = FloatArray | None
Intrinsics = Sequence[Row]
Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass(frozen=True)
class FrontEndSettings:
    """Settings of the match graph of photos.

    Attributes
    ----------
    features : FeatureSettings
        What is detected.
    matcher : str
        Which pairs are tried: see :func:`sfmcpp.sources.vision.choose_pairs`.
    ratio : float
        Distance of a match over that of the second nearest, at most.
    mutual : bool
        Whether each of a match must be the nearest of the other.
    threshold_px : float
        Largest error of a match that agrees with the geometry [px].
    min_inliers : int
        Fewest matches that must agree.
    seed : int
        Of every random sample; same seed, same result.
    threads : int or None
        Threads at most; the result does not depend on it. None: as many as the process may use.
    """

    features: FeatureSettings = field(default_factory=FeatureSettings)
    matcher: str = "auto"
    ratio: float = 0.8
    mutual: bool = True
    threshold_px: float = 2.0
    min_inliers: int = 15
    seed: int = 0
    threads: int | None = None

    def __post_init__(self) -> None:
        require_share("ratio", self.ratio)
        require_positive("threshold_px", self.threshold_px)
        require_count("min_inliers", self.min_inliers, 8)
        require_seed(self.seed)
        if self.threads is not None:
            require_count("threads", self.threads, 1)


def build_match_graph(
    folder: PhotoFolder,
    settings: FrontEndSettings | None = None,
    intrinsics: Intrinsics | None = None,
    *,
    cache: Cache | None = None,
    progress: Progress = no_progress,
    seconds: dict[str, float] | None = None,
) -> MatchGraph:
    """Detect features in photos, match them, and estimate the geometry of each pair.

    Parameters
    ----------
    folder : PhotoFolder
        What :func:`sfmcpp.sources.vision.open_photos` found.
    settings : FrontEndSettings, optional
        Thresholds.
    intrinsics : sequence of (12,) float64 or None, optional
        Of each photo's camera, in the order of the perspective model; None where they are unknown.
    cache : Cache, optional
        Where features, matches and geometry are kept, and taken from.
    progress : callable
        Called as ``progress(stage, done, total)`` with the stages ``"features"``, ``"pairs"``, ``"matching"``
        and ``"geometry"``; returning True asks to stop.
    seconds : dict, optional
        The time that each stage took [s] is added to it.

    Returns
    -------
    MatchGraph
        Of the photos that can be decoded, features without their descriptors; the others are in its
        `unreadable`.

    Raises
    ------
    DatasetError
        If no photo can be decoded, or the cache cannot be written.
    InvalidArgument
        If `intrinsics` are not as many as photos.
    KeyboardInterrupt
        If `progress` asked to stop; what was done by then is in the cache.
    """
    rows: Intrinsics = [None] * len(folder.photos) if intrinsics is None else intrinsics
    if len(rows) != len(folder.photos):
        raise InvalidArgument(f"intrinsics: {len(rows)} rows, must be {len(folder.photos)}, one a photo")
    work = _Work(settings or FrontEndSettings(), cache, progress, {} if seconds is None else seconds)
    found = work.features(folder.photos)
    readable, unreadable = _decoded_and_unreadable(folder, found)
    photos = [folder.photos[i] for i in readable]
    features = [one for one in found if isinstance(one, Features)]
    numbers = work.pairs(photos, features)
    matches = work.matches(photos, features, numbers)
    # Half of the memory of many photos, and nobody needs them any more.
    del found
    features = [replace(one, descriptors=np.empty((len(one), 0), dtype=np.uint8)) for one in features]
    geometries = work.geometries(photos, features, [rows[i] for i in readable], numbers, matches)
    pairs = [Pair(*ij, m, g) for ij, m, g in zip(numbers, matches, geometries, strict=True)]
    return MatchGraph(photos, features, pairs, unreadable)


def _decoded_and_unreadable(
    folder: PhotoFolder, found: list[Features | str]
) -> tuple[list[int], dict[str, str]]:
    """Which photos could be decoded, and why each other file could not."""
    readable = [i for i, one in enumerate(found) if isinstance(one, Features)]
    reasons = {p.name: one for p, one in zip(folder.photos, found, strict=True) if isinstance(one, str)}
    unreadable = folder.unreadable | reasons
    if not readable:
        name, reason = next(iter(unreadable.items()), ("", "there is none"))
        raise DatasetError(folder.path, f"none of its {len(unreadable)} images can be read; {name}: {reason}")
    return readable, unreadable


@dataclass(frozen=True)
class _Work:
    """The stages, each in parallel and each cached."""

    settings: FrontEndSettings
    cache: Cache | None
    progress: Progress
    seconds: dict[str, float]

    def features(self, photos: Sequence[Photo]) -> list[Features | str]:
        """Features of each photo, or why it cannot be decoded."""
        with one_opencv_thread():
            return self._run_tasks("features", self._features_of, photos, _MOST_DETECTORS)

    def pairs(self, photos: Sequence[Photo], features: Sequence[Features]) -> list[ImagePair]:
        def begin_or_go_on() -> None:
            report_progress(self.progress, "pairs", 0, 1)

        def choose() -> Arrays:
            settings, threads = self.settings, thread_count(self.settings.threads)
            matcher, seed = settings.matcher, settings.seed
            chosen = choose_pairs(photos, features, matcher, seed=seed, threads=threads, heed=begin_or_go_on)
            return {"pairs": np.array(chosen, dtype=np.int32).reshape(-1, 2)}

        with timed("pairs", self.seconds):
            begin_or_go_on()
            found = self._from_cache_or_computed("pairs", self._pairs_key(photos), choose)
            report_progress(self.progress, "pairs", 1, 1)
        return [(i, j) for i, j in found["pairs"].tolist()]

    def matches(
        self, photos: Sequence[Photo], features: Sequence[Features], pairs: Sequence[ImagePair]
    ) -> list[Matches]:
        """Matches of each pair; of features at one place, the first stands for all."""
        places = [_first_at_place(one.pixels) for one in features]

        def matches_of(pair: ImagePair) -> Matches:
            i, j = pair
            return self._from_cache_or_computed(
                "matches",
                self._matches_key(photos[i], photos[j]),
                lambda: {"matches": self._matches_between(features[i], features[j], places[i], places[j])},
            )["matches"]

        return self._run_tasks("matching", matches_of, pairs)

    def geometries(
        self,
        photos: Sequence[Photo],
        features: Sequence[Features],
        rows: Intrinsics,
        pairs: Sequence[ImagePair],
        matches: Sequence[Matches],
    ) -> list[TwoViewGeometry]:
        def geometry_of(number: int) -> TwoViewGeometry:
            (i, j), m = pairs[number], matches[number]
            arrays = self._from_cache_or_computed(
                "geometry",
                self._geometry_key(photos[i], photos[j], rows[i], rows[j]),
                lambda: _arrays_of(
                    estimated_geometry(features[i], features[j], rows[i], rows[j], m, self.settings)
                ),
            )
            return _geometry_of(arrays)

        return self._run_tasks("geometry", geometry_of, range(len(pairs)))

    def _features_of(self, photo: Photo) -> Features | str:
        try:
            key = self._features_key(photo)
            found = self._load_cached("features", key)
            features = vars(detect(photo, self.settings.features)) if found is None else found
        except DatasetError as error:
            return error.reason if error.path == str(photo.path) else str(error)
        if found is None:  # a cache that cannot be written is no fault of the photo
            self._save_cached("features", key, features)
        return Features(**features)

    def _matches_between(
        self, one: Features, other: Features, places_1: IndexArray, places_2: IndexArray
    ) -> Matches:
        ratio, mutual = self.settings.ratio, self.settings.mutual
        found = match(one.descriptors, other.descriptors, ratio=ratio, mutual=mutual, threads=1)
        return unique_matches(np.column_stack([places_1[found[:, 0]], places_2[found[:, 1]]]))

    def _features_key(self, *photos: Photo) -> str:
        """Empty if there is a photo whose content is not known."""
        digests = [photo.digest for photo in photos]
        parts = (digests, self.settings.features, _FEATURES_VERSION, detector_version())
        return cache_key(*parts) if all(digests) else ""

    def _pairs_key(self, photos: Sequence[Photo]) -> str:
        features = self._features_key(*photos)
        told = [(photo.name, photo.position, photo.taken_s) for photo in photos]
        return features and cache_key(
            features, told, self.settings.matcher, self.settings.seed, _PAIRS_VERSION
        )

    def _matches_key(self, *photos: Photo) -> str:
        features = self._features_key(*photos)
        parts = (features, self.settings.ratio, self.settings.mutual, _MATCHES_VERSION)
        return features and cache_key(*parts)

    def _geometry_key(self, one: Photo, other: Photo, *rows: Row) -> str:
        matches = self._matches_key(one, other)
        settings = self.settings
        parts = (matches, settings.threshold_px, settings.min_inliers, settings.seed, _GEOMETRY_VERSION)
        return matches and cache_key(*parts, *rows)

    def _from_cache_or_computed(self, stage: str, key: str, compute: Callable[[], Arrays]) -> Arrays:
        """Arrays from the cache, or computed and put there."""
        found = self._load_cached(stage, key)
        if found is None:
            found = compute()
            self._save_cached(stage, key, found)
        return found

    def _load_cached(self, stage: str, key: str) -> Arrays | None:
        return self.cache.load(stage, key) if self.cache is not None and key else None

    def _save_cached(self, stage: str, key: str, arrays: Arrays) -> None:
        if self.cache is not None and key:
            self.cache.save(stage, key, **arrays)

    def _run_tasks(
        self, stage: str, function: Callable[[Task], Result], tasks: Sequence[Task], most: int | None = None
    ) -> list[Result]:
        threads = thread_count(self.settings.threads)
        threads = threads if most is None else min(most, threads)
        with timed(stage, self.seconds):
            return results_in_order(function, tasks, threads, stage=stage, progress=self.progress)


def estimated_geometry(
    one: Features, other: Features, row_1: Row, row_2: Row, matches: Matches, settings: FrontEndSettings
) -> TwoViewGeometry:
    """What matches say of two images; `row_1` and `row_2`: intrinsics, None where unknown."""
    limits = settings.threshold_px, settings.min_inliers, settings.seed
    return geometry_of_matches(one, other, row_1, row_2, matches, *limits)


def _first_at_place(pixels: FloatArray) -> IndexArray:
    """(n,) the first feature at the place of each: a blob of several orientations is there several times."""
    _, first, place = np.unique(pixels, axis=0, return_index=True, return_inverse=True)
    return first[place.reshape(-1)].astype(np.int32)


def _arrays_of(geometry: TwoViewGeometry) -> Arrays:
    return {name: np.asarray(value) for name, value in vars(geometry).items()}


def _geometry_of(arrays: Arrays) -> TwoViewGeometry:
    return TwoViewGeometry(**{n: a if a.ndim else a.item() for n, a in arrays.items()})  # type: ignore[arg-type]
