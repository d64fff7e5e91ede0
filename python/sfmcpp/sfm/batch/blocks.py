"""Full sub-matrices of the measurement matrix, each factorised by itself (thesis §3.1.5.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.batch.depths import chained_depths
from sfmcpp.sfm.batch.factorisation import Factors, factorise
from sfmcpp.sfm.batch.measurements import Indices, Measurements
from sfmcpp.sfm.batch.pairs import PairGeometry

_LEAST_TRACKS = 8
_SIZES = (3, 4, 5, 6, 8, 10)
_LEAST_PART = 0.4


@dataclass(frozen=True, eq=False)
class Block:
    """A full sub-matrix with its factors.

    Attributes
    ----------
    images : list of int
        Its s images.
    tracks : (n,) int64
        Its tracks.
    factors : Factors
        Cameras and points in a projective frame of its own.
    error_px : float
        Median reprojection error [px].
    """

    images: list[int]
    tracks: Indices
    factors: Factors
    error_px: float


def factorised_blocks(
    measured: Measurements, pairs: list[PairGeometry], kept: BoolArray, threshold_px: float
) -> list[Block]:
    """All blocks that are consistent in themselves."""
    matrices = {(pair.first, pair.second): pair.fundamental for pair in pairs}
    support = {(pair.first, pair.second): int(pair.inliers.sum()) for pair in pairs}
    blocks = [
        _factorised(measured, images, matrices, support, kept, threshold_px)
        for images in image_sets(measured, support, kept)
    ]
    return [block for block in blocks if block is not None]


def image_sets(
    measured: Measurements, support: dict[tuple[int, int], int], kept: BoolArray
) -> list[tuple[int, ...]]:
    """Sets of images with enough tracks in common: grown from each image, and triples of close ones."""
    seen = _seen_by(measured, kept)
    neighbours: dict[int, list[int]] = {image: [] for image in range(measured.num_images)}
    for (first, second), _ in sorted(support.items(), key=lambda item: (-item[1], item[0])):
        neighbours[first].append(second)
        neighbours[second].append(first)
    chosen: set[tuple[int, ...]] = set()
    for image in range(measured.num_images):
        chosen.update(_grown(image, neighbours, seen))
        chosen.update(_triples(image, neighbours, seen))
    return sorted(chosen)


def _seen_by(measured: Measurements, kept: BoolArray) -> BoolArray:
    seen = np.zeros((measured.num_images, measured.num_tracks), dtype=np.bool_)
    seen[measured.image[kept], measured.track[kept]] = True
    return seen


def _grown(image: int, neighbours: dict[int, list[int]], seen: BoolArray) -> list[tuple[int, ...]]:
    """Nested sets: always add the image that leaves the most tracks."""
    images, common = [image], seen[image]
    found: list[tuple[int, ...]] = []
    while True:
        candidates = sorted({other for member in images for other in neighbours[member]} - set(images))
        if not candidates:
            return found
        counts = (seen[candidates] & common).sum(axis=1)
        best = int(np.argmax(counts))
        if counts[best] < _LEAST_TRACKS:
            return found
        images.append(candidates[best])
        common = common & seen[candidates[best]]
        if len(images) in _SIZES:
            found.append(tuple(sorted(images)))
        if len(images) == _SIZES[-1]:
            return found


def _triples(image: int, neighbours: dict[int, list[int]], seen: BoolArray) -> list[tuple[int, ...]]:
    """The six triples of an image with two of its neighbours that share the most tracks."""
    others = neighbours[image][:8]
    found: list[tuple[int, tuple[int, ...]]] = []
    for place, second in enumerate(others):
        common = seen[image] & seen[second]
        for third in others[place + 1 :]:
            count = int((common & seen[third]).sum())
            if count >= _LEAST_TRACKS:
                found.append((-count, tuple(sorted((image, second, third)))))
    return [images for _, images in sorted(found)[:8]]


def _factorised(
    measured: Measurements,
    images: tuple[int, ...],
    matrices: dict[tuple[int, int], FloatArray],
    support: dict[tuple[int, int], int],
    kept: BoolArray,
    threshold_px: float,
) -> Block | None:
    chain = _chain(images, support)
    if chain is None:
        return None
    order, parents = chain
    rows = measured.common_rows(order, kept)
    scale_px = measured.frames[order, 0][:, None]
    local = {
        (a, b): matrices[order[a], order[b]] if order[a] < order[b] else matrices[order[b], order[a]].T
        for a in range(len(order))
        for b in range(a + 1, len(order))
        if (min(order[a], order[b]), max(order[a], order[b])) in matrices
    }
    for _ in range(3):
        if rows.shape[1] < _LEAST_TRACKS:
            return None
        rays = measured.rays[rows]
        factors = factorise(rays, chained_depths(rays, local, parents))
        error_px = factors.errors(rays) * scale_px
        limit = max(threshold_px, 3 * float(np.median(error_px)))
        good = (error_px < limit).all(axis=0) & (factors.depths > 0).all(axis=0)
        if good.all():
            break
        rows = rows[:, good]
    if not good.all() or float(np.median(error_px)) > threshold_px:
        return None
    return Block(order, measured.track[rows[0]], factors, float(np.median(error_px)))


def _chain(
    images: tuple[int, ...], support: dict[tuple[int, int], int]
) -> tuple[list[int], list[int]] | None:
    """Images ordered along a tree of the best supported pairs, and the place of each one's parent."""
    within = {pair: count for pair, count in support.items() if pair[0] in images and pair[1] in images}
    if not within:
        return None
    order, parents = [max(sorted(within), key=lambda pair: within[pair])[0]], [0]
    while len(order) < len(images):
        edges = [
            (-count, order.index(a), b)
            for (x, y), count in within.items()
            for a, b in ((x, y), (y, x))
            if a in order and b not in order
        ]
        if not edges:
            return None
        _, parent, image = min(edges)
        order.append(image)
        parents.append(parent)
    return order, parents
