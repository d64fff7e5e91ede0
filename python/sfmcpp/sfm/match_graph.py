"""The match graph: photos, their features, and matched pairs with their geometry."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.geometry import TwoViewGeometry, two_view_geometry
from sfmcpp.model.arrays import IndexArray
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sources.io.colmap.database import DatabaseCamera

Matches = NDArray[np.int32]
ImagePair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images and their matches.

    Attributes
    ----------
    first, second : int
        Numbers of the images, first < second.
    matches : (m, 2) int32
        Features of the first and of the second that look alike, each at most once.
    geometry : TwoViewGeometry
        What the matches say of the two cameras, and which of them agree.
    """

    first: int
    second: int
    matches: Matches
    geometry: TwoViewGeometry

    @property
    def verified(self) -> Matches:
        """(k, 2) the matches that agree with the geometry."""
        return self.matches[self.geometry.inliers]

    @property
    def num_verified(self) -> int:
        """How many agree."""
        return int(np.count_nonzero(self.geometry.inliers))


@dataclass(frozen=True, eq=False)
class MatchGraph:
    """All images and pairs of a set.

    Attributes
    ----------
    photos : list of Photo
        The images, in the order of their names.
    features : list of Features
        What was detected in each.
    pairs : list of Pair
        Those that were tried, in the order of their numbers, also those without a geometry.
    unreadable : dict
        Reason for each file that was left out, by its name.
    image_ids : list of int or None
        Identifiers of the images in the COLMAP database that they are from.
    cameras : list of DatabaseCamera or None
        Camera of each image in that database.
    warnings : list of str
        What a user should know of the source, in sentences.
    """

    photos: list[Photo]
    features: list[Features]
    pairs: list[Pair]
    unreadable: dict[str, str] = field(default_factory=dict)
    image_ids: list[int] | None = None
    cameras: list[DatabaseCamera] | None = None
    warnings: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        match = sum(pair.geometry.kind != "none" for pair in self.pairs)
        return f"MatchGraph({len(self.photos)} images, {match} of {len(self.pairs)} pairs match)"

    @cached_property
    def verified_pairs(self) -> list[list[Pair]]:
        """Of each image the pairs with a geometry, those with most verified matches first."""
        found: list[list[Pair]] = [[] for _ in self.photos]
        verified = [pair for pair in self.pairs if pair.geometry.kind != "none"]
        for pair in sorted(verified, key=lambda pair: -pair.num_verified):
            found[pair.first].append(pair)
            found[pair.second].append(pair)
        return found

    def largest_general(self, numbers: Sequence[int], most: int) -> list[Pair]:
        """The pairs of these numbers with a general geometry: `most` at most, of most verified matches."""
        general = [pair for pair in map(self.pairs.__getitem__, numbers) if pair.geometry.kind == "general"]
        return sorted(general, key=lambda pair: -pair.num_verified)[:most]

    def pairs_by_camera(self, of_image: IndexArray) -> defaultdict[int, list[int]]:
        """Numbers of the pairs within each camera, by camera; `of_image` (I,) has that of each image."""
        found: defaultdict[int, list[int]] = defaultdict(list)
        cameras = of_image.tolist()
        for number, pair in enumerate(self.pairs):
            if cameras[pair.first] == cameras[pair.second]:
                found[cameras[pair.first]].append(number)
        return found


def geometry_of_matches(
    one: Features,
    other: Features,
    row_1: ArrayLike | None,
    row_2: ArrayLike | None,
    matches: Matches,
    threshold_px: float,
    min_inliers: int,
    seed: int,
) -> TwoViewGeometry:
    """What matches say of two images; `row_1` and `row_2`: intrinsics, None where unknown."""
    return two_view_geometry(
        one.pixels[matches[:, 0]],
        other.pixels[matches[:, 1]],
        row_1,
        row_2,
        threshold_px=threshold_px,
        min_inliers=min_inliers,
        seed=seed,
    )


def unique_matches(matches: NDArray[np.int32]) -> Matches:
    """Each match once, without those of a feature that matches several: (k, 2), sorted."""
    once = np.unique(matches, axis=0).reshape(-1, 2)
    good = np.ones(len(once), dtype=np.bool_)
    for column in once.T:
        good &= np.bincount(column, minlength=1)[column] == 1
    return np.asarray(once[good], dtype=np.int32)
