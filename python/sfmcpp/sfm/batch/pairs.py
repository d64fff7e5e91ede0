"""Fundamental matrices of pairs of images, and which observations they make plausible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import fundamental_from_matches
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.batch.measurements import Indices, Measurements

LEAST_SHARED = 15
_MOST_PAIRS = 12
_LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """What two images say of each other.

    Attributes
    ----------
    first, second : int
        Numbers of the images.
    fundamental : (3, 3) float64
        ``q₁ᵀ F q₂ = 0`` in the frames of the images, of norm one.
    rows : (2, m) int64
        Observations of all tracks they share.
    inliers : (m,) bool
        Which agree.
    """

    first: int
    second: int
    fundamental: FloatArray
    rows: Indices
    inliers: BoolArray


def pair_geometries(measured: Measurements, threshold_px: float, seed: int) -> list[PairGeometry]:
    """Estimate the pairs worth trying: each image with those it shares the most tracks with."""
    found = []
    for first, second in candidate_pairs(measured.shared_counts()):
        rows = measured.common_rows([first, second])
        pixels = measured.pixels[rows]
        estimate = fundamental_from_matches(
            pixels[0], pixels[1], threshold_px=threshold_px, min_inliers=LEAST_SHARED, seed=seed
        )
        if estimate.success:
            matrix = _in_frames(estimate.matrix, *measured.frames[[first, second]])
            found.append(PairGeometry(first, second, matrix, rows, estimate.inliers))
    return found


def candidate_pairs(shared: Indices) -> list[tuple[int, int]]:
    """Pairs that share enough tracks, of each image at most a dozen, those with the most first."""
    counts = np.triu(shared, 1) + np.triu(shared, 1).T
    chosen = set()
    for image, row in enumerate(counts):
        best = np.argsort(-row, kind="stable")[:_MOST_PAIRS]
        chosen.update((min(image, int(o)), max(image, int(o))) for o in best if row[o] >= LEAST_SHARED)
    return sorted(chosen)


def plausible_observations(measured: Measurements, pairs: list[PairGeometry]) -> BoolArray:
    """(M,) observations that agree with another one of their track, and with half of those they were compared with.

    Of each track only the largest set that hangs together is kept.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = len(measured.image)
    tested, agreed = np.zeros(count, np.int64), np.zeros(count, np.int64)
    edges = [pair.rows[:, pair.inliers] for pair in pairs]
    for pair, good in zip(pairs, edges, strict=True):
        for side in (0, 1):
            tested[pair.rows[side]] += 1
            agreed[good[side]] += 1
    if not edges:
        return np.zeros(count, np.bool_)
    linked = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(linked.shape[1]), (linked[0], linked[1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    size = np.bincount(label)[label]
    # The largest component of each track; among equals the first.
    order = np.lexsort((label, -size, measured.track))
    first = np.flatnonzero(np.diff(measured.track[order], prepend=-1))
    best = np.full(measured.num_tracks, -1)
    best[measured.track[order[first]]] = label[order[first]]
    return np.asarray((label == best[measured.track]) & (size >= 2) & (agreed >= _LEAST_SHARE * tested * 0.5))


def _in_frames(matrix: FloatArray, frame_1: FloatArray, frame_2: FloatArray) -> FloatArray:
    moved = _denormalising(frame_1).T @ matrix @ _denormalising(frame_2)
    return np.asarray(moved / np.linalg.norm(moved))


def _denormalising(frame: FloatArray) -> FloatArray:
    scale, cx, cy = frame
    return np.array([[scale, 0, cx], [0, scale, cy], [0, 0, 1.0]])
